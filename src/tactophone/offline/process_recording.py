"""A recording, or any source that ends, through the pipeline to a vibration and a timeline on disk.

The sound is processed block by block, so that memory does not grow with its length.
"""

import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

import numpy as np
import soundfile

from tactophone.errors import ConfigError
from tactophone.haptics import Oscillator, Passthrough, Playback
from tactophone.offline.peaks import PeakEnvelope
from tactophone.perception import Resampler
from tactophone.pipeline import Pipeline
from tactophone.telemetry import TimelineWriter
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray, PipelineStep, Source, Touch

TAIL = 0.1
"""Seconds of vibration after the end of the sound: the fade that follows the last command, to its last sample."""


@dataclass(frozen=True, slots=True)
class OutputFiles:
    """Where the results of a recording are written; the JSON timeline only if it has a path."""

    waveform: Path
    timeline: Path
    timeline_json: Path | None = None

    @classmethod
    def in_folder(cls, folder: Path, stem: str, *, json: bool = False) -> Self:
        """Name the files ``stem.haptic.wav``, ``stem.timeline.csv`` and ``stem.timeline.json``."""
        timeline_json = folder / f"{stem}.timeline.json" if json else None
        return cls(folder / f"{stem}.haptic.wav", folder / f"{stem}.timeline.csv", timeline_json)


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Totals of a processed recording."""

    duration: float
    """Of the sound, in s."""
    updates: int
    """Number of predictions."""
    contact: float
    rough: float
    """`contact` and `rough`: share of all predictions in contact, and of those in contact that are rough; NaN where
    there are none."""
    loudest_dbfs: float
    """Greatest level of the contact channel in any window."""
    elapsed: float
    """Computing time, in s."""
    faults: dict[str, int] = field(default_factory=dict)
    """Count of each cause of silence."""

    @property
    def speed(self) -> float:
        """How many times faster than real time."""
        return self.duration / self.elapsed if self.elapsed else float("inf")


class OfflineRenderer:
    """Runs the pipeline over a recording and writes its output step by step; a context manager.

    Existing files are overwritten. The pipeline is opened for this sound, and its limits bound the waveform too;
    ``passthrough`` renders the sound itself, in place of its commands.

    Attributes
    ----------
    microphones, vibration
        Peak envelopes of sound and vibration, for a figure.
    """

    def __init__(
        self,
        outputs: OutputFiles,
        pipeline: Pipeline,
        *,
        channels: int,
        sample_rate: int,
        passthrough: Passthrough | None = None,
    ) -> None:
        self.microphones = PeakEnvelope(channels, sample_rate=sample_rate)
        self.vibration = PeakEnvelope(1, sample_rate=LIVE_SAMPLE_RATE)
        self._outputs, self._pipeline, self._sample_rate = outputs, pipeline, sample_rate
        self._oscillator = Oscillator(pipeline.limits, sample_rate=LIVE_SAMPLE_RATE)
        self._playback = Playback(self._oscillator)
        self._passthrough = passthrough
        self._resampler = Resampler(sample_rate, LIVE_SAMPLE_RATE, channels=channels)
        self._counts: Counter[Touch] = Counter()
        self._loudest_dbfs = -np.inf
        self._last: AudioBlock | None = None
        self._resources = ExitStack()

    def __enter__(self) -> Self:
        outputs = self._outputs
        self._timeline = self._resources.enter_context(
            TimelineWriter(outputs.timeline, json_path=outputs.timeline_json)
        )
        self._waveform = self._resources.enter_context(
            soundfile.SoundFile(outputs.waveform, "w", samplerate=LIVE_SAMPLE_RATE, channels=1, subtype="PCM_24")
        )
        self._began = time.perf_counter()
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

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
        """Write what the end of the sound completes, unless ``flush`` is false; return the totals."""
        duration = self._last.end / self._sample_rate if self._last else 0.0
        # Counted before the tail: the fade at the end is the oscillator's timeout, but not a fault.
        faults = dict(self._pipeline.faults + self._oscillator.faults)
        if self._last:
            tail = self._pipeline.flush(self._last) if flush else PipelineStep(self._last, (), ())
            self._write(replace(tail, block=replace(self._last, samples=self._last.samples[:0])), until=duration + TAIL)
        updates = sum(self._counts.values())
        contact = updates - self._counts[Touch.NONE]
        return RunSummary(
            duration=duration,
            updates=updates,
            contact=contact / updates if updates else float("nan"),
            rough=self._counts[Touch.ROUGH] / contact if contact else float("nan"),
            loudest_dbfs=float(self._loudest_dbfs),
            elapsed=time.perf_counter() - self._began,
            faults=faults,
        )

    def _write(self, step: PipelineStep, *, until: float) -> None:
        wave = self._render(step, until=until)
        self._waveform.write(wave)
        self.vibration.push(wave[:, None])
        self._timeline.write(step)
        for prediction in step.predictions:
            self._counts[prediction.touch] += 1
            self._loudest_dbfs = max(self._loudest_dbfs, prediction.level_dbfs)

    def _render(self, step: PipelineStep, *, until: float) -> FloatArray:
        if self._passthrough is None:
            return self._playback.push(step.commands, until=until)
        return self._passthrough.push(self._resampler.push(step.block.samples))


def process_recording(
    source: Source,
    pipeline: Pipeline,
    outputs: OutputFiles,
    *,
    passthrough: Passthrough | None = None,
    on_step: Callable[[PipelineStep], None] = lambda step: None,
) -> tuple[RunSummary, OfflineRenderer]:
    """Process a source to its end.

    The source is not entered yet; the pipeline is for its rate and channels, and is reset first. ``passthrough``
    renders the sound itself, in place of the pipeline's commands.

    Returns the totals, and the renderer with the peak envelopes of sound and vibration. Raises `ConfigError` if the
    results cannot be written.
    """
    pipeline.reset()
    renderer = OfflineRenderer(
        outputs, pipeline, channels=source.channels, sample_rate=source.sample_rate, passthrough=passthrough
    )
    try:
        with source, renderer:
            for block in source:
                on_step(renderer.push(block))
            return renderer.finish(), renderer
    except (OSError, soundfile.LibsndfileError) as error:  # of the results: a source has errors of its own
        folder, reason = outputs.waveform.parent, getattr(error, "strerror", None) or error
        raise ConfigError(f"the results cannot be written to {folder} ({reason}); choose another folder") from error
