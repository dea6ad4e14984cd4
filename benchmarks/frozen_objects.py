"""What the texture detector takes for rough on the ten frozen objects, at the recall of
the paper's network.

    make sets && python benchmarks/frozen_objects.py build/sets/pad-test

Single windows in true contact, two-class rule, as `make scores`; *linoleum* is its
share at the model's own threshold. Below, what is rendered of rough objects, also where
their touch is over the take's own contact threshold (*audible*).
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tactophone.core.recordings.values import Recording
from tactophone.core.types import Touch
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone.signal.perception.noise_floor import measure_floor
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.bumps_and_delays import decided_touches
from tactophone_lab.evaluation.metrics import false_positives_at_recall, measure
from tactophone_lab.evaluation.predict import (
    in_true_contact,
    recording_predictor,
    scores_of,
    true_contact,
)
from tactophone_lab.training.recipe_options import FeatureSpec
from tactophone_lab.training.tracks import extract_features

REFERENCE = "paper"

LINOLEUM = "linoleum"
"""The smooth object that is taken for rough most."""


def main() -> None:
    """Print a row for each model."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="the frozen objects under the pad")
    dataset = parser.parse_args().dataset
    recordings = open_dataset(dataset).labelled().recordings
    if LINOLEUM not in {take.surface for take in recordings}:
        sys.exit(
            f"{dataset}: has no {LINOLEUM}, object 30; `make sets` renders the frozen "
            "objects"
        )
    scores = {}
    for name in (REFERENCE, "texture"):
        predict = recording_predictor(name)
        scores[name] = scores_of(
            [in_true_contact(predict(take)) for take in recordings], "two-class"
        )
    recall = measure(scores[REFERENCE])["rough_accuracy"]
    print(
        f"| smooth as rough | at {REFERENCE}'s recall of {recall:.3f} | at the model's "
        f"own threshold | {LINOLEUM} alone |"
    )
    print("|---|--:|--:|--:|")
    for name, found in scores.items():
        linoleum = found.surface == found.names.index(LINOLEUM)
        own = measure(found)["false_positive_rate"]
        rough = (found.score[linoleum] >= 0.5).mean()
        print(
            f"| {name} | {false_positives_at_recall(found, recall):.3f} | {own:.3f} | "
            f"{rough:.3f} |"
        )
    print_rendered(recordings)


def print_rendered(recordings: Sequence[Recording]) -> None:
    """Print how much rough is rendered as rough, in all of true contact and where it is
    audible."""
    model = read_model(model_path("texture"))
    predict, rough = recording_predictor(model), np.zeros((2, 2), int)
    for recording in (each for each in recordings if each.rough):
        take, sound = predict(recording), recording.read(channels=1)
        floor = measure_floor([sound], sample_rate=sound.sample_rate, rule="banded")
        (track,) = extract_features([recording], FeatureSpec())
        # Training undoes the gain that a set was rendered with, the live system does
        # not.
        level = track.level_dbfs + float(recording.known("gain_db") or 0)
        newest = np.searchsorted(track.end, take.time - 1e-6).clip(max=len(level) - 1)
        touching, audible = true_contact(take), level[newest] >= floor.threshold_dbfs
        right = decided_touches(take, model.card.decision) == Touch.ROUGH
        for place in (0, 1):
            rough[place] += np.bincount(
                right[touching & (audible == place)], minlength=2
            )
    print("\n| rough objects | share of contact | rendered as rough |\n|---|--:|--:|")
    for words, (wrong, right) in (
        ("all of true contact", rough.sum(axis=0)),
        ("audible", rough[1]),
        ("not audible", rough[0]),
    ):
        share = (wrong + right) / rough.sum()
        print(f"| {words} | {share:.2f} | {right / max(wrong + right, 1):.2f} |")


if __name__ == "__main__":
    main()
