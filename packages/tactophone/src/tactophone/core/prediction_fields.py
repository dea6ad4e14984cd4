"""The fields of a prediction: CSV, JSON, shared memory, log and pages derive their
columns from this one table.

ROS has a message of its own, `faces.bridges.ros_topics.StampedPrediction`, whose fields
are not derived.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tactophone.core.types import (
    EVENT_KINDS,
    HapticCommand,
    Prediction,
    Touch,
    TouchEvent,
)


@dataclass(frozen=True, slots=True)
class PredictionField:
    """A number that is stored, sent and shown for each prediction and its command."""

    name: str
    dtype: str
    """NumPy's type of the exact number."""
    unit: str
    meaning: str
    of: Callable[[Prediction, HapticCommand], float]
    step: bool = True
    """Whether each `PipelineStep` repeats the newest, so that a page can draw it from
    the steps alone."""


PREDICTION_FIELDS = (
    PredictionField(
        "time",
        "f8",
        "s",
        "when the command was made",
        lambda _, command: command.time,
        step=False,
    ),
    PredictionField(
        "window_start",
        "f8",
        "s",
        "start of the window",
        lambda found, _: found.start,
        step=False,
    ),
    PredictionField(
        "window_end",
        "f8",
        "s",
        "end of the window",
        lambda found, _: found.end,
        step=False,
    ),
    PredictionField(
        "none",
        "f8",
        "",
        "probability of no contact",
        lambda found, _: found.probabilities[0],
    ),
    PredictionField(
        "smooth",
        "f8",
        "",
        "probability of a smooth surface",
        lambda found, _: found.probabilities[1],
    ),
    PredictionField(
        "rough",
        "f8",
        "",
        "probability of a rough surface",
        lambda found, _: found.probabilities[2],
    ),
    PredictionField(
        "touch", "i1", "", "decision, a number of `Touch`", lambda found, _: found.touch
    ),
    PredictionField(
        "contact",
        "?",
        "",
        "whether it touches",
        lambda found, _: found.touch > 0,
        step=False,
    ),
    PredictionField(
        "level_dbfs",
        "f8",
        "dBFS",
        "level of the contact channel",
        lambda found, _: found.level_dbfs,
    ),
    PredictionField(
        "roughness",
        "f8",
        "",
        "0 (smooth) to 1 (rough)",
        lambda found, _: found.roughness,
    ),
    PredictionField(
        "frequency",
        "f8",
        "Hz",
        "frequency of the vibration",
        lambda _, command: command.frequency,
    ),
    PredictionField(
        "amplitude",
        "f8",
        "",
        "0 to 1 of full drive, as limited",
        lambda _, command: command.amplitude,
    ),
    PredictionField(
        "unknown",
        "i1",
        "",
        "1 while the evidence of a touch has reached neither smooth nor rough",
        lambda found, _: int(found.unknown),
    ),
    PredictionField(
        "event",
        "i1",
        "",
        "newest touch event, a place in `EVENT_KINDS` from 1; 0 without one",
        lambda found, _: (
            1 + EVENT_KINDS.index(found.events[-1].kind) if found.events else 0
        ),
        step=False,
    ),
    PredictionField(
        "event_time",
        "f8",
        "s",
        "time of this event; NaN without one",
        lambda found, _: found.events[-1].time if found.events else math.nan,
        step=False,
    ),
)
"""Every field of a prediction and its command, in order; shared memory, CSV, JSON and
pages derive their layout from this table. Times are in s since the stream began.
Without a command, frequency and amplitude are NaN."""

_PLAIN_FIELDS = tuple(
    {field.name for field in PREDICTION_FIELDS}
    & set(Prediction.__struct_fields__) - {"touch", "unknown"}
)


def entries_of(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return all that a row of a file holds, by name: the numbers, and the touch and
    the newest event in words."""
    entries: dict[str, Any] = {
        field.name: field.of(prediction, command) for field in PREDICTION_FIELDS
    }
    event = prediction.events[-1].kind if prediction.events else ""
    return entries | {
        "touch": prediction.touch.name.lower(),
        "contact": int(entries["contact"]),
        "event": event,
    }


def prediction_of(row: Any) -> tuple[Prediction, HapticCommand]:
    """Return a prediction and its command from a row that holds every number of
    `PREDICTION_FIELDS` by name.

    Of its touch events it has the newest.
    """
    number = int(row["event"])
    plain: dict[str, Any] = {name: float(row[name]) for name in _PLAIN_FIELDS}
    found = Prediction(
        probabilities=(float(row["none"]), float(row["smooth"]), float(row["rough"])),
        touch=Touch(int(row["touch"])),
        start=float(row["window_start"]),
        end=float(row["window_end"]),
        unknown=bool(row["unknown"]),
        events=(TouchEvent(EVENT_KINDS[number - 1], float(row["event_time"])),)
        if number
        else (),
        **plain,
    )
    return found, HapticCommand(
        float(row["amplitude"]), float(row["frequency"]), float(row["time"])
    )
