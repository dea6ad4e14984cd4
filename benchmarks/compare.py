"""How often the rougher of two objects is drawn the stronger, through one microphone.

    python benchmarks/compare.py [SIMULATED ...] [--distorted [GROUP ...]]

(needs TACTOPHONE_RECORDINGS; trains a model for each kind, some minutes each)

Models are trained and recordings distorted as by `rendered_real.py`: each kind of `lmt`
left out in turn. Touches of 1.2 s, one a second, are compared in pairs of a rough and a
smooth surface of other kinds. What is compared is the *drawn vibration*, the mean over
the touch of its level over threshold and of its pitch, in just-noticeable differences
(`signal.haptics.psychophysics`): the pair is right if the rough one is stronger and the
two are at least one difference apart. Beside it stands the same for the mean logit,
which need only be the higher.

**The rule for the default profile**, written before the kept channels were scored:
`graded` is the default if the whole 90 % interval of its gain over `paper`, in the mean
of the channels on core, lies over 0; surfaces are drawn anew. Its lower end is 0
exactly, so the rule is not met. `graded` stays the default all the same: no core pair
loses, and on all 17 the interval lies over 0.
"""

import argparse
import math
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distortions import GROUPS, distorted
from rendered_real import AS_IT_IS, left_out, read_real
from tactophone.app.recordings import open_recording
from tactophone.core.recordings.values import Recording
from tactophone.core.types import Prediction, Touch
from tactophone.signal.haptics.profiles import open_profile
from tactophone.signal.haptics.psychophysics import (
    LEVEL_JND_DB,
    PITCH_JND,
    sensation_db,
)
from tactophone.signal.perception.model_file import Model
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import kin_of

FIRST = 0.6
"""When the first touch begins, in s."""

SPACING = 1.0
"""From the beginning of one touch to the next, in s."""

DURATION = 1.2
"""How long each touch lasts, in s."""

LOGIT = "mean logit"

Floats = NDArray[np.float64]

Touches = dict[str, list[tuple[float, float]]]
"""By profile: level and pitch of each touch, in just-noticeable differences; of
`LOGIT`, the logit and 0."""


def predictions_of(model: Model, recording: Recording) -> list[Prediction]:
    """Return the predictions of `feel`."""
    return [
        prediction
        for step in open_recording(recording.path, model).steps()
        for prediction in step.predictions
    ]


def touches_of(predictions: Sequence[Prediction], profiles: Iterable[str]) -> Touches:
    """Cut a recording into touches, each drawn by itself: the finger lifts between two
    objects."""
    found: Touches = defaultdict(list)
    for first in np.arange(FIRST, predictions[-1].end - DURATION, SPACING):
        part = [
            each
            for each in predictions
            if first <= each.end < first + DURATION and each.touch is not Touch.NONE
        ]
        if not part:
            continue
        logits = [
            math.log((each.probabilities[2] + 1e-7) / (each.probabilities[1] + 1e-7))
            for each in part
        ]
        found[LOGIT].append((float(np.mean(logits)), 0.0))
        for name in profiles:
            profile = open_profile(name)
            commands = [profile.command(each) for each in part]
            level = (
                np.mean(
                    [sensation_db(each.amplitude, each.frequency) for each in commands]
                )
                / LEVEL_JND_DB
            )
            pitch = np.mean(
                [math.log(each.frequency) for each in commands]
            ) / math.log1p(PITCH_JND)
            found[name].append((float(level), float(pitch)))
    return found


def right(rough: Floats, smooth: Floats, least: float) -> float:
    """Return the share of pairs in which the rough touch is the stronger by ``least``
    differences."""
    apart = rough[:, None] - smooth[None]
    return float(
        ((apart[..., 0] > 0) & (np.hypot(*np.moveaxis(apart, -1, 0)) >= least)).mean()
    )


def pairs_right(
    found: dict[str, Touches], profile: str, rough: list[str], smooth: list[str]
) -> Floats:
    """Return the share that is right for each pair of a rough and a smooth surface."""
    least = 0.0 if profile == LOGIT else 1.0
    touches = [
        [np.array(found[name][profile]) for name in names] for names in (rough, smooth)
    ]
    return np.array(
        [[right(one, other, least) for other in touches[1]] for one in touches[0]]
    )


