"""Commands to waveform without a device: each command takes effect at its own time, to the sample."""

from collections import deque
from collections.abc import Iterable

import numpy as np

from tactophone.haptics.oscillator import Oscillator
from tactophone.types import FloatArray, HapticCommand


class Playback:
    """Renders commands in stream time; the waveform is bit-equal in portions of any size.

    Examples
    --------
    >>> playback = Playback(Oscillator())
    >>> wave = playback.push([HapticCommand(1.0, 60.0, time=0.005)], until=0.01)
    >>> len(wave), int(np.flatnonzero(wave)[0])
    (480, 240)
    """

    def __init__(self, oscillator: Oscillator) -> None:
        self._oscillator = oscillator
        self._waiting: deque[HapticCommand] = deque()
        self._done = 0

    def push(self, commands: Iterable[HapticCommand], *, until: float) -> FloatArray:
        """Take commands, oldest first; returns the waveform up to a time in s, shape ``(samples,)``."""
        self._waiting.extend(commands)
        end = max(self._done, round(until * self._oscillator.sample_rate))
        out = np.empty(end - self._done, np.float32)
        first = self._done
        while self._waiting and (place := round(self._waiting[0].time * self._oscillator.sample_rate)) < end:
            place = max(place, self._done)
            self._oscillator.render(out[self._done - first : place - first])
            self._oscillator.submit(self._waiting.popleft())
            self._done = place
        self._oscillator.render(out[self._done - first :])
        self._done = end
        return out
