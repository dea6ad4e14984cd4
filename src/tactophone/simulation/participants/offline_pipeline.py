"""Microphone sound to vibration in one call, by the same pipeline and oscillator as everywhere."""

from typing import TYPE_CHECKING

from tactophone.haptics import Oscillator, Playback
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray

if TYPE_CHECKING:
    from tactophone.pipeline import Pipeline


class OfflinePipeline:
    """Renders recordings of two channels at 48 kHz through a pipeline; each call starts from its initial state."""

    def __init__(self, pipeline: "Pipeline") -> None:
        self._pipeline = pipeline

    def __call__(self, samples: FloatArray) -> FloatArray:
        """Return the vibration, shape ``(samples,)``, of a sound of shape ``(samples, 2)``, both at 48 kHz."""
        self._pipeline.reset()
        step = self._pipeline.push(AudioBlock(samples, LIVE_SAMPLE_RATE))
        oscillator = Oscillator(self._pipeline.limits, sample_rate=LIVE_SAMPLE_RATE)
        return Playback(oscillator).push(step.commands, until=len(samples) / LIVE_SAMPLE_RATE)
