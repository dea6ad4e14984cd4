"""Sound to vibration at one go, for whoever feels whole visits: the same walk and oscillator as everywhere."""

from tactophone.haptics import Oscillator, Playback
from tactophone.pipeline import Pipeline
from tactophone.simulation.physics.source import RATE
from tactophone.types import AudioBlock, FloatArray


class OfflinePipeline:
    """Feels both microphones' sound through a walk; every call begins anew.

    Parameters
    ----------
    walk
        For two channels at 48 kHz.
    """

    def __init__(self, walk: Pipeline) -> None:
        self._walk = walk

    def __call__(self, samples: FloatArray) -> FloatArray:
        """Give the vibration, 48 kHz, as long as the sound, of shape ``(samples,)``."""
        self._walk.reset()
        tick = self._walk.push(AudioBlock(samples, RATE))
        oscillator = Oscillator(self._walk.limits, sample_rate=RATE)
        return Playback(oscillator).push(tick.commands, until=len(samples) / RATE)
