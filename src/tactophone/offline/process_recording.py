"""Feels a recording, or any source that ends: from sound to vibration and timeline on disk, with memory kept flat."""

import time
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import soundfile

from tactophone.haptics import Oscillator, Passthrough, Playback
from tactophone.offline.peaks import PeakEnvelope
from tactophone.perception.features.resample import Resampler
from tactophone.pipeline import Pipeline
from tactophone.telemetry.prediction_log import TimelineWriter
from tactophone.types import AudioBlock, FloatArray, PipelineStep, Source, Touch

HAPTIC_RATE = 48_000
"""Hz of the vibration's file."""

TAIL = 0.1
"""Seconds of vibration after the sound's end: the dead-man's fade, to its last sample."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where the results of one recording go; those that are ``None`` are not written."""

    waveform: Path
    timeline: Path
    timeline_json: Path | None = None

    @classmethod
    def beside(cls, folder: Path, stem: str, *, json: bool = False) -> Self:
        """Name the files ``stem.haptic.wav``, ``stem.timeline.csv`` and ``stem.timeline.json`` in a folder."""
        timeline_json = folder / f"{stem}.timeline.json" if json else None
        return cls(folder / f"{stem}.haptic.wav", folder / f"{stem}.timeline.csv", timeline_json)


@dataclass(frozen=True, slots=True)
class Summary:
    """What came of a recording.

    Parameters
    ----------
    duration
        Of the sound, in s.
    updates
        Beliefs in all.
    contact, rough
        Share of all updates in contact, and of those in contact called rough; NaN where there are none.
    loudest_dbfs
        Greatest level of the contact channel that any window had.
    elapsed
        Seconds that it took.
    faults
        By cause.
    """

    duration: float
    updates: int
    contact: float
    rough: float
    loudest_dbfs: float
    elapsed: float
    faults: dict[str, int] = field(default_factory=dict)

    @property
    def speed(self) -> float:
        """How many times faster than the sound itself."""
        return self.duration / self.elapsed if self.elapsed else float("inf")


class OfflineRenderer:
    """Writes what a walk gives, step by step; a context manager.

    Parameters
    ----------
    outputs
        The files; what is there is written over.
    walk
        Already made for the sound to come; its limits bound the waveform too.
    channels
        Of the sound to come.
    sample_rate
        Of the sound to come, in Hz.
    sounding
        Renders the sound itself, in place of the walk's commands.

    Attributes
    ----------
    microphones, vibration
        Envelopes of the two waveforms, for a picture.
    """

    def __init__(
        self, outputs: Outputs, walk: Pipeline, *, channels: int, sample_rate: int, sounding: Passthrough | None = None
    ) -> None:
        self.microphones = PeakEnvelope(channels, sample_rate=sample_rate)
        self.vibration = PeakEnvelope(1, sample_rate=HAPTIC_RATE)
        self._outputs, self._walk, self._sample_rate = outputs, walk, sample_rate
        self._oscillator = Oscillator(walk.limits, sample_rate=HAPTIC_RATE)
        self._playback = Playback(self._oscillator)
        self._sounding = sounding
        self._resampler = Resampler(sample_rate, HAPTIC_RATE, channels=channels)
        self._touches: Counter[Touch] = Counter()
        self._loudest_dbfs = -np.inf
        self._last: AudioBlock | None = None
        self._resources = ExitStack()

    def __enter__(self) -> Self:
        out = self._outputs
        self._timeline = self._resources.enter_context(TimelineWriter(out.timeline, json_path=out.timeline_json))
        self._waveform = self._resources.enter_context(
            soundfile.SoundFile(out.waveform, "w", samplerate=HAPTIC_RATE, channels=1, subtype="PCM_24")
        )
        self._began = time.perf_counter()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._resources.close()

    def push(self, block: AudioBlock) -> PipelineStep:
        """Pipeline a block, write what came of it, and give it on."""
        tick = self._walk.push(block)
        self.microphones.push(block.samples)
        self._write(tick, until=block.end / self._sample_rate)
        self._last = block
        return tick

    def finish(self) -> Summary:
        """Write what the end of the sound completes, and sum up."""
        duration = self._last.end / self._sample_rate if self._last else 0.0
        faults = dict(self._walk.faults + self._oscillator.faults)  # the fade at the end is none
        if self._last:
            self._write(self._walk.flush(self._last), until=duration + TAIL)
        updates = sum(self._touches.values())
        contact = updates - self._touches[Touch.NONE]
        return Summary(
            duration=duration,
            updates=updates,
            contact=contact / updates if updates else float("nan"),
            rough=self._touches[Touch.ROUGH] / contact if contact else float("nan"),
            loudest_dbfs=float(self._loudest_dbfs),
            elapsed=time.perf_counter() - self._began,
            faults=faults,
        )

    def _write(self, tick: PipelineStep, *, until: float) -> None:
        wave = self._render(tick, until=until)
        self._waveform.write(wave)
        self.vibration.push(wave[:, None])
        self._timeline.write(tick)
        for prediction in tick.predictions:
            self._touches[prediction.touch] += 1
            self._loudest_dbfs = max(self._loudest_dbfs, prediction.level_dbfs)

    def _render(self, tick: PipelineStep, *, until: float) -> FloatArray:
        if self._sounding is None:
            return self._playback.push(tick.commands, until=until)
        return self._sounding.push(self._resampler.push(tick.block.samples))


def feel(
    source: Source,
    walk: Pipeline,
    outputs: Outputs,
    *,
    sounding: Passthrough | None = None,
    watch: Callable[[PipelineStep], None] = lambda tick: None,
) -> tuple[Summary, OfflineRenderer]:
    """Feel a source to its end.

    Parameters
    ----------
    source
        Not entered yet.
    walk
        Made for that source's rate and channels; it is reset first.
    outputs
        The files to write.
    sounding
        Renders the sound itself, in place of the walk's commands.
    watch
        Called with each step, for a progress bar or a page.

    Returns
    -------
    The summary, and the feeling with the envelopes of what was heard and felt.
    """
    walk.reset()
    feeling = OfflineRenderer(
        outputs, walk, channels=source.channels, sample_rate=source.sample_rate, sounding=sounding
    )
    with source, feeling:
        for block in source:
            watch(feeling.push(block))
        return feeling.finish(), feeling
