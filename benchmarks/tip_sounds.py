"""What touches of soft and of hard tips sound like: fits it, or scores how often a
wrong tip is noticed.

    python benchmarks/tip_sounds.py FOLDER ... --out TIPS.npz
    python benchmarks/tip_sounds.py FOLDER ... [--seconds 10]

A run is a session of a FOLDER that `tactophone simulate dataset` wrote, its takes one
after another. With TACTOPHONE_RECORDINGS, `lmt` is a stylus: the odd groups of
materials are fitted to, and the even ones scored; a run is three takes of a surface.
Scores count a run as noticed within ``--seconds`` of its sound, silences included, and
as a false alarm within all of it.
"""

import argparse
import os
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from tactophone.core.recordings.values import Recording
from tactophone.core.tips import TIPS
from tactophone.core.types import AudioBlock
from tactophone.signal.perception.detector import TouchDetector
from tactophone.signal.perception.fit import FitCheck, Misfit
from tactophone.signal.perception.models import open_touch_detector
from tactophone_lab.datasets.open import open_dataset

RIDGE_DB = 1.2
"""Standard deviation that is added to every value, for what the sets do not vary;
chosen in folds by kin."""

BLOCK = 4096

CERTAINLY_SMOOTH = (0.0, 1.0, 0.0)
"""What stands in for the model's answers, so that none is *undecided*."""

Floats = NDArray[np.float64]
Run = tuple[str, list[Recording]]
Verdicts = list[tuple[float, str]]


class Recorder(FitCheck):
    """Keeps the description at each verdict, and of how many windows it is."""

    def reset(self) -> None:
        super().reset()
        self.found: list[Floats] = []

    def _judge(self) -> Misfit | None:
        if self._heard().any():
            self.found.append(np.append(*self.description()))
        return None


def runs_of(folder: Path) -> list[Run]:
    """Return the tip and the takes of each run."""
    groups: dict[tuple[str, str], list[Recording]] = defaultdict(list)
    for take in sorted(
        open_dataset(folder).recordings, key=lambda take: take.path.name
    ):
        groups[take.surface, take.session].append(take)
    if folder.name != "lmt":
        return [(takes[0].known("tip"), takes) for takes in groups.values()]
    return [
        ("lmt", takes[first : first + 3])
        for takes in groups.values()
        for first in range(0, len(takes) - 2, 3)
    ]


def blocks(takes: list[Recording], channel: int | None) -> list[AudioBlock]:
    sound = np.concatenate([take.read().samples for take in takes])
    if channel is not None:
        sound = sound[:, [min(channel, sound.shape[1] - 1)]]
    rate = takes[0].read().sample_rate
    return [
        AudioBlock(sound[start : start + BLOCK], rate, start)
        for start in range(0, len(sound), BLOCK)
    ]


def listener(model: str, sound: list[AudioBlock]) -> TouchDetector:
    """Open a model that classifies nothing, which takes most of the time and changes no
    notice."""
    detector = open_touch_detector(
        model, sample_rate=sound[0].sample_rate, follow_floor=True
    )
    windows = detector.window_detector
    windows._engine.run = lambda sound, *_: (  # type: ignore[method-assign]
        [(CERTAINLY_SMOOTH, np.zeros(0, np.float32))] * len(sound)
    )
    windows.no_touch = None  # it reads features, of which there are none
    return detector


def describe(run: Run, model: str, channel: int | None) -> Floats:
    """Return the descriptions of a run, ``(verdicts, values and number of windows)``,
    with one channel or both."""
    sound = blocks(run[1], channel)
    detector = listener(model, sound)
    windows = detector.window_detector
    recorder = windows.fit = Recorder(
        model, windows.card.sample_rate, air=windows.card.microphone == "air"
    )
    for block in sound:
        detector.push(block)
    return np.array(recorder.found)


def notices(run: Run, tip: str) -> Verdicts:
    """Return when, in s, and by which code something is noticed under a tip's model."""
    sound = blocks(run[1], None)
    detector = listener(TIPS[tip].model, sound)
    found: Verdicts = []
    for block in sound:
        detector.push(block)
        if misfit := detector.misfit:
            found.append((block.end / block.sample_rate, misfit.code))
    return found


