"""A device without hardware, paced by the system clock, that plays into a WAV file or nowhere."""

import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from tactophone.devices.device import Process
from tactophone.errors import DeviceError
from tactophone.types import FloatArray


class ClockedDevice:
    """A device without hardware: a thread that requests one period after another in step with the clock.

    After a stall it catches up with at most `_LONGEST_DELAY` s; a longer stall counts as one lost period.
    """

    _LONGEST_DELAY = 0.1

    def __init__(
        self, process: Process, *, period: int, sample_rate: int, path: Path | None = None, outputs: int = 1
    ) -> None:
        self.xruns = self.process_faults = self.losses = 0
        self.sample_rate = sample_rate
        self._process, self._period, self._path, self._outputs = process, period, path, outputs
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._fault = ""

    @property
    def latency(self) -> float:
        """Seconds of one period."""
        return self._period / self.sample_rate

    @property
    def fault(self) -> str:
        """What is wrong now, such as a file that cannot be written; empty when nothing is."""
        return self._fault

    def open(self) -> None:
        """Start; the file, if any, is overwritten."""
        self._file = self._open_file() if self._path else None
        self._ended.clear()
        self._thread = threading.Thread(target=self._run, name="actuator", daemon=True)
        self._thread.start()

    def revive(self) -> None:
        """Do nothing: only the file can fail, and writing to a full disk is not retried."""

    def close(self) -> None:
        """Stop, with the file complete."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _open_file(self) -> Any:
        import soundfile

        try:
            return soundfile.SoundFile(self._path, "w", self.sample_rate, self._outputs, "FLOAT")
        except (OSError, soundfile.LibsndfileError) as error:
            raise DeviceError(
                f"{self._path} cannot be written ({error}): choose another file for output.device"
            ) from None

    def _run(self) -> None:
        waveform = np.zeros((self._outputs, self._period), np.float32)
        due = time.monotonic()
        while not self._ended.wait(max(0.0, due - time.monotonic())):
            if time.monotonic() - due > self._LONGEST_DELAY:
                self.xruns += 1
                due = time.monotonic()
            self._cycle(waveform)
            due += self.latency
        if self._file is not None:
            self._file.close()

    def _cycle(self, waveform: FloatArray) -> None:
        try:
            self._process([], list(waveform))
        except Exception:  # as with a real device, a failed period is silent and the next one is requested
            self.process_faults += 1
            waveform[:] = 0.0
        if self._file is not None and not self._fault:
            try:
                self._file.write(waveform.T)
            except Exception as error:
                self._fault = f"{self._path} can no longer be written ({error}): free the disk, and start again"
