"""False rough where the finger slips off a smooth stone onto what is under it, as on the paper's second day.

    tactophone simulate competition RUNS
    python benchmarks/slips.py RUNS [MODEL ...]

A slip ends a touch of a smooth stone on the ground, without a lift. *Bumps*: slips with rough rendered within 0.4 s.
"""

import argparse
import itertools
from pathlib import Path

import numpy as np

from tactophone.core.types import Touch
from tactophone.lab.dataset.read import open_dataset
from tactophone.lab.dataset.values import Recording
from tactophone.lab.evaluation.predict import model_predictor
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path

AFTER = 0.4
"""Seconds: a window of 256 ms and the fall."""


def slips_of(recording: Recording) -> list[float]:
    """Return when the finger slips off a smooth stone, in s."""
    pairs = itertools.pairwise(recording.segments)
    return [a.end for a, b in pairs if a.label is Touch.SMOOTH and b.label is None and b.start - a.end < 0.05]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", type=Path)
    parser.add_argument("models", nargs="*", default=["texture", "paper", "paper-mono"])
    args = parser.parse_args()
    runs = open_dataset(args.runs).recordings
    print("| model | slips off smooth stones | bumps |\n|---|--:|--:|")
    for name in args.models:
        predict = model_predictor(read_model(model_path(name)), own_floor=True)
        felt = []
        for run in runs:
            take = predict(run)
            assert take.touch is not None
            rough = take.time[take.touch == Touch.ROUGH]
            felt += [bool(np.any((rough > slip) & (rough < slip + AFTER))) for slip in slips_of(run)]
        print(f"| {name} | {len(felt)} | {sum(felt)} |")


if __name__ == "__main__":
    main()
