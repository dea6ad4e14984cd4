"""How often `compare` orders two simulated objects rightly, and how sure it is;
SIMULATED.

    tactophone simulate dataset build/random-pad --objects random:48:1 --tip pad \\
      --takes long_medium,short_light,wiggle --seconds 6 --seed 77
    python benchmarks/comparison.py build/random-pad [--fit]

Every take is compared with every take of the other objects whose Ra differs by a
quarter or more, in all the ways that a finger may stroke them. Printed is, for each
range of the certainty that is said, how often the order is right, with a 90 % interval
over objects: for all pairs, for those of a rough and a smooth object, and for those of
one class. With `--fit`, also the scale of `signal/perception/comparison.py` that fits
these pairs best.
"""

import argparse
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import minimize_scalar

from tactophone.app.compare import SURE_FROM, hear_object
from tactophone.app.recordings import open_recording
from tactophone.core.tips import DEFAULT_TIP, TIP_NAMES
from tactophone.signal.perception.comparison import LEAST_HEARD, probability_rougher
from tactophone_lab.datasets.open import open_dataset

LEAST_RATIO = 1.25
"""Ratio of two objects' Ra from which one counts as rougher."""

BOUNDS = (0.5, 0.75, SURE_FROM, 0.95, 1.01)
"""Ranges of certainty."""

DRAWS = 1000
"""Bootstrap draws of objects."""


@dataclass(frozen=True)
class Take:
    """What is heard of an object in one take."""

    surface: str
    rough: bool
    ra: float
    """In um."""
    evidence: float


@dataclass(frozen=True)
class Pair:
    """Two takes of two objects, the rougher one first."""

    objects: tuple[str, str]
    one_class: bool
    difference: float
    """Of the mean evidence; the order is right where it is over 0."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="a set of `tactophone simulate`")
    parser.add_argument("--tip", choices=TIP_NAMES, default=DEFAULT_TIP)
    parser.add_argument("--fit", action="store_true", help="fit the scale")
    args = parser.parse_args()
    takes, too_short = read_takes(args.dataset, args.tip)
    pairs = list(pairs_of(takes))
    print(
        f"{len(takes)} SIMULATED takes, {len(pairs)} pairs; in {too_short} more takes "
        f"under {LEAST_HEARD:g} s of touch was heard"
    )
    if args.fit:
        print(f"scale {fit_scale(pairs):.2f} nats")
    print_certainty(pairs)


def read_takes(dataset: Path, tip: str) -> tuple[list[Take], int]:
    """Hear every take; return them, and how many held too little touch."""
    takes = []
    too_short = 0
    for recording in open_dataset(dataset).labelled().recordings:
        heard = hear_object(open_recording(recording.path, tip=tip))
        if heard.seconds < LEAST_HEARD:
            too_short += 1
            continue
        ra = float(recording.known("ra_um"))
        takes.append(Take(recording.surface, bool(recording.rough), ra, heard.value))
    return takes, too_short


def pairs_of(takes: Sequence[Take]) -> Iterator[Pair]:
    for pair in itertools.combinations(takes, 2):
        other, rougher = sorted(pair, key=lambda take: take.ra)
        differ = rougher.ra >= LEAST_RATIO * other.ra
        if differ and rougher.surface != other.surface:
            yield Pair(
                (rougher.surface, other.surface),
                rougher.rough == other.rough,
                rougher.evidence - other.evidence,
            )


def fit_scale(pairs: Sequence[Pair]) -> float:
    """Return the scale under which the orders of these pairs are likeliest."""
    difference = np.array([pair.difference for pair in pairs])

    def loss(scale: float) -> float:
        return float(np.logaddexp(0, -difference / scale).mean())

    return float(minimize_scalar(loss, bounds=(0.1, 30), method="bounded").x)


def print_certainty(pairs: Sequence[Pair]) -> None:
    print("\n| pairs | certainty | share of pairs | right | 90 % |")
    print("|---|--:|--:|--:|--:|")
    kinds = {
        "all": pairs,
        "of a rough and a smooth object": [p for p in pairs if not p.one_class],
        "of one class": [p for p in pairs if p.one_class],
    }
    for words, chosen in kinds.items():
        if not chosen:
            continue
        likelier = [probability_rougher(abs(p.difference)) for p in chosen]
        place = np.digitize(likelier, BOUNDS) - 1
        for number, (low, high) in enumerate(itertools.pairwise(BOUNDS)):
            inside = [p for p, at in zip(chosen, place, strict=True) if at == number]
            print(
                f"| {words} | {low:.2f} to {min(high, 1):.2f} | "
                f"{len(inside) / len(chosen):.2f} | {right_in_words(inside)} |"
            )
        print(f"| {words} | any | 1.00 | {right_in_words(chosen)} |")


def right_in_words(pairs: Sequence[Pair]) -> str:
    """Return the share of pairs in the right order, and its interval over objects."""
    if not pairs:
        return "- | -"
    right = np.array([pair.difference > 0 for pair in pairs], float)
    names = sorted({name for pair in pairs for name in pair.objects})
    number = {name: at for at, name in enumerate(names)}
    first, second = np.array(
        [[number[name] for name in pair.objects] for pair in pairs]
    ).T
    rng = np.random.default_rng(0)
    shares = []
    for _ in range(DRAWS):
        drawn = np.bincount(
            rng.integers(len(names), size=len(names)), minlength=len(names)
        )
        weight = drawn[first] * drawn[second]
        if weight.any():
            shares.append(np.average(right, weights=weight))
    low, high = np.percentile(shares, [5, 95])
    return f"{right.mean():.2f} | {low:.2f} to {high:.2f}"


if __name__ == "__main__":
    main()
