"""The vibration of a live run, recorded from its telemetry while it lasts."""

import contextlib

import numpy as np
from numpy.typing import NDArray

from tactophone.telemetry import STEP, RunFollower, Snapshot
from tactophone.types import FloatArray


class RunRecorder(RunFollower):
    """Records an operator's run (of a hand: one finger's vibration); a context manager around the run.

    Its predictions are written by `tactophone.telemetry.PredictionLog`.
    """

    def __init__(self, name: str, *, finger: int = 0) -> None:
        super().__init__(name)
        self._finger = finger
        self._last: Snapshot | None = None
        self._steps: list[NDArray[np.void]] = []
        self._vibration: list[FloatArray] = []

    def vibration(self, *, sample_rate: int) -> FloatArray:
        """Return the actuator's waveform, shape ``(samples,)``, from the arrival of the first sound on."""
        steps = np.concatenate([np.empty(0, STEP), *self._steps])
        if not len(steps):
            return np.empty(0, np.float32)
        # Each step holds how much vibration had been rendered at its time: that aligns the two.
        first = int(np.median(steps["vibration_end"] - steps["time"] * sample_rate))
        rendered = np.concatenate([np.zeros(0, np.float32), *self._vibration])
        return np.concatenate((np.zeros(max(0, -first), np.float32), rendered[max(0, first) :]))

    def read(self) -> None:
        """Add what is new since the last read."""
        with contextlib.suppress(OSError):  # the run has ended and removed its shared memory
            self._last = self.watcher.snapshot(self._last, finger=self._finger)
            self._steps.append(self._last.steps)
            self._vibration.append(self._last.vibration)
