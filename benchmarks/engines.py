"""What the paper's network takes on either engine, and how often the two decide differently.

    python benchmarks/engines.py [--model NAME|FILE] [--data FOLDER]

Both are asked in turn, once every 10.67 ms, as a live system does, so that caches are as cold as in use. With a data
set (as many channels as the model), every hop of its recordings is judged by both.
"""

import argparse
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import soundfile

from tactophone.dataset import open_dataset
from tactophone.perception import model_path, read_model, rough_share
from tactophone.perception.features.loudness import LOUDNESS
from tactophone.perception.features.resample import Resampler
from tactophone.perception.features.spectrum import magnitudes
from tactophone.perception.features.windows import Windower
from tactophone.perception.inference.engine import Engine, OnnxEngine
from tactophone.perception.inference.litert import open_litert
from tactophone.perception.model_file import ModelCard
from tactophone.types import CONTACT, FloatArray

HOP = 512 / 48_000
UPDATES = 600


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", default="paper", help="a model of the paper's kind; default: the shipped one")
    parser.add_argument("--data", type=Path, help="a data set")
    args = parser.parse_args()
    model = read_model(model_path(args.model))
    fast = open_litert(model.content)
    if fast is None:
        parser.exit(
            1, "LiteRT is not installed (pip install 'tactophone[litert]'), or the network is not the paper's\n"
        )
    sure = OnnxEngine(model.session)
    print(f"Model `{args.model}`, its network alone, {UPDATES} updates at a hop of {1000 * HOP:.2f} ms.\n")
    print("| engine | median | p99 |\n|---|--:|--:|")
    for name, times in zip(("ONNX Runtime", "LiteRT"), paced((sure, fast), width=sure.width), strict=True):
        print("| {} | {:.2f} ms | {:.2f} ms |".format(name, *np.percentile(times, (50, 99)) * 1e3))
    if args.data:
        print_differences(sure, fast, card=model.card, data=args.data)


def paced(engines: tuple[Engine, Engine], *, width: int) -> Any:
    """Ask one engine after the other, an update each; give the seconds that each took."""
    features = np.random.default_rng(0).exponential(1.0, (2 * UPDATES, width)).astype(np.float32)
    times = np.empty(2 * UPDATES)
    due = time.perf_counter()
    for n, row in enumerate(features):
        due += HOP
        time.sleep(max(0.0, due - time.perf_counter()))
        began = time.perf_counter()
        engines[n % 2].ask(row)
        times[n] = time.perf_counter() - began
    return times.reshape(-1, 2)[5:].T


def print_differences(sure: Engine, fast: Engine, *, card: ModelCard, data: Path) -> None:
    recordings = open_dataset(data).recordings
    answers = [
        (rough_share(sure.ask(features)), rough_share(fast.ask(features)))
        for recording in recordings
        for features in in_contact(recording.path, card)
    ]
    ours, theirs = np.array(answers).T
    changed = np.mean((ours >= 0.5) != (theirs >= 0.5))
    print(f"\n{len(recordings)} recordings, {len(answers)} windows in contact: {changed:.2%} are decided differently,")
    print(f"and the share of rough differs by {np.abs(ours - theirs).mean():.4f} on average.")


def in_contact(path: Path, card: ModelCard) -> Iterator[FloatArray]:
    """Give the features of each window that is as loud as contact."""
    sound, rate = soundfile.read(path, dtype="float32", always_2d=True)
    samples = Resampler(rate, card.sample_rate, channels=card.channels).push(sound[:, : card.channels])
    for _, window in Windower(card.window_size, card.hop, channels=card.channels).push(samples):
        if LOUDNESS[card.gate.rule](window[:, CONTACT]) >= card.gate.threshold_dbfs:
            yield magnitudes(window)


if __name__ == "__main__":
    main()
