"""The files that `tactophone feel` writes: the vibration as WAV, and a timeline; and
the scores of a run.

A recording, or any source that ends, goes through the pipeline block by block: memory
does not grow with its length.
"""

import contextlib
import itertools
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import numpy as np
import soundfile
from msgspec import structs
from numpy.typing import NDArray

from tactophone.core.errors import ConfigError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.sound_file import (
    LARGEST_WAV,
    create_long_wav,
    native_name,
)
from tactophone.core.recordings.values import Segment, within
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    SURFACE_LABELS,
    AudioBlock,
    FloatArray,
    PipelineStep,
    Source,
    Touch,
    ignore,
)
from tactophone.live.telemetry.layout import STEP_RECORD
from tactophone.live.telemetry.prediction_log import RunFollower
from tactophone.live.telemetry.timeline import TimelineWriter
from tactophone.live.telemetry.watcher import Snapshot
from tactophone.signal.haptics.sound_playback import open_playback
from tactophone.signal.perception.decision import count_bumps, count_dips
from tactophone.signal.pipeline import Pipeline

VIBRATION_TAIL = 0.1
"""Seconds of vibration after the end of the sound: the fade that follows the last
command, to its last sample."""

BYTES_PER_SAMPLE = 3
"""Of the vibration's file: 24 bits."""

CAPACITY = 4096
"""Greatest number of columns, an even number: more than any figure has pixels
across."""

PERCEPTIBLE = 0.02
"""Amplitude from which a vibration can be felt, -34 dB: well under the paper's smooth,
at -25 dBFS."""