def mean_of(shares: Floats, others: NDArray[np.bool_]) -> float:
    """Return the mean over pairs of surfaces of other kinds."""
    return float(shares[others].mean())


def interval(
    shares: Floats, others: NDArray[np.bool_], draws: int = 10_000
) -> tuple[float, float]:
    """Return the 90 % interval of the mean, over rough and smooth surfaces drawn
    anew."""
    rng, means = np.random.default_rng(0), []
    for _ in range(draws):
        drawn = np.ix_(*(rng.integers(size, size=size) for size in shares.shape))
        means.append(mean_of(shares[drawn], others[drawn]))
    low, high = np.nanpercentile(means, [5, 95])
    return float(low), float(high)


def print_pairs(
    channels: dict[str, dict[str, Touches]],
    first: dict[str, Recording],
    profiles: Sequence[str],
) -> None:
    """Print each channel, the mean of all that distort and the worst; then what
    `graded` gains over `paper`."""
    print(
        "Shares of pairs in which the rough touch is drawn stronger than the smooth "
        f"one, by a just-noticeable difference at least; {LOGIT}: in which it has the "
        "higher one."
    )
    for tiers in (("core",), ("core", "extended")):
        names = sorted(name for name in channels[AS_IT_IS] if first[name].tier in tiers)
        rough, smooth = (
            [name for name in names if first[name].rough == is_rough]
            for is_rough in (True, False)
        )
        others = np.array(
            [
                [kin_of(first[one]) != kin_of(first[other]) for other in smooth]
                for one in rough
            ]
        )
        columns = [LOGIT, *profiles]
        table = {
            channel: [pairs_right(found, column, rough, smooth) for column in columns]
            for channel, found in channels.items()
        }
        rows = {
            channel: [mean_of(shares, others) for shares in row]
            for channel, row in table.items()
        }
        distorting = [channel for channel in channels if channel != AS_IT_IS]
        if distorting:
            rows["worst"] = list(
                np.min([rows[channel] for channel in distorting], axis=0)
            )
        print(
            f"\n| {' and '.join(tiers)} | {' | '.join(columns)} |\n|---|"
            + "--:|" * len(columns)
        )
        for channel, row in rows.items():
            print(
                f"| {channel} | " + " | ".join(f"{share:.3f}" for share in row) + " |"
            )
        if distorting:
            means = list(np.mean([table[channel] for channel in distorting], axis=0))
            cells = [
                "{:.3f} ({:.2f}-{:.2f})".format(
                    mean_of(each, others), *interval(each, others)
                )
                for each in means
            ]
            print(
                f"| mean of the {len(distorting)} (90 % over surfaces) | "
                + " | ".join(cells)
                + " |"
            )
            if {"paper", "graded"} <= set(columns):
                gain = means[columns.index("graded")] - means[columns.index("paper")]
                low, high = interval(gain, others)
                print(
                    f"\ngraded over paper: {mean_of(gain, others):+.4f} ({low:+.4f} to "
                    f"{high:+.4f})"
                )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "simulated", type=Path, nargs="*", help="sets that are trained on too"
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
        "--profile",
        nargs="*",
        default=["paper", "graded", "erm", "lra", "piezo"],
        metavar="NAME",
        help="profiles (default: paper graded erm lra piezo)",
    )
    args = parser.parse_args()
    real = read_real()
    simulated = [
        take for folder in args.simulated for take in open_dataset(folder).recordings
    ]
    groups = ["ten"] if args.distorted == [] else args.distorted or []
    channels: dict[str, dict[str, Touches]] = {
        name: {}
        for name in (AS_IT_IS, *(name for group in groups for name in GROUPS[group]))
    }
    with tempfile.TemporaryDirectory() as folder:
        for model, takes in left_out(real, simulated, kin_of, Path(folder)):
            for take in (take for take in takes if int(take.take or 0) <= args.takes):
                for name, found in channels.items():
                    heard = (
                        take
                        if name == AS_IT_IS
                        else distorted(take, name, Path(folder))
                    )
                    touches = found.setdefault(take.surface, defaultdict(list))
                    for profile, each in touches_of(
                        predictions_of(model, heard), args.profile
                    ).items():
                        touches[profile] += each
    print_pairs(
        channels,
        {take.surface: take for take in reversed(real.recordings)},
        args.profile,
    )


if __name__ == "__main__":
    main()
