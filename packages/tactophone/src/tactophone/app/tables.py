"""A recording as a table, in one call."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.app.notebook import can_draw, cell
from tactophone.app.recordings import Sound, open_recording
from tactophone.core import extras
from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.prediction_fields import PREDICTION_FIELDS, entries_of
from tactophone.core.processes import make_room
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import HapticCommand, Prediction, Touch, TouchEvent
from tactophone.live.telemetry.layout import PREDICTION_RECORD
from tactophone.live.telemetry.timeline import TimelineWriter


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Table:
    """The predictions of a recording, in order, with the vibration that each led to.

    Its rows are mappings by the names of the columns, so that ``pandas.DataFrame``,
    ``csv.DictWriter`` and the like take a table as it is.

    Attributes
    ----------
    predictions
        One for each window, and for each touch event.
    commands
        As many.
    notes
        Sentences on what was corrected in the recording, and on what does not fit the
        model.
    """

    predictions: tuple[Prediction, ...]
    commands: tuple[HapticCommand, ...]
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.predictions)

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Yield a row for each prediction; ``touch`` and ``event`` are words."""
        for prediction, command in zip(self.predictions, self.commands, strict=True):
            row = entries_of(prediction, command)
            yield row | {"contact": bool(row["contact"])}

    def __repr__(self) -> str:
        end = self.predictions[-1].end if self.predictions else 0.0
        return f"<Table of {len(self)} predictions up to {end:.1f} s>"

    def _repr_html_(self) -> str:
        """What a notebook shows: the line above, and the picture if it can be drawn."""
        drawn = self.plot() if can_draw() and self.predictions else None
        return cell(repr(self), drawn)

    def column(self, name: str) -> NDArray[Any]:
        """Return one number of each prediction; names as in the CSV file, such as
        ``level_dbfs`` or ``amplitude``.

        Raises `ConfigError` if there is no such number.
        """
        fields = {field.name: field for field in PREDICTION_FIELDS}
        if name not in fields:
            raise ConfigError(
                f"no column {name}: there are "
                f"{', '.join(fields)}{did_you_mean(name, fields)}"
            )
        field = fields[name]
        pairs = zip(self.predictions, self.commands, strict=True)
        return np.array([field.of(*pair) for pair in pairs], PREDICTION_RECORD[name])

    @property
    def times(self) -> NDArray[np.float64]:
        """End of each window, in s since the recording began."""
        return self.column("window_end")

    @property
    def touch(self) -> NDArray[np.int8]:
        """Decisions, numbers of `Touch`."""
        return self.column("touch")

    @property
    def roughness(self) -> NDArray[np.float64]:
        """From 0 (smooth) to 1 (rough); meaningless without contact."""
        return self.column("roughness")

    @property
    def level_dbfs(self) -> NDArray[np.float64]:
        """Level of the contact channel, in dB of full scale."""
        return self.column("level_dbfs")

    @property
    def events(self) -> list[TouchEvent]:
        """Touch events; none unless they were asked for."""
        return [event for prediction in self.predictions for event in prediction.events]

    def to_pandas(self) -> Any:
        """Return a pandas data frame, a row for each prediction; ``touch`` is ``none``,
        ``smooth`` or ``rough``.

        Needs pandas, which Tactophone does not install.
        """
        import pandas

        names = [field.name for field in PREDICTION_FIELDS]
        return pandas.DataFrame(list(self), columns=names)

    def to_csv(self, path: str | Path) -> None:
        """Write the CSV file that ``tactophone feel`` writes."""
        path = Path(path)
        make_room(path)
        with TimelineWriter(path) as writer:
            for prediction, command in zip(
                self.predictions, self.commands, strict=True
            ):
                writer.write_row(prediction, command)

    def plot(self) -> Any:
        """Draw level, roughness in contact and amplitude; returns a matplotlib figure.

        Raises `ConfigError` without the extra ``plot``.
        """
        extras.require_extras("plot")
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9, 5), layout="constrained")
        top, middle, bottom = figure.subplots(3, 1, sharex=True)
        touching = np.where(self.touch != Touch.NONE, self.roughness, np.nan)
        for axes, values, label in (
            (top, np.maximum(self.level_dbfs, -120), "level, dBFS"),
            (middle, touching, "roughness"),
            (bottom, self.column("amplitude"), "amplitude"),
        ):
            axes.plot(self.times, values, linewidth=1)
            axes.set_ylabel(label)
        middle.set_ylim(0, 1)
        bottom.set_xlabel("time, s")
        return figure


def classify(
    sound: Sound,
    model: str = "",
    *,
    sample_rate: float | None = None,
    profile: str = "graded",
    events: bool = False,
    tip: str = DEFAULT_TIP,
    threshold_dbfs: float | None = None,
) -> Table:
    """Return all predictions of a recording, as ``tactophone feel`` makes them.

    Parameters
    ----------
    sound
        A WAV or FLAC file, an open file, or an array of samples; channel 0 is the
        contact microphone.
    model
        A shipped model's name, or a model file; empty: the one for ``tip``.
    sample_rate
        Of an array, in Hz; a file knows its own.
    profile
        How predictions become vibration.
    events
        Whether to find touch events too, such as a tap.
    tip
        The kind of fingertip that was recorded.
    threshold_dbfs
        Level from which there is contact, in dB of full scale; by default just over the
        recording's noise floor.

    Raises
    ------
    TactophoneError
        As `open_recording` does.
    """
    recording = open_recording(
        sound,
        model,
        sample_rate=sample_rate,
        profile=profile,
        events=events,
        tip=tip,
        threshold_dbfs=threshold_dbfs,
    )
    steps = list(recording.steps())
    return Table(
        tuple(prediction for step in steps for prediction in step.predictions),
        tuple(command for step in steps for command in step.commands),
        tuple(recording.notes),
    )
