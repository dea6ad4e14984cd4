"""What `tactophone feel --tip stylus` renders of real kinds that its model was not
trained on.

    python benchmarks/rendered_real.py [SIMULATED ...] [--distorted [GROUP ...]]

(needs TACTOPHONE_RECORDINGS; trains a model for each kind, some minutes each)

For each kind of `lmt` (``lmt_kin.csv``; or each surface) a model is trained on the
other kinds, core and extended, and on SIMULATED sets of the stylus, as `make model`
trains the shipped one; its takes then pass through the pipeline of `feel`, with the
gate's threshold from each take itself. *Right*: share of the time within 30 dB of the
take's loudest that is rendered as its label. A line says how often *unknown*
predictions and the others are wrong, core and all, and how well probabilities are
calibrated, beside what perfect calibration would measure on as few surfaces. With
``--distorted`` the kept takes pass besides through channels of `distortions`, which
nothing is trained on: the ten, or all in each GROUP (``ten``, ``development``,
``kept``). ``--takes`` scores the first N of each surface alone; all are trained on.

**The rule for a change.** ``--save`` writes the shares of each surface and channel.
After a change of head, feature or penalty, ``--against`` compares with such a file, by
a paired bootstrap over *surfaces*: windows and takes of a surface are right or wrong
together. The change is kept only if the whole 90 % interval of its gain lies over 0;
else the older design stays.
"""

import argparse
import json
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distortions import GROUPS, distorted, real_recordings
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import Touch
from tactophone.signal.perception.model_file import Model, read_model
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import kin_of, with_kin
from tactophone_lab.evaluation.bumps_and_delays import (
    calibration_error,
    decided_touches,
)
from tactophone_lab.evaluation.metrics import rough_score
from tactophone_lab.evaluation.predict import TakePredictions, recording_predictor
from tactophone_lab.evaluation.scores import unknown_shares
from tactophone_lab.training.recipe_options import FeatureSpec, TrainingOptions
from tactophone_lab.training.recipes import configure
from tactophone_lab.training.tracks import extract_features

AUDIBLE_DB = 30.0

AS_IT_IS = "as it is"

Counts = dict[str, NDArray[np.int64]]
"""Windows of each surface that are rendered as nothing, smooth and rough."""

OPTIONS = TrainingOptions(channels=1, microphone="air", tip="stylus")


def train(recordings: list[Recording], dataset: Dataset, folder: Path) -> Model:
    """Train the recipe ``texture`` as the shipped model of the stylus."""
    path = folder / "stylus.onnx"
    configure("texture", OPTIONS).train(
        path, replace(dataset, recordings=tuple(recordings))
    )
    return read_model(path)


def rendered(
    model: Model, recording: Recording, take: TakePredictions
) -> NDArray[np.int8]:
    """Return what is rendered while the recording is at most `AUDIBLE_DB` under its
    loudest."""
    (track,) = extract_features([recording], FeatureSpec(channels=1, microphone="air"))
    audible = track.end[track.level_dbfs >= track.level_dbfs.max() - AUDIBLE_DB]
    # The newest prediction at the end of each audible window.
    newest = np.searchsorted(take.time, audible + 1e-6) - 1
    return np.asarray(decided_touches(take, model.card.decision)[newest])


def left_out(
    real: Dataset,
    simulated: Sequence[Recording],
    group: Callable[[Recording], str],
    folder: Path,
) -> Iterator[tuple[Model, list[Recording]]]:
    """Yield for each group a model that is trained on the others, and the recordings of
    the group."""
    for name in sorted({group(take) for take in real.recordings}):
        kept = [take for take in real.recordings if group(take) != name]
        yield (
            train([*kept, *simulated], real, folder),
            [take for take in real.recordings if group(take) == name],
        )


