"""A microphone in another process: sound arrives in messages over a pipe, as from the page that records it."""

import threading
import time
from multiprocessing.connection import Connection

import numpy as np

from tactophone.devices.device import Process
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray

SILENT_AFTER = 1.0
"""Seconds without a message after which the sender counts as absent."""

_WAIT = 0.1
"""Seconds between two checks for the end."""


class StreamDevice:
    """A `tactophone.devices.Device` fed by messages of a uint32 position and float32 samples, little-endian.

    ``absent`` is what to do while no sound arrives: the text of the fault.
    """

    process_faults = 0
    latency = 0.0
    sample_rate = LIVE_SAMPLE_RATE

    def __init__(self, sound: Connection, process: Process, *, absent: str) -> None:
        self.xruns = self.losses = 0
        self._sound, self._process, self._absent = sound, process, absent
        self._next = 0
        self._received_at = -SILENT_AFTER
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None

    @property
    def fault(self) -> str:
        """What is wrong now; empty when nothing is."""
        return self._absent if time.monotonic() - self._received_at > SILENT_AFTER else ""

    def open(self) -> None:
        """Start to read; sound that arrived before is out of date and dropped."""
        while self._sound.poll():
            self._sound.recv_bytes()
        self._ended.clear()
        self._thread = threading.Thread(target=self._run, name="microphone", daemon=True)
        self._thread.start()

    def revive(self) -> None:
        """Do nothing: the sender comes back by itself."""

    def close(self) -> None:
        """Stop to read."""
        self._ended.set()
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join()
            self._thread = None

    def _run(self) -> None:
        while not self._ended.is_set():
            try:
                if self._sound.poll(_WAIT):
                    self._take(self._sound.recv_bytes())
            except (EOFError, OSError):
                return  # the page's process has ended: the fault says that no sound arrives

    def _take(self, message: bytes) -> None:
        position = int.from_bytes(message[:4], "little")
        samples: FloatArray = np.frombuffer(message, "<f4", offset=4).astype(np.float32)
        now = time.monotonic()
        if now - self._received_at > SILENT_AFTER:
            self.losses += self._received_at > 0
        elif position != self._next:
            self.xruns += 1  # sound was dropped on the way; windows join what is left
        self._next, self._received_at = (position + len(samples)) % (1 << 32), now
        self._process([samples], [])