class PeakEnvelope:
    """Collects the extremes of a stream of sound; memory does not grow with its length.

    When the columns are full, neighbours are joined, and each column then spans twice
    as many samples.

    >>> envelope = PeakEnvelope(1, sample_rate=1000)
    >>> envelope.push(np.sin(np.arange(100_000, dtype=np.float32))[:, None])
    >>> time, low, high = envelope.columns()
    >>> len(time) <= CAPACITY, round(float(low.min())), round(float(high.max()))
    (True, -1, 1)
    """

    def __init__(self, channels: int, *, sample_rate: int) -> None:
        self._sample_rate = sample_rate
        self._step = 16
        self._rest: FloatArray = np.empty((0, channels), np.float32)
        self._low: list[FloatArray] = []
        self._high: list[FloatArray] = []

    def push(self, samples: FloatArray) -> None:
        """Add sound, shape ``(samples, channels)``."""
        while len(samples):
            room = (CAPACITY - len(self._low)) * self._step - len(self._rest)
            self._add_columns(np.concatenate((self._rest, samples[:room])))
            samples = samples[room:]
            if len(self._low) == CAPACITY:
                self._low = list(np.minimum(self._low[::2], self._low[1::2]))
                self._high = list(np.maximum(self._high[::2], self._high[1::2]))
                self._step *= 2

    def columns(self) -> tuple[NDArray[np.float64], FloatArray, FloatArray]:
        """Return the time of each column in s, and its least and greatest values, each
        ``(columns, channels)``."""
        time = np.arange(len(self._low)) * self._step / self._sample_rate
        empty = np.empty((0, self._rest.shape[1]), np.float32)
        return (
            time,
            np.array(self._low) if self._low else empty,
            np.array(self._high) if self._high else empty,
        )

    def _add_columns(self, sound: FloatArray) -> None:
        # What does not fill a column waits for the next block.
        whole = len(sound) // self._step * self._step
        columns = sound[:whole].reshape(-1, self._step, sound.shape[1])
        self._rest = sound[whole:]
        self._low += list(columns.min(axis=1))
        self._high += list(columns.max(axis=1))


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """Where the results of a recording are written; the JSON timeline only if it has a
    path."""

    waveform: Path
    timeline: Path
    timeline_json: Path | None = None

    @classmethod
    def in_folder(cls, folder: Path, stem: str, *, json: bool = False) -> Self:
        """Name the files ``stem.haptic.wav``, ``stem.timeline.csv`` and
        ``stem.timeline.json``."""
        timeline_json = folder / f"{stem}.timeline.json" if json else None
        return cls(
            folder / f"{stem}.haptic.wav",
            folder / f"{stem}.timeline.csv",
            timeline_json,
        )


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Totals of a processed recording."""

    duration: float
    """Length of the sound, in s."""
    updates: int
    """Number of predictions."""
    contact: float
    """Share of all predictions that are in contact."""
    rough: float
    """Share of the predictions in contact that are rough; NaN without contact."""
    unknown: float
    """Share of the predictions in contact that are unknown; NaN without contact."""
    loudest_dbfs: float
    """Greatest level of the contact channel in any window."""
    elapsed: float
    """Computing time, in s."""
    faults: dict[str, int] = field(default_factory=dict)
    """Count of each cause of silence."""

    @property
    def speed(self) -> float:
        return self.duration / self.elapsed if self.elapsed else float("inf")


class OfflineRenderer:
    """Runs the pipeline over a recording and writes its output step by step; a context
    manager.

    Files appear at the end, if all went well, in place of existing ones. The pipeline
    is opened for this sound; its profile says what is rendered, and its limits bound
    the waveform too. ``duration``: length of the sound in s, where it is known before.

    ``microphones``, ``vibration``: peak envelopes of sound and vibration, for a figure.
    """

    def __init__(
        self,
        outputs: OutputFiles,
        pipeline: Pipeline,
        *,
        channels: int,
        sample_rate: int,
        duration: float = 0.0,
    ) -> None:
        self.microphones = PeakEnvelope(channels, sample_rate=sample_rate)
        self.vibration = PeakEnvelope(1, sample_rate=LIVE_SAMPLE_RATE)
        self._outputs = outputs
        self._pipeline = pipeline
        self._sample_rate = sample_rate
        self._duration = duration
        self._playback = open_playback(
            pipeline.profile.name,
            pipeline.limits,
            channels=channels,
            sample_rate=sample_rate,
        )
        self._counts: Counter[Touch] = Counter()
        self._unknown = 0
        self._loudest_dbfs = -np.inf
        self._last: AudioBlock | None = None

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            outputs = self._outputs
            enter = stack.enter_context
            json_path = outputs.timeline_json and enter(
                atomic_write(outputs.timeline_json)
            )
            self._timeline = enter(
                TimelineWriter(
                    enter(atomic_write(outputs.timeline)), json_path=json_path
                )
            )
            waveform = enter(atomic_write(outputs.waveform))
            self._waveform = enter(self._create(waveform))
            self._resources = stack.pop_all()
        self._began = time.perf_counter()
        return self

    def __exit__(self, *error: Any) -> None:
        self._resources.__exit__(*error)

    def _create(self, path: Path) -> soundfile.SoundFile:
        size = BYTES_PER_SAMPLE * (self._duration + VIBRATION_TAIL) * LIVE_SAMPLE_RATE
        if size > LARGEST_WAV:
            return create_long_wav(
                path, sample_rate=LIVE_SAMPLE_RATE, channels=1, subtype="PCM_24"
            )
        name = native_name(path)
        return soundfile.SoundFile(
            name, "w", LIVE_SAMPLE_RATE, 1, "PCM_24", format="WAV"
        )

    def push(self, block: AudioBlock) -> PipelineStep:
        """Process a block and write its results; returns the step."""
        step = self._pipeline.push(block)
        self.write(step)
        return step

    def write(self, step: PipelineStep) -> None:
        """Write a step that was computed elsewhere."""
        self.microphones.push(step.block.samples)
        self._write(step, until=step.block.end / self._sample_rate)
        self._last = step.block

    def finish(self, *, flush: bool = True) -> RunSummary:
        """Write what the end of the sound completes, unless ``flush`` is false; return
        the totals."""
        duration = self._last.end / self._sample_rate if self._last else 0.0
        # Counted before the tail: the fade at the end is the renderer's timeout, but
        # not a fault.
        renderer = self._playback.renderer
        faults = dict(self._pipeline.detector.faults + renderer.faults)
        if self._last:
            tail = (
                self._pipeline.flush(self._last)
                if flush
                else PipelineStep(self._last, (), ())
            )
            self._write(
                structs.replace(tail, block=self._last.part(0, 0)),
                until=duration + VIBRATION_TAIL,
            )
        updates = sum(self._counts.values())
        contact = updates - self._counts[Touch.NONE]
        return RunSummary(
            duration=duration,
            updates=updates,
            contact=contact / updates if updates else float("nan"),
            rough=self._counts[Touch.ROUGH] / contact if contact else float("nan"),
            unknown=self._unknown / contact if contact else float("nan"),
            loudest_dbfs=float(self._loudest_dbfs),
            elapsed=time.perf_counter() - self._began,
            faults=faults,
        )

    def _write(self, step: PipelineStep, *, until: float) -> None:
        self._playback.hear(step.block)
        wave = self._playback.push(step.commands, until=until)
        self._waveform.write(wave)
        self.vibration.push(wave[:, None])
        self._timeline.write(step)
        for prediction in step.predictions:
            self._counts[prediction.touch] += 1
            self._unknown += prediction.unknown
            self._loudest_dbfs = max(self._loudest_dbfs, prediction.level_dbfs)


def process_recording(
    source: Source,
    pipeline: Pipeline,
    outputs: OutputFiles,
    *,
    duration: float = 0.0,
    on_step: Callable[[PipelineStep], None] = ignore,
) -> tuple[RunSummary, OfflineRenderer]:
    """Process a source to its end.

    The source is not entered yet; the pipeline is for its rate and channels, and is
    reset first. ``duration`` is as for `OfflineRenderer`.

    Returns the totals, and the renderer with the peak envelopes of sound and vibration.
    Raises `ConfigError` if the results cannot be written.
    """
    pipeline.reset()
    renderer = OfflineRenderer(
        outputs,
        pipeline,
        channels=source.channels,
        sample_rate=source.sample_rate,
        duration=duration,
    )
    try:
        with source, renderer:
            for block in source:
                on_step(renderer.push(block))
            return renderer.finish(), renderer
    except (
        OSError,
        soundfile.LibsndfileError,
    ) as error:  # of the results: a source has errors of its own
        folder = outputs.waveform.parent
        reason = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"the results cannot be written to {folder} ({reason}); choose another "
            "folder"
        ) from error


class RunRecorder(RunFollower):
    """Records an operator's run (of a hand: one finger's vibration); a context manager
    around the run.

    Its predictions are written by
    `tactophone.live.telemetry.prediction_log.PredictionLog`.
    """

    def __init__(self, name: str, *, finger: int = 0) -> None:
        super().__init__(name)
        self._finger = finger
        self._last: Snapshot | None = None
        self._steps: list[NDArray[np.void]] = []
        self._vibration: list[FloatArray] = []

    def vibration(self, *, sample_rate: int) -> FloatArray:
        """Return the actuator's waveform, shape ``(samples,)``, from the arrival of the
        first sound on."""
        steps = np.concatenate([np.empty(0, STEP_RECORD), *self._steps])
        if not len(steps):
            return np.empty(0, np.float32)
        # Each step holds how much vibration had been rendered at its time: that aligns
        # the two.
        first = int(np.median(steps["vibration_end"] - steps["time"] * sample_rate))
        rendered = np.concatenate([np.zeros(0, np.float32), *self._vibration])
        return np.concatenate(
            (np.zeros(max(0, -first), np.float32), rendered[max(0, first) :])
        )

    def read(self) -> None:
        # A run that has ended has removed its shared memory.
        with contextlib.suppress(OSError):
            self._last = self.watcher.snapshot(self._last, finger=self._finger)
            self._steps.append(self._last.steps)
            self._vibration.append(self._last.vibration)


@dataclass(frozen=True, slots=True)
class RunScores:
    """Scores of a run."""

    smooth_right: float
    rough_right: float
    """`smooth_right` and `rough_right`: share of correct predictions while a smooth, or
    rough, stone was touched."""
    false_bumps: int
    dips: int
    """`false_bumps` and `dips`: how often smooth was rendered as rough, and rough
    interrupted within one touch."""
    touch_to_vibration: float
    """Median time in s from the start of a contact to a vibration that can be felt."""
    lift_to_silence: float
    """Median time in s from the end of a contact to the command for silence."""


def score_run(
    timeline: dict[str, NDArray[Any]], truth: tuple[Segment, ...]
) -> RunScores:
    """Score a run's timeline against its labelled segments; a score without data is
    NaN."""
    time = timeline["time"]
    touch = timeline["touch"]
    amplitude = timeline["amplitude"]
    smooth, rough = (
        within(time, [each for each in truth if each.label is label])
        for label in SURFACE_LABELS
    )
    pairs = list(itertools.pairwise(truth))
    touched = [
        after.start for before, after in pairs if after.contact and not before.contact
    ]
    lifted = [
        after.start for before, after in pairs if before.contact and not after.contact
    ]
    return RunScores(
        smooth_right=_share(touch[smooth] == Touch.SMOOTH),
        rough_right=_share(touch[rough] == Touch.ROUGH),
        false_bumps=count_bumps(touch == Touch.ROUGH, smooth),
        dips=count_dips(touch == Touch.ROUGH, rough),
        touch_to_vibration=_delay(time, amplitude >= PERCEPTIBLE, touched),
        lift_to_silence=_delay(time, amplitude == 0, lifted),
    )


def _share(right: NDArray[np.bool_]) -> float:
    return float(right.mean()) if len(right) else float("nan")


def _delay(
    time: NDArray[Any], condition: NDArray[np.bool_], events: list[float]
) -> float:
    """Return the median time in s from each event to the first line that meets the
    condition."""
    found = [time[condition & (time >= event)] for event in events]
    delays = [
        float(after[0] - event)
        for after, event in zip(found, events, strict=True)
        if len(after)
    ]
    return float(np.median(delays)) if delays else float("nan")
