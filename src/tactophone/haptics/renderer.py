"""What every renderer shares: the newest command, the stop and the bounds."""

from collections import Counter

from tactophone.haptics.limits import Limits, is_finite
from tactophone.types import FloatArray, HapticCommand


class Renderer:
    """Base of the renderers: commands in, waveform out, called in the actuator's thread.

    ``submit``, ``stop`` and ``release`` may be called from a thread other than ``render``'s: each sets one attribute.

    Parameters
    ----------
    limits
        Bounds of everything rendered. Other limits may be assigned: ceiling and band take effect, times stay.

    Attributes
    ----------
    faults
        Counts of ``command`` (not finite, rendered as silence) and ``stale`` (a vibration faded because commands
        stopped arriving).
    silent
        Whether the last samples rendered are all exactly 0; false where that is not known.
    """

    silent = False

    def __init__(self, limits: Limits | None) -> None:
        self.limits = limits or Limits()
        self.faults: Counter[str] = Counter()
        self._stopped = False

    def submit(self, command: HapticCommand) -> None:
        """Replace the current command; one that is not finite means silence. Never waits."""
        if not is_finite(command):
            self.faults["command"] += 1
            command = HapticCommand(0.0, self.limits.lowest, command.time)
        # A new list each time, so that an equal command counts as fresh.
        self._slot = [command]

    def stop(self) -> None:
        """Fade to silence and stay silent, whatever is submitted, until :meth:`release`."""
        self._stopped = True

    def release(self) -> None:
        """Undo :meth:`stop`; called only when a person arms."""
        self._stopped = False

    @property
    def stopped(self) -> bool:
        """Whether :meth:`stop` is in force."""
        return self._stopped

    @property
    def latency(self) -> float:
        """Seconds from input to its first effect on the waveform."""
        raise NotImplementedError

    def reset(self) -> None:
        """Return to silence and the initial state; a stop stays in force."""
        self._slot = [HapticCommand(0.0, self.limits.lowest, 0.0)]

    def render(self, out: FloatArray) -> None:
        """Write the next ``len(out)`` samples, shape ``(samples,)``, in place."""
        raise NotImplementedError
