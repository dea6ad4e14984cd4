"""Whole runs from Python in one call: a recording as a table, and the steps of a live run."""

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tactophone.app.sources import open_source
from tactophone.core.prediction_fields import PREDICTION_FIELDS
from tactophone.core.settings import Settings, change
from tactophone.core.types import DEFAULT_TIP, HapticCommand, PipelineStep, Prediction, Source, Touch, TouchEvent
from tactophone.live.audio.files import FileSource
from tactophone.live.audio.pacing import paced
from tactophone.live.telemetry.layout import PREDICTION_RECORD
from tactophone.live.telemetry.timeline import TimelineWriter
from tactophone.signal.pipeline import Pipeline, open_pipeline


@dataclass(frozen=True, slots=True, eq=False)
class Table:
    """The predictions of a recording, in order, with the vibration that each led to.

    Attributes
    ----------
    predictions
        One for each window, and for each touch event.
    commands
        As many.
    """

    predictions: tuple[Prediction, ...]
    commands: tuple[HapticCommand, ...]

    def __len__(self) -> int:
        return len(self.predictions)

    def column(self, name: str) -> NDArray[Any]:
        """Return one number of each prediction; names as in the CSV file, such as ``level_dbfs`` or ``amplitude``."""
        field = next(field for field in PREDICTION_FIELDS if field.name == name)
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
        """Return a pandas data frame, a row for each prediction; ``touch`` is ``none``, ``smooth`` or ``rough``.

        Needs pandas, which Tactophone does not install.
        """
        import pandas

        frame = pandas.DataFrame({field.name: self.column(field.name) for field in PREDICTION_FIELDS})
        frame["touch"] = [Touch(number).name.lower() for number in self.touch]
        frame["event"] = [prediction.events[-1].kind if prediction.events else "" for prediction in self.predictions]
        return frame

    def to_csv(self, path: str | Path) -> None:
        """Write the CSV file that ``tactophone feel`` writes."""
        with TimelineWriter(Path(path)) as writer:
            for prediction, command in zip(self.predictions, self.commands, strict=True):
                writer.write_row(prediction, command)

    def plot(self) -> Any:
        """Draw level, roughness in contact and amplitude; returns a matplotlib figure (extra ``plot``)."""
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
    path: str | Path, model: str = "", *, profile: str = "paper", events: bool = False, tip: str = DEFAULT_TIP
) -> Table:
    """Return all predictions of a recording.

    Parameters
    ----------
    path
        A WAV or FLAC file; channel 0 is the contact microphone, channel 1 (if there is one) the air microphone.
    model
        As for `open_pipeline`, like the parameters after it.

    Raises
    ------
    DatasetError
        If the file is missing or damaged.
    ModelError
        If there is no such model, or it does not fit the sound.
    """
    with FileSource(path) as source:
        pipeline = open_pipeline(
            model, sample_rate=source.sample_rate, channels=source.channels, profile=profile, events=events, tip=tip
        )
        steps = [pipeline.push(block) for block in source]
    if steps:
        steps.append(pipeline.flush(steps[-1].block))
    return Table(
        tuple(prediction for step in steps for prediction in step.predictions),
        tuple(command for step in steps for command in step.commands),
    )


class Live:
    """Live sound through a pipeline in this process, without link, actuator or watchdog; made by `open_live`.

    Iterate over it for its steps, or let it call you: ``with open_live().start(callback): ...``.
    """

    def __init__(self, source: Source, pipeline: Pipeline, *, at_pace: bool) -> None:
        self._source, self._pipeline, self._at_pace = source, pipeline, at_pace
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def __iter__(self) -> Iterator[PipelineStep]:
        if rehearse := getattr(self._source, "rehearse", None):
            rehearse()
        with self._source as source:
            for block in paced(source) if self._at_pace else source:
                if self._ended.is_set():
                    return
                yield self._pipeline.push(block)

    def start(self, callback: Callable[[PipelineStep], object]) -> Self:
        """Call back with each step from now on, in a thread of its own, until `stop` or the end of the sound."""

        def run() -> None:
            for step in self:
                callback(step)

        self._thread = threading.Thread(target=run, name="tactophone-live", daemon=True)
        self._thread.start()
        return self

    def stop(self) -> None:
        """End the sound and wait for the callback that is running; not from within one."""
        self._ended.set()
        if self._thread:
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()


def open_live(
    source: str | Source = "finger", model: str = "", *, profile: str = "paper", events: bool = False,
    tip: str = DEFAULT_TIP,
) -> Live:  # fmt: skip
    """Open live sound and a pipeline for it.

    Parameters
    ----------
    source
        As the option ``--source`` takes it: ``finger`` (simulated), ``jack``, ``portaudio:DEVICE``, ``microphone``,
        ``file:RECORDING`` or ``ros:/TOPIC``; or a `Source`.
    model
        As for `open_pipeline`, like the parameters after it.

    Raises
    ------
    ConfigError
        If there is no such source.

    Examples
    --------
    ::

        for step in tactophone.open_live("finger"):
            print([prediction.roughness for prediction in step.predictions])
    """
    opened = _open(source, tip) if isinstance(source, str) else source
    pipeline = open_pipeline(
        model, sample_rate=opened.sample_rate, channels=opened.channels, profile=profile, events=events, tip=tip
    )
    return Live(opened, pipeline, at_pace=isinstance(source, str) and source.partition(":")[0] in ("finger", "file"))


def _open(text: str, tip: str) -> Source:
    kind, _, device = text.partition(":")
    capture = {"source": kind, "device": device, "tip": tip, "loop": "false"}
    return open_source(change(Settings(), [f"capture.{name}={value}" for name, value in capture.items()], where="live"))
