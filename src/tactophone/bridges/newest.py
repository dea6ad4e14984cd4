"""The newest prediction and command of a run, for bridges that pass on the present and no past."""

import math
import time
from dataclasses import dataclass, replace

from tactophone.telemetry import State, Watcher
from tactophone.types import HapticCommand, Prediction, Touch, prediction_of

SILENCE = 0.1
"""Seconds without a new prediction after which a finger counts as silent: a run that ends leaves nothing vibrating."""


@dataclass(frozen=True, slots=True)
class Newest:
    """The newest prediction of a finger and its command *as limited*; amplitude 0 where nothing vibrates."""

    prediction: Prediction
    command: HapticCommand

    @property
    def contact(self) -> bool:
        """Whether the finger touches."""
        return self.prediction.touch is not Touch.NONE

    @property
    def roughness(self) -> float:
        """Of what it touches, 0 to 1; 0 without contact."""
        return self.prediction.roughness if self.contact else 0.0

    def ended(self) -> "Newest":
        """Return the same without contact and vibration: what holds once predictions no longer come."""
        command = self.command
        return Newest(replace(self.prediction, touch=Touch.NONE), HapticCommand(0.0, command.frequency, command.time))


class NewestReader:
    """Reads a run, and the processes that replace it.

    ``finger`` names the finger of a run that has a single one; those of a hand have names.

    Attributes
    ----------
    fingers
        Names of all fingers, in order.
    """

    def __init__(self, name: str, *, finger: str = "index") -> None:
        self.watcher = Watcher(name)
        names = self.watcher.finger_names()
        self.fingers = names if all(names) else [finger]
        self._counts = [0] * len(self.fingers)
        self._last: dict[str, tuple[float, Newest]] = {}
        # What a run did before, perhaps long ago, is not the present.
        self._read()

    def read(self) -> dict[str, Newest]:
        """Return the newest prediction of each finger that has a new one since the last call, by its name.

        A finger without one for `SILENCE` is returned once more, without contact and with amplitude 0.
        """
        now = time.monotonic()
        found = self._read()
        self._last |= {finger: (now, newest) for finger, newest in found.items()}
        return found | self.silenced(before=now - SILENCE)

    def silenced(self, *, before: float = math.inf) -> dict[str, Newest]:
        """Return each finger that touches or vibrates since its last prediction, read ``before`` a time, as silent."""
        ended = {
            finger: newest.ended()
            for finger, (read_at, newest) in self._last.items()
            if read_at < before and (newest.contact or newest.command.amplitude)
        }
        self._last |= {finger: (before, newest) for finger, newest in ended.items()}
        return ended

    def _read(self) -> dict[str, Newest]:
        found = {}
        for place, finger in enumerate(self.fingers):
            rows, self._counts[place] = self.watcher.predictions(self._counts[place], finger=place)
            if len(rows):
                found[finger] = _newest(*prediction_of(rows[-1]))
        if not found and (successor := self.watcher.successor()) is not None:
            self.watcher, self._counts = successor, [0] * len(self.fingers)
        return found

    def state(self) -> State:
        """Return the run's state."""
        return self.watcher.state()

    def stop(self) -> None:
        """Ask for the emergency stop, which any process may."""
        self.watcher.ask("stop")

    def mute(self) -> None:
        """Ask to mute, which any process may."""
        self.watcher.ask("mute")


def _newest(prediction: Prediction, command: HapticCommand) -> Newest:
    if not (math.isfinite(command.amplitude) and math.isfinite(command.frequency)):
        command = HapticCommand(0.0, 0.0, command.time)
    return Newest(prediction, command)
