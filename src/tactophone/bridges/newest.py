"""The newest prediction and command of a run, for bridges that pass on the present and no past."""

import math
from dataclasses import dataclass

from tactophone.telemetry import State, Watcher
from tactophone.types import Touch


@dataclass(frozen=True, slots=True)
class Newest:
    """The newest prediction and its command *as limited*; amplitude 0 where nothing vibrates."""

    probabilities: tuple[float, float, float]
    touch: Touch
    roughness: float
    level_dbfs: float
    amplitude: float
    frequency: float


class NewestReader:
    """Reads a run, and the processes that replace it.

    Parameters
    ----------
    name
        Of a run that exists already.
    """

    def __init__(self, name: str) -> None:
        self.watcher = Watcher(name)
        self._count = 0

    def read(self) -> Newest | None:
        """Return the newest prediction if there is a new one since the last call."""
        rows, count = self.watcher.predictions(self._count)
        self._count = count
        if not len(rows):
            if (successor := self.watcher.successor()) is not None:
                self.watcher, self._count = successor, 0
            return None
        row = rows[-1]
        none, smooth, rough = map(float, row["probabilities"])
        amplitude, frequency = float(row["amplitude"]), float(row["frequency"])
        return Newest(
            (none, smooth, rough), Touch(int(row["touch"])), float(row["roughness"]), float(row["level_dbfs"]),
            amplitude if math.isfinite(amplitude) else 0.0, frequency if math.isfinite(frequency) else 0.0,
        )  # fmt: skip

    def state(self) -> State:
        """Return the run's state."""
        return self.watcher.state()

    def stop(self) -> None:
        """Ask for the emergency stop, which any process may."""
        self.watcher.ask("stop")

    def mute(self) -> None:
        """Ask to mute, which any process may."""
        self.watcher.ask("mute")
