"""The sound itself as what the finger feels, under the oscillator's bounds and stops.

A renderer of sound knows nothing of contact, faults or stale news. So what it gives is let through only as far as the
newest command says, and only while commands keep coming: whatever silences the oscillator silences this too.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tactophone.haptics.limits import Limits, is_sound
from tactophone.haptics.oscillator import LONGEST, NEGLIGIBLE
from tactophone.haptics.passthrough import RATE, STEP_SIZE, Passthrough
from tactophone.types import FloatArray, HapticCommand, Prediction, Touch


@dataclass(frozen=True, slots=True)
class GateProfile:
    """The profile that goes with it: open in contact, closed without. Its frequency means nothing."""

    name: str

    def command(self, prediction: Prediction) -> HapticCommand:
        """Give full amplitude while anything is touched."""
        return HapticCommand(float(prediction.touch is not Touch.NONE), 0.0, prediction.end)


class PassthroughRenderer:
    """Lets sound through to the finger as commands allow; has the oscillator's face.

    Parameters
    ----------
    sounding
        Makes vibration of sound.
    pull
        Gives the next so many samples of sound at 48 kHz, shape ``(samples, channels)``; silence where there is none.
    limits
        Bounds on everything rendered; the ceiling changes when another is assigned.

    Attributes
    ----------
    faults
        As of the oscillator: ``command`` was no number, ``stale`` commands stopped coming.
    """

    def __init__(self, sounding: Passthrough, pull: Callable[[int], FloatArray], limits: Limits | None = None) -> None:
        self.limits = limits or Limits()
        self.faults: Counter[str] = Counter()
        self._sounding, self._pull = sounding, pull
        self._patience = round(self.limits.patience * RATE)
        self._decay = np.exp(-np.arange(1, LONGEST + 1) / (self.limits.settling * RATE)).astype(np.float32)
        self._stopped = False
        self.reset()

    @property
    def latency(self) -> float:
        """Seconds from sound to its vibration."""
        return self._sounding.latency + (STEP_SIZE - 1) / RATE

    def reset(self) -> None:
        """Be silent and as new; what is stopped stays stopped."""
        self._sounding.reset()
        # Vibration is made in whole steps: with this much in hand, there is always enough.
        self._ready = np.zeros(STEP_SIZE - 1, np.float32)
        self._slot = self._seen = [HapticCommand(0.0, 0.0, 0.0)]
        self._gain, self._unheard, self._period = 0.0, 0, 0

    def submit(self, command: HapticCommand) -> None:
        """Put the newest command in the one slot; one that is no number asks for silence."""
        if not is_sound(command):
            self.faults["command"] += 1
        # A new list each time, so that the same command given again counts as fresh.
        self._slot = [self.limits.bound(command)]

    def stop(self) -> None:
        """Fade to silence and stay there, whatever is submitted, until :meth:`release`."""
        self._stopped = True

    def release(self) -> None:
        """Undo :meth:`stop`; only ever done on a person's word."""
        self._stopped = False

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` holds."""
        return self._stopped

    def render(self, out: FloatArray) -> None:
        """Write the next ``len(out)`` samples, shape ``(samples,)``, in place."""
        for start in range(0, len(out), LONGEST):
            self._write(out[start : start + LONGEST])

    def _write(self, out: FloatArray) -> None:
        target = self._target(len(out))
        np.multiply(self._gain - target, self._decay[: len(out)], out=out)
        out += target
        last = float(out[-1])
        self._gain = last if target or last > NEGLIGIBLE else 0.0
        # Sound is fetched even while nothing is let through: the clocked buffer goes by what is taken from it.
        out *= self._vibration(len(out))
        np.clip(out, -self.limits.ceiling, self.limits.ceiling, out=out)

    def _target(self, size: int) -> float:
        """How far to open: not at all once commands are stale."""
        slot = self._slot
        if slot is not self._seen:
            self._seen, self._unheard = slot, 0
        before, self._unheard = self._unheard, self._unheard + size
        if self._unheard > self._patience:
            self.faults["stale"] += before <= self._patience and slot[0].amplitude > 0
            return 0.0
        return 0.0 if self._stopped else min(slot[0].amplitude, self.limits.ceiling)

    def _vibration(self, size: int) -> FloatArray:
        # Always in pieces of one length, which the clocked buffer wants, though PortAudio's periods may vary.
        self._period = max(self._period, size)
        while len(self._ready) < size:
            self._ready = np.concatenate((self._ready, self._sounding.push(self._pull(self._period))))
        now, self._ready = self._ready[:size], self._ready[size:]
        return now
