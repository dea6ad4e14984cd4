"""The contract of a sound device, which calls periodically and may be lost at any time;
and a page's microphone."""

import threading
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Protocol, TypeAlias

import numpy as np

from tactophone.core.errors import DeviceError
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray

SILENT_AFTER = 1.0
"""Seconds without a message after which the sender of a `StreamDevice` counts as
absent."""

_WAIT = 0.1
"""Seconds between two checks for the end of a `StreamDevice`."""

Process: TypeAlias = Callable[[list[FloatArray], list[FloatArray]], None]
"""What a device calls each period, with one array of shape ``(samples,)`` for each
input and each output.

It runs in the device's own thread: it copies the input or renders the output, and
returns. If it raises, the period is silent and counted, and the next one is requested
as usual.
"""


class Device(Protocol):
    """A sound device behind JACK or PortAudio.

    A device never raises after `open`. When it is lost, its ``fault`` says so, the
    process is no longer called and the output is silent; `revive`, called regularly,
    reconnects it as soon as it is available.
    """

    process_faults: int
    """Periods in which the process raised an exception."""

    @property
    def xruns(self) -> int:
        """Periods lost since `open`, as counted by the system."""

    @property
    def losses(self) -> int:
        """Times that the device was lost."""

    @property
    def lost(self) -> bool:
        """Whether it is lost now, and `revive` would reconnect it."""

    @property
    def sample_rate(self) -> int:
        """In Hz."""

    @property
    def latency(self) -> float:
        """Delay in s that the device reports."""

    @property
    def fault(self) -> str:
        """What is wrong now and what to do; empty when nothing is."""

    def open(self) -> None:
        """Start; raises `DeviceError` with the candidates when the device is missing or
        unsuitable."""

    def revive(self) -> None:
        """Try to reconnect, if lost, which may take seconds."""

    def close(self) -> None:
        """Stop; silent from here on."""


def open_at_live_rate(device: Device) -> None:
    """Open a device; raises `DeviceError`, with the device closed, if it does not run
    at `LIVE_SAMPLE_RATE`."""
    device.open()
    found = device.sample_rate
    if found != LIVE_SAMPLE_RATE:
        device.close()
        raise DeviceError(
            f"the sound device runs at {found} Hz, but {LIVE_SAMPLE_RATE} Hz is "
            f"needed: start it with that rate (jackd ... -r {LIVE_SAMPLE_RATE})"
        )


class ThreadedDevice:
    """Base of the devices that a thread of our own calls."""

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(self, process: Process, *, thread: str) -> None:
        self.xruns = 0
        self.process_faults = 0
        self.losses = 0
        self._process = process
        self._name = thread
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        self._ended.clear()
        self._thread = threading.Thread(target=self._run, name=self._name, daemon=True)
        self._thread.start()

    @property
    def lost(self) -> bool:
        return False

    def revive(self) -> None:
        """Do nothing: what may be lost comes back by itself."""

    def close(self) -> None:
        """End the thread; a process that closes its own device is not waited for."""
        self._ended.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        raise NotImplementedError

    def _render(self, waveform: FloatArray) -> None:
        """Render a period, shape ``(outputs, samples)``; one that fails is silent and
        counted, as on a sound card."""
        try:
            self._process([], list(waveform))
        except Exception:
            self.process_faults += 1
            waveform[:] = 0.0


class StreamDevice(ThreadedDevice):
    """A microphone in another process, as a page: fed by messages of a uint32 position
    and float32 samples.

    Both are little-endian. ``absent`` is what to do while no sound arrives: the text of
    the fault.
    """

    latency = 0.0

    def __init__(self, sound: Connection, process: Process, *, absent: str) -> None:
        super().__init__(process, thread="microphone")
        self._sound = sound
        self._absent = absent
        self._next = 0
        self._received_at = -SILENT_AFTER

    @property
    def fault(self) -> str:
        silence = time.monotonic() - self._received_at
        return self._absent if silence > SILENT_AFTER else ""

    def open(self) -> None:
        """Start to read; sound that arrived before is out of date and dropped."""
        while self._sound.poll():
            self._sound.recv_bytes()
        super().open()

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                if self._sound.poll(_WAIT):
                    self._take(self._sound.recv_bytes())
            except (EOFError, OSError):
                # The page's process has ended: the fault says that no sound arrives.
                return

    def _take(self, message: bytes) -> None:
        position = int.from_bytes(message[:4], "little")
        samples: FloatArray = np.frombuffer(message, "<f4", offset=4).astype(np.float32)
        now = time.monotonic()
        if now - self._received_at > SILENT_AFTER:
            self.losses += self._received_at > 0
        elif position != self._next:
            # Sound was dropped on the way; windows join what is left.
            self.xruns += 1
        self._next = (position + len(samples)) % (1 << 32)
        self._received_at = now
        self._process([samples], [])
