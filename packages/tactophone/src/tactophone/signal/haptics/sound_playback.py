"""Recordings rendered in stream time by any profile: by its commands, or as the sound
itself, gated by commands as in a live run."""

import math

import numpy as np

from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator, Playback
from tactophone.signal.haptics.passthrough import (
    Passthrough,
    PassthroughRenderer,
    is_passthrough,
    open_passthrough,
)
from tactophone.signal.perception.resample import Resampler


class SoundPlayback(Playback):
    """Renders sound by a `PassthroughRenderer`.

    - ``passthrough``, ``limits``: as for that renderer.
    - ``channels``, ``sample_rate``: of the sound that :meth:`hear` takes.
    """

    def __init__(
        self,
        passthrough: Passthrough,
        limits: Limits | None = None,
        *,
        channels: int,
        sample_rate: int,
    ) -> None:
        super().__init__(PassthroughRenderer(passthrough, self._pull, limits))
        self._channels = channels
        self._resampler = Resampler(sample_rate, LIVE_SAMPLE_RATE, channels=channels)
        # As much silence comes first as the resampler holds back, so that there is
        # always as much sound as the waveform is long.
        held = math.ceil(self._resampler.latency * LIVE_SAMPLE_RATE)
        self._sound = self._silence(held)

    def hear(self, block: AudioBlock) -> None:
        # Where sound is missing, as where a link was lost, there is silence.
        missing = max(0, round(block.time * LIVE_SAMPLE_RATE) - self._done)
        resampled = self._resampler.push(block.samples)
        self._sound = np.concatenate((self._sound, self._silence(missing), resampled))

    def _pull(self, size: int) -> FloatArray:
        # All that was heard, whatever its size; once it has ended, silence.
        heard = self._sound if len(self._sound) else self._silence(size)
        self._sound = self._silence(0)
        return heard

    def _silence(self, size: int) -> FloatArray:
        return np.zeros((size, self._channels), np.float32)


def open_playback(
    profile: str, limits: Limits, *, channels: int, sample_rate: int
) -> Playback:
    """Make what renders a recording with a profile."""
    if not is_passthrough(profile):
        return Playback(Oscillator(limits))
    # The gate applies the ceiling: applied in the passthrough too, it would count
    # twice.
    passthrough = open_passthrough(profile, Limits(ceiling=1.0))
    return SoundPlayback(
        passthrough, limits, channels=channels, sample_rate=sample_rate
    )
