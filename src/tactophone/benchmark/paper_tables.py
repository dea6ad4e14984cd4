"""Tables I and II of the paper, on data in its authors' layout, with the paper's own numbers beside.

Scores follow the authors' rule: a window with a mean absolute value over 0.005 is rough if P(rough) among all three
classes is 0.5 or more; the same moments count for every method. Models train on the training objects alone.
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
from tactophone.benchmark.result import in_true_contact
from tactophone.dataset import Dataset, Fold, Recording, Segment
from tactophone.errors import DatasetError
from tactophone.evaluation import TakePredictions, measure, scores_of
from tactophone.training import NETWORK_RATE, NETWORK_WINDOW_SIZE, REFERENCE_GATE, read_signals
from tactophone.types import Touch

METHODS = ("paper/general", "paper/fine-tuned", "paper/one-channel", "texture")

STEP = 20
"""Samples at 2 kHz, 10 ms, from one look at the level to the next."""

SHORT_WINDOW = 64
"""Samples, 32 ms."""

CLEARLY_DB = 12.0
"""So far under the threshold there is nothing but noise; between the two, contact is unknown."""

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
class TableRow:
    """A row of a table: its name, and its cells by column."""

    name: str
    values: dict[str, str]

    def as_json(self) -> dict[str, Any]:
        """Return a plain dictionary."""
        return asdict(self)


def predict_held_out(
    dataset: Dataset, names: Sequence[str], cache: Cache, *, report: Callable[[str], None] = lambda name: None
) -> dict[str, list[TakePredictions]]:
    """Train methods on the training objects; predict the test objects and the competition's runs.

    Parameters
    ----------
    dataset
        In the authors' layout.
    names
        Of entries; by default the paper's three variants and ``texture``.
    cache
        Where predictions are kept.
    report
        Called with each method's name before it trains.

    Raises
    ------
    DatasetError
        If there are no held-out recordings.
    """
    kept = dataset.labelled()
    if not any(take.known("split") not in ("train", "") for take in kept.recordings):
        raise DatasetError(
            f"{dataset.root}: has no test objects and no competition runs; Tables I and II need the authors' layout: "
            "opus/stereo/ and finals_recordings/ (`tactophone simulate dataset --authors-layout` makes it)"
        )
    # Where contact is not labelled, the authors' test threshold labels it: they score by it.
    recordings = tuple(
        take if take.segments else replace(take, segments=loud_segments(take)) for take in kept.recordings
    )
    train = tuple(take for take in recordings if take.known("split") == "train")
    fold = Fold("held out", train, tuple(take for take in recordings if take.known("split") not in ("train", "")))
    predictions = {}
    for entry in entries_for(replace(kept, recordings=recordings), names or METHODS):
        if not entry.control:
            report(entry.name)
            predictions[entry.name] = cross_validate(entry.method, [fold], cache=cache)
    return predictions


def table_one(predictions: Mapping[str, Sequence[TakePredictions]]) -> list[TableRow]:
    """Return Table I: how windows are classified, as shares of all windows."""
    rows = []
    for part in ("competition", "test"):
        rows.append(_row(f"paper's own, {part}", SHARES, PAPER_ONE[part]))
        for name, takes in predictions.items():
            if of_part := [take for take in takes if take.recording.known("split") == part]:
                metrics = _measure(of_part)
                rows.append(_row(f"{name}, {part}", SHARES, [metrics[share] for share in SHARES]))
    return rows


def table_two(predictions: Mapping[str, Sequence[TakePredictions]]) -> list[TableRow]:
    """Return Table II: the accuracy of each class, day by day."""
    own = [_row(f"paper's own, {variant}", TWO_COLUMNS, row) for variant, row in PAPER_TWO.items()]
    return [*own, *(_row(name, TWO_COLUMNS, _accuracies(takes)) for name, takes in predictions.items())]


def loud_segments(recording: Recording) -> tuple[Segment, ...]:
    """Label contact where the window that ends there is over the authors' threshold, none where it is far below it."""
    (signal,) = read_signals([recording], channels=1, rate=NETWORK_RATE)
    total = np.concatenate(([0.0], np.cumsum(np.abs(signal[:, 0]), dtype=np.float64)))
    ends = np.arange(NETWORK_WINDOW_SIZE, len(signal) + 1, STEP)
    loud = _over_threshold_db(total, ends, NETWORK_WINDOW_SIZE) >= 0
    # A long window detects the beginning of a touch late, so silence is looked for with a short one.
    quiet = ~loud & (_over_threshold_db(total, ends, SHORT_WINDOW) < -CLEARLY_DB)
    segments = (*_stretches(loud, recording.known("label")), *_stretches(quiet, "none"))
    return tuple(sorted(segments, key=lambda segment: segment.start))


def _over_threshold_db(total: NDArray[np.float64], ends: NDArray[np.intp], size: int) -> NDArray[np.float64]:
    mean_absolute = (total[ends] - total[ends - size]) / size
    return np.asarray(20 * np.log10(mean_absolute + 1e-12) - REFERENCE_GATE.threshold_dbfs)


def _stretches(on: NDArray[np.bool_], label: str) -> Iterator[Segment]:
    """A segment for each stretch of windows that is on."""
    begins_and_ends = np.flatnonzero(np.diff(on, prepend=False, append=False)).reshape(-1, 2)
    for begin, end in (NETWORK_WINDOW_SIZE + STEP * begins_and_ends) / NETWORK_RATE:
        yield Segment(float(begin) - STEP / NETWORK_RATE, float(end) - STEP / NETWORK_RATE, label)


def _accuracies(takes: Sequence[TakePredictions]) -> list[float]:
    return [
        _accuracy([take for take in takes if _is(take.recording, label, day)], label)
        for label, day in (
            (Touch.ROUGH, "day 1"), (Touch.ROUGH, "day 2"), (Touch.SMOOTH, "day 1"), (Touch.SMOOTH, "day 2"),
            (Touch.ROUGH, ""), (Touch.SMOOTH, ""),
        )
    ]  # fmt: skip


def _is(recording: Recording, label: Touch, day: str) -> bool:
    there = recording.session == day if day else recording.known("split") == "test"
    return recording.label is label and there


def _accuracy(takes: Sequence[TakePredictions], label: Touch) -> float:
    if not takes:
        return float("nan")
    return _measure(takes)["rough_accuracy" if label is Touch.ROUGH else "smooth_accuracy"]


def _measure(takes: Sequence[TakePredictions]) -> dict[str, float]:
    return measure(scores_of(map(in_true_contact, takes), "authors"))


def _row(name: str, columns: Sequence[str], values: Sequence[float]) -> TableRow:
    cells = ("-" if math.isnan(value) else f"{value:.3f}" for value in values)
    return TableRow(name, dict(zip(columns, cells, strict=True)))
