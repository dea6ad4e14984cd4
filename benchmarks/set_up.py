"""How good is a detector after a minute with a new finger? Prints the table of docs/research/set-up.md.

    python benchmarks/set_up.py --model FILE [--lmt DIR] [--draws 40]

Each draw takes one or two smooth and as many rough surfaces of real sound (`lmt`), three takes of 4.8 s each, fits the
boundary as `tactophone setup` does, and scores six takes of all surfaces that are neither drawn nor kin of those drawn.
Draws differ; where there are no more than asked for, all are scored.
FILE is a model of one air microphone that has never been trained on these recordings.
"""

import argparse
import csv
import os
from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import combinations, product
from pathlib import Path

import numpy as np

from tactophone.capture.files import FileSource
from tactophone.perception.model_file import Model, read_model
from tactophone.perception.noise_floor import measure_floor
from tactophone.training.setup import SCORES, ObjectSound, collect, fit_boundary, fit_set_up

TRAIN, TEST = 3, 6
"""Takes of a surface that are fitted to, and that are scored."""

KIN = ("RhombAluminumMesh", "StoneTile", "SolidRubberPlate", "Cardboard")
"""Surfaces of the same thing."""

Surfaces = Mapping[tuple[str, bool, str], Sequence[ObjectSound]]


def kin_of(surface: str) -> str:
    """Return the thing that a surface is a version of."""
    return next((kin for kin in KIN if kin in surface), surface)


def read_surfaces(folder: Path, model: Model) -> Surfaces:
    """Read six takes of each labelled surface."""
    surfaces: dict[tuple[str, bool, str], list[ObjectSound]] = defaultdict(list)
    with (folder / "manifest.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["tier"] != "other" and int(row["recording"]) <= TEST]
    for row in rows:
        with FileSource(folder / row["file"]) as source:
            blocks, rate = list(source), source.sample_rate
        floor = measure_floor(blocks, sample_rate=rate, rule=model.card.gate.rule)
        samples, rough = np.concatenate([block.samples for block in blocks]), row["label"] == "rough"
        sound = collect(
            model, samples, sample_rate=rate, threshold_dbfs=floor.threshold_dbfs, name=row["surface"], rough=rough
        )
        surfaces[row["surface"], rough, row["tier"]].append(sound)
    return surfaces


def joined(takes: Sequence[ObjectSound]) -> ObjectSound:
    """Join takes of one surface."""
    features, logit = (np.concatenate([getattr(take, name) for take in takes]) for name in ("features", "logit"))
    return ObjectSound(takes[0].name, takes[0].rough, features, logit)


def draw(surfaces: Surfaces, per_class: int, count: int) -> list[tuple[list[ObjectSound], list[ObjectSound]]]:
    """Return draws of fitted surfaces and of those to score; of kin one at most is drawn."""
    classes = [combinations([key for key in surfaces if key[1] is rough], per_class) for rough in (True, False)]
    draws = []
    for chosen in (smooth + rough for rough, smooth in product(*classes)):
        kin = {kin_of(key[0]) for key in chosen}
        rest = [key for key in surfaces if kin_of(key[0]) not in kin]
        if len(kin) == len(chosen) and len({key[1] for key in rest}) == 2:
            draws.append((chosen, rest))
    picked = np.random.default_rng(0).permutation(len(draws))[:count]
    return [
        ([joined(surfaces[key][:TRAIN]) for key in chosen], [joined(surfaces[key]) for key in rest])
        for chosen, rest in (draws[at] for at in picked)
    ]


def balanced(logits: Sequence[np.ndarray], sounds: Sequence[ObjectSound]) -> float:
    """Return the mean over both classes of the surfaces' shares of right windows."""
    shares: dict[bool, list[float]] = {False: [], True: []}
    for logit, sound in zip(logits, sounds, strict=True):
        shares[sound.rough].append(float(np.mean((logit > 0) == sound.rough)))
    return float(np.mean([np.mean(shares[False]), np.mean(shares[True])]))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", type=Path, required=True)
    recordings = os.environ.get("TACTOPHONE_RECORDINGS", "")
    parser.add_argument("--lmt", type=Path, default=Path(recordings) / "lmt")
    parser.add_argument("--draws", type=int, default=40)
    args = parser.parse_args()
    model = read_model(args.model)
    everything = read_surfaces(args.lmt, model)
    core = {key: takes for key, takes in everything.items() if key[2] == "core"}
    print("| surfaces | sound | draws | before | `setup` | " + " | ".join(f"always {name}" for name in SCORES) + " |")
    print("|---|---|--:|--:|--:|" + "--:|" * len(SCORES))
    for name, surfaces in (("core", core), ("core + extended", everything)):
        for per_class, seconds in ((2, 58), (1, 29)):
            columns: dict[str, list[float]] = defaultdict(list)
            for sounds, rest in draw(surfaces, per_class, args.draws):
                columns["before"].append(balanced([sound.logit for sound in rest], rest))
                chosen = fit_set_up(sounds, channels=1, tip="stylus").correction
                columns["setup"].append(balanced([chosen.logit(sound) for sound in rest], rest))
                for score in SCORES:
                    fixed = fit_boundary(sounds, score, channels=1)
                    columns[score].append(balanced([fixed.logit(sound) for sound in rest], rest))
            cells = [f"{np.median(values):.2f}, {min(values):.2f}" for values in columns.values()]
            print(f"| {name} | {seconds} s | {len(columns['before'])} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
