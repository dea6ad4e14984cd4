"""A JACK server of our own, without a sound card: for measuring, demonstrating and testing."""

import os
import shutil
import subprocess
import tempfile
import time
from types import TracebackType
from typing import Self

from tactophone.devices.jack import JackClient, silent
from tactophone.errors import DeviceError

_ATTEMPTS = 400
_BETWEEN_ATTEMPTS = 0.025
"""Seconds; `jack_wait` looks only once a second."""


class DummyServer:
    """``jackd`` with its dummy driver, under a name of its own; a context manager.

    Parameters
    ----------
    period
        Samples a period.
    name
        The server's name; by default one that no other process uses.
    synchronous
        Whether a period is only over when all clients are done. JACK's own default is not: it goes on without a client
        that is late, and repeats that client's last period.

    Notes
    -----
    The dummy driver hands over each period at the period's beginning, where a card does at its end. One process can be
    a client of one server at a time only: libjack keeps the server in global variables.
    """

    def __init__(
        self, period: int = 128, *, sample_rate: int = 48_000, name: str = "", synchronous: bool = True
    ) -> None:
        self.name = name or f"tactophone-{os.getpid()}-{id(self):x}"
        self.period, self.sample_rate = period, sample_rate
        self._mode = ["-S"] if synchronous else []
        self._process: subprocess.Popen[bytes] | None = None
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the server

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    def start(self) -> None:
        """Start it and wait until clients can join; real-time scheduling where that is allowed."""
        if shutil.which("jackd") is None:
            raise DeviceError("jackd is not installed: `apt install jackd2`")
        schedule = ["-R", "-P", "70"] if _may_be_realtime() else ["-r"]
        command = ["jackd", "-n", self.name, *schedule, *self._mode, "-d", "dummy"]
        self._process = subprocess.Popen(
            [*command, "-r", str(self.sample_rate), "-p", str(self.period)],
            stdout=self._log,
            stderr=self._log,
            start_new_session=True,  # an interrupt from the keyboard is for us: who measures ends the server in order
        )
        for _ in range(_ATTEMPTS):
            if self._process.poll() is not None:
                raise DeviceError(f"jackd did not start: {self._last_words()}")
            if self._answers():
                return
            time.sleep(_BETWEEN_ATTEMPTS)
        self.kill()
        raise DeviceError(f"jackd gave no answer for {_ATTEMPTS * _BETWEEN_ATTEMPTS:g} s: {self._last_words()}")

    def stop(self) -> None:
        """End it in order."""
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self.kill()

    def kill(self) -> None:
        """End it as a crash would."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _answers(self) -> bool:
        probe = JackClient("probe", silent, inputs={}, outputs={}, server=self.name)
        try:
            probe.open()
        except DeviceError:
            return False
        probe.close()
        return True

    def _last_words(self) -> str:
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else "it said nothing"


def _may_be_realtime() -> bool:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(70))
    except PermissionError:
        return False
    os.sched_setscheduler(0, *before)
    return True
