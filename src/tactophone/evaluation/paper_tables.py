"""Tables I and II of the paper, on data in its authors' layout, with the paper's own numbers beside.

The authors' rule scores: a window over 0.005 mean absolute value is rough if P(rough) of all three classes is 0.5 or
more. Models learn from the training objects alone.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from types import MappingProxyType
from typing import Any

from tactophone.dataset import Dataset, Fold, Recording
from tactophone.errors import DatasetError
from tactophone.evaluation.contenders import contenders_for
from tactophone.evaluation.crossvalidation import Cache, cross_validate
from tactophone.evaluation.judging import Judgement, scores_of
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.result import scored
from tactophone.types import Touch

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


def table_one(dataset: Dataset, names: Sequence[str], cache: Cache) -> list[Line]:
    """Give Table I: how windows were called, as shares of all."""
    lines = []
    for part in _parts(dataset):
        if part in PAPER_ONE:
            lines.append(_line(f"paper's own, {part}", SHARES, PAPER_ONE[part]))
        for name, judged in _judge(dataset, part, names, cache).items():
            found = measure(scores_of(map(scored, judged), "authors"))
            lines.append(_line(f"{name}, {part}", SHARES, [found[share] for share in SHARES]))
    return lines


def table_two(dataset: Dataset, names: Sequence[str], cache: Cache) -> list[Line]:
    """Give Table II: the accuracy of each class, day by day."""
    lines = [_line(f"paper's own, {variant}", TWO_COLUMNS, row) for variant, row in PAPER_TWO.items()]
    judged: dict[str, list[Judgement]] = {}
    for part in _parts(dataset):
        for name, some in _judge(dataset, part, names, cache).items():
            judged.setdefault(name, []).extend(some)
    return [*lines, *(_line(name, TWO_COLUMNS, _accuracies(some)) for name, some in judged.items())]


def _parts(dataset: Dataset) -> list[str]:
    """The held-out parts that there are: the test objects and the competition's runs."""
    parts = sorted({one.known("split") for one in dataset.labelled().recordings} - {"train", ""})
    if not parts:
        raise DatasetError(
            f"{dataset.root}: has no test objects and no competition runs; Tables I and II want the authors' layout: "
            "opus/stereo/ and finals_recordings/ (`tactophone simulate dataset --authors-layout` makes it)"
        )
    return parts


def _judge(dataset: Dataset, part: str, names: Sequence[str], cache: Cache) -> dict[str, list[Judgement]]:
    kept = dataset.labelled()
    train = tuple(one for one in kept.recordings if one.known("split") == "train")
    fold = Fold(part, train, tuple(one for one in kept.recordings if one.known("split") == part))
    chosen = names or ("paper/general", "paper/fine-tuned", "paper/one-channel", "ours")
    contenders = [one for one in contenders_for(kept, chosen) if not one.control]
    return {one.name: cross_validate(one.method, [fold], cache=cache) for one in contenders}


def _accuracies(judged: Sequence[Judgement]) -> list[float]:
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


def _accuracy(judged: Sequence[Judgement], label: Touch) -> float:
    if not judged:
        return float("nan")
    found = measure(scores_of(map(scored, judged), "authors"))
    return found["rough_accuracy" if label is Touch.ROUGH else "smooth_accuracy"]


def _line(name: str, columns: Sequence[str], values: Sequence[float]) -> Line:
    told = ("-" if math.isnan(value) else f"{value:.3f}" for value in values)
    return Line(name, dict(zip(columns, told, strict=True)))
