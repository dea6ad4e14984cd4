"""Training on views and with the authors' code, which copies every window: memory, speed, and time to an equal score.

Run ``python benchmarks/training.py [--data DIR]``; without ``--data`` a small set is made with the simulated finger.
Each part runs in a process of its own, on one thread, so that peak memory and processor time are its own. The authors'
code is written here anew, after their notebook: every window at a hop of one is cut in a Python loop, stacked, masked
by loudness, joined, and shuffled into batches of 6000. At full size it needs over 90 GB, so it runs on a share
of the set and its memory is scaled up.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", OMP_WAIT_POLICY="passive")

import numpy as np
import psutil
import torch
from torch import nn

from tactophone import Touch
from tactophone.lab.dataset.read import open_dataset
from tactophone.lab.dataset.splits import Fold, split
from tactophone.lab.evaluation.metrics import measure
from tactophone.lab.evaluation.predict import TakePredictions, scores_of
from tactophone.lab.training.network import SIZE, PaperNetwork, Windows, find_windows, magnitudes
from tactophone.lab.training.recipes import FAST_CHANGES, NetworkSettings, network_settings
from tactophone.lab.training.tracks import read_signals
from tactophone.lab.training.trainer import Run

SETTINGS = replace(network_settings("general"), **FAST_CHANGES)
EXACT = replace(SETTINGS, hop=1, batch_size=6000, least_steps=0)
FAST = replace(SETTINGS, precision="bfloat16", learning_rate=5e-4)

FULL_SIZE = 20 * 7 * 30 * 2000
"""Samples of the paper's training set at 2 kHz: 20 objects, 7 takes of 30 s."""

SHARE = 0.03
"""Of the full set, for the memory of the authors' code: 1 GB of windows."""

PATIENCE = 80.0
"""Seconds of processor time for the authors' code to reach its score."""


@dataclass(frozen=True, slots=True)
class HeldOut:
    """Features and truth of every update of a fold's test recordings."""

    features: list[np.ndarray]
    takes: list[TakePredictions]

    def score(self, network: nn.Module) -> float:
        """Balanced accuracy, of two classes, over the paper's threshold."""
        with torch.inference_mode():
            rows = [network(torch.from_numpy(features)).exp().numpy() for features in self.features]
        takes = [replace(take, probabilities=row) for take, row in zip(self.takes, rows, strict=True)]
        return measure(scores_of(takes, "two-class"))["balanced_accuracy"]


def held_out(fold: Fold) -> HeldOut:
    features, takes = [], []
    for recording, signal in zip(fold.test, read_signals(fold.test, channels=2), strict=True):
        starts = np.arange(0, len(signal) - SIZE, 64)
        windows = np.stack([signal[start : start + SIZE] for start in starts])
        features.append(magnitudes(torch.from_numpy(windows)).numpy())
        contact = np.square(windows[:, :, 0]).mean(axis=1) > SETTINGS.labelling.threshold**2
        takes.append(TakePredictions(recording, starts / 2000, np.empty((0, 3), np.float32), contact))
    return HeldOut(features, takes)


def windows_of(fold: Fold) -> Windows:
    return find_windows(
        read_signals(fold.train, channels=2), [take.label or Touch.NONE for take in fold.train], rule=SETTINGS.labelling
    )


def materialise(signals: Sequence[np.ndarray], labels: Sequence[Touch]) -> tuple[torch.Tensor, torch.Tensor]:
    """Cut, stack, mask and join every window, as the authors' notebook does."""
    parts, targets = [], []
    for touch in (Touch.SMOOTH, Touch.ROUGH):
        of_label = [signal for signal, label in zip(signals, labels, strict=True) if label is touch]
        windows = torch.stack(
            [torch.from_numpy(signal[n : n + SIZE].T) for signal in of_label for n in range(len(signal) - SIZE)]
        )
        loud = windows[:, 0].square().mean(dim=1).sqrt() > SETTINGS.labelling.threshold
        parts += [windows[loud], windows[~loud]]
        targets += [torch.full((int(loud.sum()),), int(touch)), torch.zeros(int((~loud).sum()), dtype=torch.long)]
    return torch.cat(parts), torch.cat(targets)


def reference_steps(windows: torch.Tensor, labels: torch.Tensor, network: nn.Module) -> Iterator[int]:
    """Train as the authors do; yield the number of windows of each batch."""
    torch.set_float32_matmul_precision("highest")
    optimiser = torch.optim.Adam(network.parameters(), lr=EXACT.learning_rate)
    weights = torch.tensor(EXACT.class_weights)
    while True:
        for which in torch.randperm(len(windows)).split(EXACT.batch_size):
            batch = windows[which] + EXACT.noise * torch.randn(len(which), 2, SIZE)
            features = torch.fft.rfft(batch).abs().flatten(1)
            optimiser.zero_grad()
            nn.functional.nll_loss(network(features), labels[which], weight=weights).backward()
            optimiser.step()
            yield len(which)


