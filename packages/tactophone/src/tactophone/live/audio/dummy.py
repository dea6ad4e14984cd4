"""A private JACK server without a sound card, for measurements, demonstrations and
tests."""

import ctypes
import os
import shutil
import signal
import subprocess
import tempfile
import time
from typing import Self

from tactophone.core.errors import DeviceError
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.live.audio.jack import JackClient
from tactophone.live.audio.jack_files import damage

_ATTEMPTS = 400
"""Checks whether the server answers, before it is given up."""

_BETWEEN_ATTEMPTS = 0.025
"""Seconds between two checks; `jack_wait` checks only once a second."""

_MOST_PORTS = "128"
"""Ports of all clients: a hand of ten fingers has 40 at both ends. JACK's default,
2048, makes memory for 105 MB, which it locks in every client; this is 42 MB."""

_PRCTL = getattr(ctypes.CDLL(None), "prctl", None)
"""The C library's function; ``None`` elsewhere than on Linux. It is looked up here, as
a forked child must not load libraries."""


class DummyServer:
    """``jackd`` with its dummy driver under a private name; a context manager.

    - ``period``: samples a period.
    - ``outputs``: playback ports of the server.
    - ``synchronous``: whether a period ends only when all clients are done. JACK's
      default is false: it goes on without a late client, and repeats that client's last
      period.

    The dummy driver delivers each period at its beginning, a sound card at its end. A
    process can be a client of only one server at a time: libjack keeps the server in
    global variables.
    """

    def __init__(
        self,
        period: int = 128,
        *,
        sample_rate: int = LIVE_SAMPLE_RATE,
        outputs: int = 2,
        synchronous: bool = True,
    ) -> None:
        self.name = f"tactophone-{os.getpid()}-{id(self):x}"
        self.period = period
        self.sample_rate = sample_rate
        self._outputs = outputs
        self._mode = ["-S"] if synchronous else []
        self._process: subprocess.Popen[bytes] | None = None
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as the server

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def pid(self) -> int:
        """Process id of the server; 0 before it is started."""
        return self._process.pid if self._process else 0

    def start(self) -> None:
        """Start the server and wait until clients can join; with real-time scheduling
        where that is allowed."""
        if shutil.which("jackd") is None:
            raise DeviceError("jackd is not installed: `apt install jackd2`")
        if damaged := damage():
            raise DeviceError(damaged)
        schedule = ["-R", "-P", "70"] if _may_be_realtime() else ["-r"]
        server = ["jackd", "-n", self.name, "-p", _MOST_PORTS, *schedule, *self._mode]
        driver = ["-d", "dummy", "-r", str(self.sample_rate), "-p", str(self.period)]
        # In a session of its own, Ctrl-C does not reach the server: this process stops
        # it. No other thread holds a lock that `_end_with_parent` needs.
        self._process = subprocess.Popen(
            [*server, *driver, "-P", str(self._outputs)],
            stdout=self._log,
            stderr=self._log,
            start_new_session=True,
            preexec_fn=_end_with_parent,  # noqa: PLW1509
        )
        for _ in range(_ATTEMPTS):
            if self._process.poll() is not None:
                raise DeviceError(f"jackd did not start: {self._reason()}")
            if self._answers():
                return
            time.sleep(_BETWEEN_ATTEMPTS)
        self.stop()
        raise DeviceError(
            f"jackd did not answer for {_ATTEMPTS * _BETWEEN_ATTEMPTS:g} s: "
            f"{self._last_line()}"
        )

    def stop(self) -> None:
        if self._process is not None and self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self.kill()

    def kill(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def _answers(self) -> bool:
        probe = JackClient("probe", None, inputs={}, outputs={}, server=self.name)
        try:
            probe.open()
        except DeviceError:
            return False
        probe.close()
        return True

    def _reason(self) -> str:
        if "Too many servers" in self._output():
            return (
                "JACK's list of 8 servers is full, as killed servers stay in it; "
                "end the servers that you do not need, "
                "or, if none runs, delete /dev/shm/jack-shm-registry"
            )
        return self._last_line()

    def _last_line(self) -> str:
        lines = self._output().strip().splitlines()
        return lines[-1] if lines else "it printed nothing"

    def _output(self) -> str:
        self._log.seek(0)
        return self._log.read().decode(errors="replace")


def _end_with_parent() -> None:
    """Have the kernel end this process when its parent ends, however that ends (Linux:
    PR_SET_PDEATHSIG)."""
    if _PRCTL is not None:
        _PRCTL(1, signal.SIGTERM)


def _may_be_realtime() -> bool:
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(70))
    except PermissionError:
        return False
    os.sched_setscheduler(0, *before)
    return True