def read_real() -> Dataset:
    """Read the labelled surfaces of `lmt`, core and extended, with their kin."""
    real = with_kin(
        open_dataset(real_recordings("lmt")),
        Path(__file__).with_name("lmt_kin.csv"),
    )
    return real.where(lambda take: take.tier in ("core", "extended")).labelled()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "simulated", type=Path, nargs="*", help="sets that are trained on too"
    )
    parser.add_argument(
        "--by",
        choices=("kin", "surface"),
        default="kin",
        help="what is left out (default: %(default)s)",
    )
    parser.add_argument(
        "--distorted",
        nargs="*",
        choices=GROUPS,
        metavar="GROUP",
        help=f"of {', '.join(GROUPS)} (default: ten)",
    )
    parser.add_argument(
        "--takes",
        type=int,
        default=1000,
        metavar="N",
        help="of each surface that are scored (default: all)",
    )
    parser.add_argument(
        "--save", type=Path, metavar="FILE", help="write the shares of each surface"
    )
    parser.add_argument(
        "--against", type=Path, metavar="FILE", help="compare with such a file"
    )
    args = parser.parse_args()
    older = json.loads(args.against.read_text()) if args.against else None
    real = read_real()
    simulated = [
        take for folder in args.simulated for take in open_dataset(folder).recordings
    ]
    group = kin_of if args.by == "kin" else (lambda take: take.surface)
    groups = ["ten"] if args.distorted == [] else args.distorted or []
    channels = [AS_IT_IS, *(name for group in groups for name in GROUPS[group])]
    counts: dict[str, Counts] = {
        name: defaultdict(lambda: np.zeros(3, np.int64)) for name in channels
    }
    plain: list[TakePredictions] = []
    with tempfile.TemporaryDirectory() as folder:
        for model, takes in left_out(real, simulated, group, Path(folder)):
            predict = recording_predictor(model)
            for take in takes:
                if int(take.take or 0) <= args.takes:
                    for name in channels:
                        heard = (
                            take
                            if name == AS_IT_IS
                            else distorted(take, name, Path(folder))
                        )
                        found = predict(heard)
                        plain += [found] if name == AS_IT_IS else []
                        counts[name][take.surface] += np.bincount(
                            rendered(model, take, found), minlength=3
                        )
    print_surfaces(real, counts[AS_IT_IS])
    print_channels(real, counts, groups)
    print_calibration(plain)
    shares = right_shares(real, counts)
    if args.save:
        args.save.write_text(json.dumps(shares))
    if older is not None:
        print_gain(real, shares, older)


Shares = Mapping[str, Mapping[str, float]]
"""By channel and surface: how much of the time is rendered as the surface's label."""


def right_shares(real: Dataset, counts: Mapping[str, Counts]) -> Shares:
    label = {take.surface: take.label or 0 for take in real.recordings}
    return {
        channel: {
            name: float(count[label[name]] / count.sum())
            for name, count in of_surface.items()
        }
        for channel, of_surface in counts.items()
    }


def paired_gain(
    rough: NDArray[np.bool_], gains: NDArray[np.float64], draws: int = 10_000
) -> tuple[float, float, float]:
    """Return the gain in balanced share and its 90 % interval, over surfaces drawn anew
    in either class."""
    rng = np.random.default_rng(0)
    classes = [gains[rough], gains[~rough]]
    drawn = np.mean(
        [
            each[rng.integers(len(each), size=(draws, len(each)))].mean(axis=1)
            for each in classes
        ],
        axis=0,
    )
    return float(np.mean([each.mean() for each in classes])), *np.percentile(
        drawn, [5, 95]
    ).tolist()


def print_gain(real: Dataset, shares: Shares, older: Shares) -> None:
    """Print by how much these shares are over older ones, as it is and in the mean of
    all channels, and the verdict."""
    first = {take.surface: take for take in reversed(real.recordings)}
    print(
        "\n| against the older design | gain | 90 % over surfaces | kept "
        "|\n|---|--:|--:|---|"
    )
    for words, channels in (
        (AS_IT_IS, [AS_IT_IS]),
        ("mean of all channels", list(shares)),
    ):
        for tiers in (("core",), ("core", "extended")):
            names = sorted(
                name for name in shares[AS_IT_IS] if first[name].tier in tiers
            )
            rough = np.array([first[name].label is Touch.ROUGH for name in names])
            gains = [
                np.mean([shares[each][name] - older[each][name] for each in channels])
                for name in names
            ]
            gain, low, high = paired_gain(rough, np.array(gains))
            verdict = "yes" if low > 0 else "no"
            print(
                f"| {words}, {' and '.join(tiers)} | {gain:+.3f} | {low:+.3f} to "
                f"{high:+.3f} | {verdict} |"
            )