def tile(windows: Windows, size: int) -> Windows:
    """Repeat a set until it has the full set's length."""
    times = -(-size // len(windows.signal))
    starts = np.concatenate([windows.starts + n * len(windows.signal) for n in range(times)]).astype(np.int32)
    return Windows(np.tile(windows.signal, (times, 1)), starts, np.tile(windows.labels, times))


def run_steps(windows: Windows, settings: NetworkSettings, seconds: float) -> dict[str, float]:
    """Train for a while; return windows per second of processor time, without the first batch."""
    began, first = 0.0, 0
    for progress in Run(windows, settings):
        began, first = began or time.process_time(), first or progress.steps
        spent = time.process_time() - began
        if spent > seconds and progress.steps > first + 1:
            return {"rate": (progress.steps - first) * settings.batch_size / spent}
    raise AssertionError("the run was too short")


def part_views_full(fold: Fold) -> dict[str, float]:
    return run_steps(tile(windows_of(fold), FULL_SIZE), EXACT, 8)


def part_views_fast(fold: Fold) -> dict[str, float]:
    return run_steps(tile(windows_of(fold), FULL_SIZE), FAST, 6)


def part_copies_share(fold: Fold) -> dict[str, float]:
    signals = read_signals(fold.train, channels=2)
    before = psutil.Process().memory_info().rss
    size = int(SHARE * FULL_SIZE / len(signals))
    windows, labels = materialise(
        [signal[:size] for signal in signals], [take.label or Touch.NONE for take in fold.train]
    )
    peak = peak_bytes() - before
    steps, began, seen = reference_steps(windows, labels, PaperNetwork()), 0.0, 0
    for number, count in enumerate(steps):
        began = began or time.process_time()
        seen += count * bool(number)
        if number and time.process_time() - began > 6:
            break
    # Stored alone, a window takes 4 kB; stacking, masking and joining hold copies at once.
    return {
        "rate": seen / (time.process_time() - began),
        "stored": FULL_SIZE * SIZE * 2 * 4,
        "full_peak": before + peak / SHARE,
    }


def part_views_score(fold: Fold) -> dict[str, Any]:
    windows, test = windows_of(fold), held_out(fold)
    run, spent, curve = Run(windows, FAST), 0.0, []
    began = time.process_time()
    for progress in run:
        if progress.steps % 10 == 0:
            spent += time.process_time() - began
            curve.append((spent, test.score(run.network)))
            began = time.process_time()
        if progress.steps == 250:
            break
    return {"curve": curve}


def part_copies_score(fold: Fold) -> dict[str, Any]:
    signals = read_signals(fold.train, channels=2)
    # Half of each recording: all of it would not fit beside the copies.
    halves = [signal[: len(signal) // 2] for signal in signals]
    windows, labels = materialise(halves, [take.label or Touch.NONE for take in fold.train])
    test, network, spent, curve = held_out(fold), PaperNetwork(), 0.0, []
    torch.manual_seed(0)
    began = time.process_time()
    for number, _ in enumerate(reference_steps(windows, labels, network)):
        if number % 10 == 9:
            spent += time.process_time() - began
            curve.append((spent, test.score(network)))
            if spent > PATIENCE:
                return {"curve": curve}
            began = time.process_time()
    raise AssertionError("the batches never end")


PARTS: dict[str, Callable[[Fold], dict[str, Any]]] = {
    "views_full": part_views_full,
    "views_fast": part_views_fast,
    "copies_share": part_copies_share,
    "views_score": part_views_score,
    "copies_score": part_copies_score,
}


def peak_bytes() -> int:
    status = Path("/proc/self/status").read_text()
    return 1024 * int(status.partition("VmHWM:")[2].split()[0])


def run_part(name: str, data: Path) -> dict[str, Any]:
    command = [sys.executable, __file__, "--part", name, "--data", str(data)]
    result: dict[str, Any] = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)
    return result


def make_set(folder: Path) -> Path:
    command = [sys.executable, "-m", "tactophone", "simulate", "dataset", str(folder), "--seconds", "4"]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    return folder


def table(data: Path) -> None:
    """Print each row as soon as it is measured: on a busy machine the last one takes a while."""
    print("| what | goal | materialised | on views | ratio |")
    print("|---|---|--:|--:|--:|", flush=True)
    share, full, fast = (run_part(name, data) for name in ("copies_share", "views_full", "views_fast"))
    print(
        f"| peak memory at the paper's full size, hop 1 | <= 1.5 GB | {share['full_peak'] / 1e9:.0f} GB (scaled from "
        f"{SHARE:.0%}; windows alone {share['stored'] / 1e9:.0f} GB) | {full['peak'] / 1e9:.2f} GB | |"
    )
    print(
        f"| windows a second and core, batches of 6000, float32 | | {share['rate']:.0f} | {full['rate']:.0f} | "
        f"{full['rate'] / share['rate']:.1f} |"
    )
    ratio = fast["rate"] / share["rate"]
    print(f"| the same, batches of 1000, bfloat16 | | | {fast['rate']:.0f} | {ratio:.1f} |", flush=True)
    copies, views = (run_part(name, data)["curve"] for name in ("copies_score", "views_score"))
    # Few surfaces make a noisy score: the level to reach is the median over the second half of the authors' curve.
    level = float(np.median([score for _, score in copies[len(copies) // 2 :]]))
    slow, quick = time_to(level, copies), time_to(level, views)
    print(
        f"| processor time to a held-out balanced accuracy of {level:.3f} | >= 8 times less | {slow:.0f} s | "
        f"{quick:.1f} s | {slow / quick:.1f} |"
    )


def time_to(level: float, curve: Sequence[tuple[float, float]]) -> float:
    """Time at which the median of three scores in a row reaches a level; infinite if it never does."""
    scores = [score for _, score in curve]
    return next((curve[n][0] for n in range(2, len(curve)) if np.median(scores[n - 2 : n + 1]) >= level), float("inf"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--data", type=Path, help="a two-channel data set (default: make one with the simulated finger)"
    )
    parser.add_argument("--part", choices=PARTS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.part:
        fold = split(open_dataset(args.data), "5-fold")[0]
        print(json.dumps({**PARTS[args.part](fold), "peak": peak_bytes()}))
        return
    with tempfile.TemporaryDirectory() as folder:
        table(args.data or make_set(Path(folder)))


if __name__ == "__main__":
    main()
