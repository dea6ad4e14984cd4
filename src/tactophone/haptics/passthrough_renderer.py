"""The sound itself as vibration, under the same bounds and stops as the oscillator.

A renderer of sound has no information on contact, faults or stale data. So its output is gated by the amplitude of the
newest command, and only while commands keep arriving: whatever silences the oscillator silences this renderer too.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactophone.haptics.limits import Limits
from tactophone.haptics.oscillator import MAX_PIECE, NEGLIGIBLE
from tactophone.haptics.passthrough import STEP_SIZE, Passthrough
from tactophone.haptics.renderer import Renderer
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray, HapticCommand, Prediction, Touch


@dataclass(frozen=True, slots=True)
class GateProfile:
    """The profile that gates passed sound: open in contact, closed without. Its frequency is unused."""

    name: str

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return full amplitude during contact, and zero without."""
        return HapticCommand(float(prediction.touch is not Touch.NONE), 0.0, prediction.end)


class PassthroughRenderer(Renderer):
    """Renders sound, gated by the amplitude of commands.

    ``passthrough`` makes vibration from sound, with a ceiling of 1, as the gate applies the ceiling; ``pull`` returns
    the next so many samples of sound at 48 kHz, shape ``(samples, channels)``, silence where there is none.
    """

    def __init__(
        self, passthrough: Passthrough, pull: Callable[[int], FloatArray], limits: Limits | None = None
    ) -> None:
        super().__init__(limits)
        self._passthrough, self._pull = passthrough, pull
        self._timeout = round(self.limits.timeout * LIVE_SAMPLE_RATE)
        self._decay = np.exp(-np.arange(1, MAX_PIECE + 1) / (self.limits.time_constant * LIVE_SAMPLE_RATE)).astype(
            np.float32
        )
        self.reset()

    @property
    def latency(self) -> float:
        """Seconds from sound to its vibration."""
        return self._passthrough.latency + (STEP_SIZE - 1) / LIVE_SAMPLE_RATE

    def reset(self) -> None:
        """Return to silence and the initial state; a stop stays in force."""
        self._passthrough.reset()
        # Vibration is made in whole steps: with this reserve, a full period is always ready.
        self._ready = np.zeros(STEP_SIZE - 1, np.float32)
        super().reset()
        self._seen = self._slot
        self._gain, self._since_command, self._period = 0.0, 0, 0

    def render(self, out: FloatArray) -> None:
        """Write the next ``len(out)`` samples, shape ``(samples,)``, in place."""
        for start in range(0, len(out), MAX_PIECE):
            self._write(out[start : start + MAX_PIECE])

    def _write(self, out: FloatArray) -> None:
        target = self._target(len(out))
        np.multiply(self._gain - target, self._decay[: len(out)], out=out)
        out += target
        last = float(out[-1])
        self._gain = last if target or last > NEGLIGIBLE else 0.0
        # Sound is fetched even while the gate is closed: the clocked buffer is steered by what is taken from it.
        out *= self._vibration(len(out))
        np.clip(out, -self.limits.ceiling, self.limits.ceiling, out=out)

    def _target(self, size: int) -> float:
        """Target of the gate, 0 to 1; 0 once commands are stale."""
        slot = self._slot
        if slot is not self._seen:
            self._seen, self._since_command = slot, 0
        before, self._since_command = self._since_command, self._since_command + size
        if self._since_command > self._timeout:
            self.faults["stale"] += before <= self._timeout and slot[0].amplitude > 0
            return 0.0
        return 0.0 if self._stopped else self.limits.bound(slot[0]).amplitude

    def _vibration(self, size: int) -> FloatArray:
        # Always in pieces of one length, which the clocked buffer needs, though PortAudio's periods may vary.
        self._period = max(self._period, size)
        while len(self._ready) < size:
            self._ready = np.concatenate((self._ready, self._passthrough.push(self._pull(self._period))))
        now, self._ready = self._ready[:size], self._ready[size:]
        return now
