"""Tables I and II of the paper, on data in its authors' layout, with the paper's own numbers beside.

The authors' rule scores: a window over 0.005 mean absolute value is rough if P(rough) of all three classes is 0.5 or
more; the same moments count for every method. Models learn from the training objects alone.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.benchmark.crossvalidation import Cache, cross_validate
from tactophone.benchmark.entries import entries_for
from tactophone.benchmark.result import scored
from tactophone.dataset import Dataset, Fold, Recording, Segment
from tactophone.errors import DatasetError
from tactophone.evaluation.metrics import Floats, measure
from tactophone.evaluation.predictions import TakePredictions, scores_of
from tactophone.training.model_export import AUTHORS_GATE
from tactophone.training.network.windows import SIZE
from tactophone.training.sound import RATE, read_signals
from tactophone.types import Touch

METHODS = ("paper/general", "paper/fine-tuned", "paper/one-channel", "ours")

STEP = 20
"""Samples at 2 kHz, 10 ms, at which contact is looked for."""

SHORT = 64
"""Samples, 32 ms."""

CLEARLY_DB = 12.0
"""So far under the threshold there is nothing but noise; between the two, nobody says what there is."""

SHARES = ("rough_as_rough", "rough_as_smooth", "smooth_as_rough", "smooth_as_smooth")

PAPER_ONE: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {"competition": (0.113, 0.472, 0.009, 0.405), "test": (0.240, 0.265, 0.081, 0.413)}
)
"""Table I, general model: shares of all windows, in the order of :data:`SHARES`."""

TWO_COLUMNS = ("rough day 1", "rough day 2", "smooth day 1", "smooth day 2", "test rough", "test smooth")

PAPER_TWO: Mapping[str, tuple[float, ...]] = MappingProxyType(
    {
        "general": (0.264, 0.141, 1.000, 0.929, 0.476, 0.836),
        "fine-tuned": (0.239, 0.190, 1.000, 0.959, 0.459, 0.999),
        "one-channel": (0.482, 0.117, 0.998, 0.692, 0.630, 0.736),
    }
)
"""Table II: accuracy of each class."""


@dataclass(frozen=True, slots=True)
class Line:
    """One line of a table: whose, and its cells."""

    name: str
    values: dict[str, str]

    def as_json(self) -> dict[str, Any]:
        """Give a plain dictionary."""
        return asdict(self)


def judge_held_out(
    dataset: Dataset, names: Sequence[str], cache: Cache, *, report: Callable[[str], None] = lambda name: None
) -> dict[str, list[TakePredictions]]:
    """Let methods learn from the training objects and judge the test objects and the competition's runs.

    Parameters
    ----------
    dataset
        In the authors' layout.
    names
        Of contenders; the paper's three variants and ours, if none.
    cache
        Where judgements are kept.
    report
        Called with each method's name before it learns.

    Raises
    ------
    DatasetError
        If there is nothing held out.
    """
    kept = dataset.labelled()
    held_out = tuple(one for one in kept.recordings if one.known("split") not in ("train", ""))
    if not held_out:
        raise DatasetError(
            f"{dataset.root}: has no test objects and no competition runs; Tables I and II want the authors' layout: "
            "opus/stereo/ and finals_recordings/ (`tactophone simulate dataset --authors-layout` makes it)"
        )
    kept = replace(kept, recordings=tuple(_with_touches(kept.recordings)))
    train = tuple(one for one in kept.recordings if one.known("split") == "train")
    fold = Fold("held out", train, tuple(one for one in kept.recordings if one.known("split") not in ("train", "")))
    judged = {}
    for one in entries_for(kept, names or METHODS):
        if not one.control:
            report(one.name)
            judged[one.name] = cross_validate(one.method, [fold], cache=cache)
    return judged


def table_one(judged: Mapping[str, Sequence[TakePredictions]]) -> list[Line]:
    """Give Table I: how windows were called, as shares of all."""
    lines = []
    for part in ("competition", "test"):
        lines.append(_line(f"paper's own, {part}", SHARES, PAPER_ONE[part]))
        for name, some in judged.items():
            if of_part := [one for one in some if one.recording.known("split") == part]:
                found = measure(scores_of(map(scored, of_part), "authors"))
                lines.append(_line(f"{name}, {part}", SHARES, [found[share] for share in SHARES]))
    return lines


def table_two(judged: Mapping[str, Sequence[TakePredictions]]) -> list[Line]:
    """Give Table II: the accuracy of each class, day by day."""
    own = [_line(f"paper's own, {variant}", TWO_COLUMNS, row) for variant, row in PAPER_TWO.items()]
    return [*own, *(_line(name, TWO_COLUMNS, _accuracies(some)) for name, some in judged.items())]


def _with_touches(recordings: Sequence[Recording]) -> Iterator[Recording]:
    """Tell contact by the authors' test threshold where nobody else has: it is what they score by."""
    for one in recordings:
        yield one if one.segments else replace(one, segments=loud_segments(one))


def loud_segments(recording: Recording) -> tuple[Segment, ...]:
    """Tell contact while the window that ends there is over the authors' threshold, none where it is far under it."""
    (signal,) = read_signals([recording], channels=1)
    total = np.concatenate(([0.0], np.cumsum(np.abs(signal[:, 0]), dtype=np.float64)))
    ends = np.arange(SIZE, len(signal) + 1, STEP)
    loud = _over_threshold_db(total, ends, SIZE) >= 0
    # A long window is late to tell that a touch has begun.
    quiet = ~loud & (_over_threshold_db(total, ends, SHORT) < -CLEARLY_DB)
    found = (*_stretches(loud, recording.known("label")), *_stretches(quiet, "none"))
    return tuple(sorted(found, key=lambda one: one.start))


def _over_threshold_db(total: Floats, ends: NDArray[np.intp], size: int) -> Floats:
    mean_absolute = (total[ends] - total[ends - size]) / size
    return np.asarray(20 * np.log10(mean_absolute + 1e-12) - AUTHORS_GATE.threshold_dbfs)


def _stretches(on: NDArray[np.bool_], label: str) -> Iterator[Segment]:
    """Give the times of each stretch of windows."""
    begins_and_ends = np.flatnonzero(np.diff(on, prepend=False, append=False)).reshape(-1, 2)
    for begin, end in (SIZE + STEP * begins_and_ends) / RATE:
        yield Segment(float(begin) - STEP / RATE, float(end) - STEP / RATE, label)


def _accuracies(judged: Sequence[TakePredictions]) -> list[float]:
    return [
        _accuracy([one for one in judged if _is(one.recording, label, day)], label)
        for label, day in (
            (Touch.ROUGH, "day 1"), (Touch.ROUGH, "day 2"), (Touch.SMOOTH, "day 1"), (Touch.SMOOTH, "day 2"),
            (Touch.ROUGH, ""), (Touch.SMOOTH, ""),
        )
    ]  # fmt: skip


def _is(recording: Recording, label: Touch, day: str) -> bool:
    there = recording.session == day if day else recording.known("split") == "test"
    return recording.label is label and there


def _accuracy(judged: Sequence[TakePredictions], label: Touch) -> float:
    if not judged:
        return float("nan")
    found = measure(scores_of(map(scored, judged), "authors"))
    return found["rough_accuracy" if label is Touch.ROUGH else "smooth_accuracy"]


def _line(name: str, columns: Sequence[str], values: Sequence[float]) -> Line:
    told = ("-" if math.isnan(value) else f"{value:.3f}" for value in values)
    return Line(name, dict(zip(columns, told, strict=True)))