def print_calibration(plain: Sequence[TakePredictions]) -> None:
    print()
    for tiers in (("core",), ("core", "extended")):
        takes = [each for each in plain if each.recording.tier in tiers]
        shares, errors = (
            unknown_shares(takes),
            (calibration_error(takes), *perfect_errors(takes)),
        )
        print(
            "{}: unknown {:.3f}, wrong {:.3f} of that and {:.3f} of the rest".format(
                " and ".join(tiers), *shares
            )
        )
        print(
            "calibration error {:.3f}; were the probabilities right {:.3f}, "
            "90 %: {:.3f} to {:.3f}".format(*errors)
        )


def perfect_errors(takes: list[TakePredictions]) -> tuple[float, float, float]:
    """Return what the calibration error would be if the probabilities were right: mean,
    5th and 95th percentile.

    All windows of a surface share one class. So each surface's class is drawn, 500
    times, by its mean P(rough).
    """
    rng = np.random.default_rng(0)
    of_surface = defaultdict(list)
    for take in takes:
        of_surface[take.recording.surface].append(
            rough_score(take.probabilities[take.contact], "two-class")
        )
    means = {name: np.concatenate(scores).mean() for name, scores in of_surface.items()}
    errors = []
    for _ in range(500):
        drawn = {
            name: Touch.ROUGH if rng.random() < mean else Touch.SMOOTH
            for name, mean in means.items()
        }
        errors.append(
            calibration_error(
                replace(
                    take,
                    recording=replace(
                        take.recording, label=drawn[take.recording.surface]
                    ),
                )
                for take in takes
            )
        )
    return float(np.mean(errors)), *np.percentile(errors, [5, 95]).tolist()


def print_surfaces(real: Dataset, counts: Counts) -> None:
    """Print the shares of each surface."""
    first = {take.surface: take for take in reversed(real.recordings)}
    print("| surface | label | right | nothing rendered |\n|---|---|--:|--:|")
    for name in sorted(counts, key=lambda name: (first[name].tier, name)):
        right, gap = (
            counts[name][touch] / counts[name].sum()
            for touch in (first[name].label or 0, Touch.NONE)
        )
        print(
            f"| {name} | {Touch(first[name].label or 0).name.lower()} | {right:.2f} | "
            f"{gap:.3f} |"
        )


def print_channels(real: Dataset, counts: dict[str, Counts], groups: list[str]) -> None:
    """Print the balanced shares that are right through each channel, of core and of
    all; then the groups' means."""
    first = {take.surface: take for take in reversed(real.recordings)}
    print(
        "\n| channel | core: balanced (right) | all: balanced (right) | nothing "
        "rendered |\n|---|--:|--:|--:|"
    )
    table = {}
    for channel, of_surface in counts.items():
        row = []
        for tiers in (("core",), ("core", "extended")):
            names = [name for name in of_surface if first[name].tier in tiers]
            rough = np.array([first[name].label is Touch.ROUGH for name in names])
            share = np.array(
                [
                    of_surface[name][first[name].label or 0] / of_surface[name].sum()
                    for name in names
                ]
            )
            row += [(share[rough].mean() + share[~rough].mean()) / 2, share.mean()]
        row.append(
            float(
                np.mean(
                    [count[Touch.NONE] / count.sum() for count in of_surface.values()]
                )
            )
        )
        table[channel] = row
    for group in groups:
        table[f"mean: {group}"] = list(
            np.mean([table[name] for name in GROUPS[group]], axis=0)
        )
    for channel, row in table.items():
        print(
            "| {} | {:.3f} ({:.3f}) | {:.3f} ({:.3f}) | {:.3f} |".format(channel, *row)
        )


if __name__ == "__main__":
    main()
