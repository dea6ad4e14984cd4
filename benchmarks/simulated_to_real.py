"""Does a classifier trained on simulated sound alone order real surfaces? Prints a table of the realism page.

    python benchmarks/simulated_to_real.py SIMULATED [SIMULATED ...]     (needs TACTOPHONE_RECORDINGS)

SIMULATED are sets of one tip, as ``tactophone simulate dataset DIR --objects all --seconds 4 --takes
long_medium,short_loud,wiggle --tip stylus`` renders them. Real: the ``lmt`` recordings, a steel stylus. Every run is a
look at a real score: enter it in docs/research/looks.md. The classifier is a logistic regression (C = 0.05) on the
texture features of the air channel without change detection; every surface weighs the same. It is trained twice: on the
windows over the contact microphone's floor, and on all in which the tip touches, heard or not.
"""

import argparse
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import balanced_accuracy_score, roc_auc_score

from tactophone.dataset import Recording, open_dataset
from tactophone.perception import BAND_COUNT, BAND_VALUES
from tactophone.training.features.examples import even_weights
from tactophone.training.features.feature_tracks import FeatureSpec, FeatureTrack, accumulate, extract_features
from tactophone.training.features.training_set import ALWAYS_DBFS, contact_threshold
from tactophone.types import Touch

Floats = NDArray[np.float64]

AUDIBLE_DB = 30.0
"""A real window is scored if it is at most this far under the take's loudest; simulated ones have ground truth."""

Gate = Literal["near the take's loudest", "over the floor", "all touch"]

C = 0.05

CLICKS, CREST = BAND_COUNT + 2, BAND_COUNT + 1

SPEC = FeatureSpec(channels=1, microphone="air", unevenness=True)
"""Features of a model for a hard tip."""

GROUPS = {
    "all": np.arange(2 * SPEC.values),
    "all but the treble's unevenness": np.delete(np.arange(2 * SPEC.values), [BAND_VALUES, SPEC.values + BAND_VALUES]),
    "crest and clicks": np.array([CREST, CLICKS, SPEC.values + CREST, SPEC.values + CLICKS]),
}
"""Columns of the features: means of 16 bands, 4 shapes and the unevenness, then their deviations."""

TREBLE = (3000.0, 7000.0)
"""Hz of the bands whose deviation is the treble's flicker."""


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Features ``(windows, 42)``, label and surface of each window."""

    features: Floats
    rough: NDArray[np.bool_]
    surface: NDArray[np.intp]

    @property
    def weights(self) -> Floats:
        return even_weights(self.rough, self.surface)


def windows_of(recordings: Sequence[Recording], gate: Gate) -> Windows:
    """Compute the features of all windows in contact, by ground truth and level."""
    tracks = extract_features(recordings, SPEC)
    floor = contact_threshold(tracks) if gate == "over the floor" else ALWAYS_DBFS
    real = gate == "near the take's loudest"
    kept = [_in_contact(track, track.level_dbfs.max() - AUDIBLE_DB if real else floor) for track in tracks]
    prior = _mean_moments(tracks, kept)
    names = sorted({track.recording.surface for track in tracks})
    rows, rough, surface = [], [], []
    for track, (mask, level) in zip(tracks, kept, strict=True):
        running = accumulate(track, level, np.zeros((1, SPEC.values, SPEC.values)))
        rows.append(running.features(prior, track.present)[mask])
        rough += [track.recording.label is Touch.ROUGH] * mask.sum()
        surface += [names.index(track.recording.surface)] * mask.sum()
    return Windows(np.concatenate(rows).astype(np.float64), np.array(rough), np.array(surface))


def _in_contact(track: FeatureTrack, level: float) -> tuple[NDArray[np.bool_], float]:
    return track.touching() & (track.level_dbfs >= level) & track.present[:, 0], level


def _mean_moments(tracks: Sequence[FeatureTrack], kept: Sequence[tuple[NDArray[np.bool_], float]]) -> Floats:
    wide = np.concatenate([track.description[mask] for track, (mask, _) in zip(tracks, kept, strict=True)])
    return np.stack((wide.mean(axis=0, dtype=float), np.square(wide, dtype=float).mean(axis=0)))


def score(train: Windows, test: Windows, columns: NDArray[np.intp]) -> tuple[float, float]:
    """AUC, and balanced accuracy at the boundary that training gave."""
    centre, scale = train.features.mean(axis=0), train.features.std(axis=0)
    model = LogisticRegression(C=C, max_iter=500)
    model.fit(((train.features - centre) / scale)[:, columns], train.rough, sample_weight=train.weights)
    logit = model.decision_function(((test.features - centre) / scale)[:, columns])
    auc = roc_auc_score(test.rough, logit, sample_weight=test.weights)
    return float(auc), float(balanced_accuracy_score(test.rough, logit > 0, sample_weight=test.weights))


def surface_means(windows: Windows) -> tuple[Floats, NDArray[np.bool_]]:
    """Mean features of each surface, and its label."""
    numbers = np.unique(windows.surface)
    means = np.array([windows.features[windows.surface == number].mean(axis=0) for number in numbers])
    return means, np.array([windows.rough[windows.surface == number][0] for number in numbers])


def separations(windows: Windows) -> Floats:
    """d' of each feature, rough less smooth, over the means of surfaces."""
    means, rough = surface_means(windows)
    spread = np.sqrt((means[rough].var(axis=0) + means[~rough].var(axis=0)) / 2)
    return np.asarray((means[rough].mean(axis=0) - means[~rough].mean(axis=0)) / np.maximum(spread, 1e-6))