def described(run: Run) -> list[tuple[str, Floats]]:
    """Return the descriptions for both microphones, for one of a soft tip's model, and
    for one of a hard one's."""
    tip, found = run[0], []
    if tip != "lmt":
        found.append(("both", describe(run, "texture", None)))
    found.append(
        ("contact", describe(run, "texture", int(tip not in TIPS or TIPS[tip].hard)))
    )
    found.append(("air", describe(run, "stylus", None)))
    return [
        (f"{microphones} {tip}", values) for microphones, values in found if len(values)
    ]


def fit(runs: list[Run], out: Path) -> None:
    found: dict[str, list[Floats]] = defaultdict(list)
    with ProcessPoolExecutor(2) as pool:
        for each in pool.map(described, runs):
            for name, values in each:
                found[name].append(values)
    arrays: dict[str, Floats] = {}
    for microphones in ("both", "contact", "air"):
        tips = [
            found[f"{microphones} {tip}"]
            for tip in (*TIPS, "lmt")
            if f"{microphones} {tip}" in found
        ]
        arrays |= {
            f"{microphones}-{name}": fitted.astype(np.float32)
            for name, fitted in gaussians(tips).items()
        }
    np.savez_compressed(out, **arrays)  # type: ignore[arg-type]


def gaussians(tips: list[list[Floats]]) -> dict[str, Floats]:
    """Return the means of each tip's runs, and the covariance of all, which
    grows from its value for long runs the fewer windows a run has.

    Each run and each tip weighs the same. A straight line in ``1 / windows`` is fitted
    to the products of deviations.
    """
    means, off, weights = [], [], []
    for runs in tips:
        values = np.concatenate(runs)
        weight = np.concatenate(
            [np.full(len(run), 1 / len(run) / len(runs) / len(tips)) for run in runs]
        )
        means.append(np.average(values[:, :-1], axis=0, weights=weight))
        off.append(np.column_stack((values[:, :-1] - means[-1], values[:, -1])))
        weights.append(weight)
    deviations, part, weight = (
        np.concatenate(off)[:, :-1],
        1 / np.concatenate(off)[:, -1],
        np.concatenate(weights),
    )
    moments = [
        (deviations.T * weight * power) @ deviations
        for power in (np.ones_like(part), part)
    ]
    line = np.linalg.inv(
        [[weight.sum(), weight @ part], [weight @ part, weight @ part**2]]
    )
    between, within = (_positive(np.tensordot(row, moments, 1)) for row in line)
    between += RIDGE_DB**2 * np.eye(len(between))
    spread, basis = scipy.linalg.eigh(within, between)
    return {"means": np.array(means), "basis": basis, "within": np.maximum(spread, 0)}


def _positive(matrix: Floats) -> Floats:
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.maximum(values, 0)) @ vectors.T)


def score(runs: list[Run], seconds: float) -> None:
    tips = tuple(TIPS)
    jobs = [(run, tip) for run in runs for tip in tips]
    counts: dict[tuple[str, str], list[tuple[bool, bool, bool]]] = defaultdict(list)
    with ProcessPoolExecutor(2) as pool:
        for (run, tip), found in zip(
            jobs, pool.map(notices, *zip(*jobs, strict=True)), strict=True
        ):
            times = [time for time, code in found if code == "other-tip"]
            counts[run[0], tip].append(
                (min(times, default=np.inf) <= seconds, bool(times), bool(found))
            )
    print(
        f"Runs in which a wrong tip is noticed within {seconds:g} s, and in all of the "
        "run; in brackets, those in which anything is.\n"
    )
    print(f"| sound, `--tip` | {' | '.join(tips)} |\n|---|{'--:|' * len(tips)}")
    for sound in sorted({name for name, _ in counts}):
        cells = []
        for tip in tips:
            soon, ever, anything = np.sum(counts[sound, tip], axis=0)
            cells.append(f"{soon}, {ever} of {len(counts[sound, tip])} ({anything})")
        print(f"| {sound} | {' | '.join(cells)} |")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folders", type=Path, nargs="+", help="simulated sets")
    parser.add_argument(
        "--out", type=Path, metavar="TIPS.npz", help="fit, and write this file"
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=10.0,
        help="within which a run is noticed (default: 10)",
    )
    args = parser.parse_args()
    runs = [run for folder in args.folders for run in runs_of(folder)]
    if root := os.environ.get("TACTOPHONE_RECORDINGS"):
        real = runs_of(Path(root, "lmt"))
        runs += [run for run in real if int(run[1][0].surface[1]) % 2 == bool(args.out)]
    if args.out:
        fit(runs, args.out)
    else:
        score(runs, args.seconds)


if __name__ == "__main__":
    main()
