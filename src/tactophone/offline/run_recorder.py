"""Keeps what telemetry shows of a run while it lasts, so that its timeline can be read and drawn afterwards."""

import contextlib
import threading
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tactophone.telemetry import TICK, Snapshot, Watcher
from tactophone.telemetry.prediction_log import TimelineWriter
from tactophone.types import AudioBlock, FloatArray, HapticCommand, PipelineStep, Prediction, Touch

LOOK_EVERY = 0.2
"""Seconds between two looks: telemetry keeps the newest 2.7 s of vibration, and far more ticks."""


class RunRecorder:
    """Watches an operator's run from beginning to end; a context manager within which it runs.

    Parameters
    ----------
    name
        Of the run, which is there already.
    """

    def __init__(self, name: str) -> None:
        self._watcher = Watcher(name)
        self._last: Snapshot | None = None
        self._ticks: list[NDArray[np.void]] = []
        self._vibration: list[FloatArray] = []
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ended.set()
        self._thread.join()
        self._look()

    @property
    def ticks(self) -> NDArray[np.void]:
        """All ticks seen, of dtype `tactophone.telemetry.TICK`."""
        return np.concatenate([np.empty(0, TICK), *self._ticks])

    def vibration(self, *, sample_rate: int) -> FloatArray:
        """What the actuator was given, shape ``(samples,)``, from the first sound's arrival on."""
        ticks = self.ticks
        if not len(ticks):
            return np.empty(0, np.float32)
        # A tick knows how much vibration there had been when it came: that lays both on one time.
        first = int(np.median(ticks["vibration_end"] - ticks["time"] * sample_rate))
        felt = np.concatenate([np.zeros(0, np.float32), *self._vibration])
        return np.concatenate((np.zeros(max(0, -first), np.float32), felt[max(0, first) :]))

    def write_timeline(self, path: Path) -> None:
        """Write what was believed and felt, as `tactophone feel` does; times are those of the sound's arrival."""
        judged = self.ticks[np.isfinite(self.ticks["probabilities"]).all(axis=1)]
        with TimelineWriter(path) as timeline:
            for tick in judged:
                timeline.write(_as_tick(tick))

    def _watch(self) -> None:
        while not self._ended.wait(LOOK_EVERY):
            self._look()

    def _look(self) -> None:
        with contextlib.suppress(OSError):  # the run has ended and taken its memory along
            self._last = self._watcher.snapshot(self._last)
            self._ticks.append(self._last.ticks)
            self._vibration.append(self._last.vibration)


def _as_tick(tick: Any) -> PipelineStep:
    none, smooth, rough = (float(share) for share in tick["probabilities"])
    time, touch = float(tick["time"]), Touch(int(tick["touch"]))
    belief = Prediction(
        (none, smooth, rough), touch, float(tick["roughness"]), float(tick["level_dbfs"]), start=time, end=time
    )
    command = HapticCommand(float(tick["amplitude"]), float(tick["frequency"]), time)
    return PipelineStep(AudioBlock(np.empty((0, 1), np.float32), 48_000), (belief,), (command,))