def treble_columns() -> NDArray[np.intp]:
    """Deviations of the bands within `TREBLE`."""
    mel = np.linspace(*(2595 * np.log10(1 + np.array([40.0, 7600.0]) / 700)), BAND_COUNT + 2)[1:-1]
    centre = 700 * (10 ** (mel / 2595) - 1)
    return SPEC.values + np.flatnonzero((centre >= TREBLE[0]) & (centre <= TREBLE[1]))


def describe(name: str, windows: Windows) -> str:
    means, rough = surface_means(windows)
    separation = separations(windows)
    cells = [means[~rough, CLICKS].mean(), means[rough, CLICKS].mean()]
    cells += [means[~rough, CREST].mean(), means[rough, CREST].mean()]
    cells += [separation[CREST], separation[CLICKS], separation[treble_columns()].mean()]
    return f"| {name} | " + " | ".join(f"{cell:.2f}" for cell in cells) + " |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("simulated", type=Path, nargs="+")
    args = parser.parse_args()
    recordings = open_dataset(Path(os.environ["TACTOPHONE_RECORDINGS"], "lmt")).labelled().recordings
    tiers = {"core": ("core",), "core + extended": ("core", "extended")}
    real = {
        name: windows_of([r for r in recordings if r.tier in tier], "near the take's loudest")
        for name, tier in tiers.items()
    }
    sets = [open_dataset(folder).recordings for folder in args.simulated]
    gates: tuple[Gate, ...] = ("over the floor", "all touch")
    simulated = {gate: _together([windows_of(each, gate) for each in sets]) for gate in gates}
    columns = " | ".join(f"AUC, {name} | balanced accuracy" for name in real)
    print(f"| trained on windows | features | {columns} |\n|---|---|" + "--:|" * 4)
    for gate, train in simulated.items():
        for group, chosen in GROUPS.items():
            cells = [value for windows in real.values() for value in score(train, windows, chosen)]
            print(f"| {gate} | {group} | " + " | ".join(f"{cell:.3f}" for cell in cells) + " |")
    print(
        "\n| | clicks smooth | clicks rough | crest smooth | crest rough | d' crest | d' clicks | d' treble flicker |"
    )
    print("|---|" + "--:|" * 7)
    print("\n".join(describe(name, windows) for name, windows in (*real.items(), *simulated.items())))


def _together(sets: Sequence[Windows]) -> Windows:
    return Windows(
        np.concatenate([each.features for each in sets]),
        np.concatenate([each.rough for each in sets]),
        np.concatenate([each.surface + 1000 * k for k, each in enumerate(sets)]),
    )


if __name__ == "__main__":
    main()
