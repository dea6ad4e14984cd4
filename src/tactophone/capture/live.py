"""Sound from a device, block by block, through losses and overflows.

The device's own thread copies a period into a queue and leaves; whoever iterates takes it out. When nobody does for
longer than `LONGEST_WAIT`, sound is dropped and counted rather than queued: old sound is of no use to a finger.
"""

import queue
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self

import numpy as np

from tactophone.devices import Device
from tactophone.devices.device import Process
from tactophone.errors import DeviceError
from tactophone.types import AudioBlock, FloatArray

LONGEST_WAIT = 0.1
"""Seconds of sound that may wait to be fetched: the time after which the dead-man has silenced the finger anyway."""

REVIVE_EVERY = 0.25
"""Seconds without sound after which the device is asked to come back, and again after as long."""


class LiveSource:
    """A `tactophone.types.Source` on a sound device.

    Parameters
    ----------
    open_device
        Makes the device around the process that takes its sound.
    channels
        1 (contact) or 2 (contact, air).
    sample_rate
        The only rate that is accepted, in Hz.
    """

    def __init__(self, open_device: Callable[[Process], Device], *, channels: int, sample_rate: int = 48_000) -> None:
        self.overflows = 0
        self._queue: queue.SimpleQueue[AudioBlock | None] = queue.SimpleQueue()
        self._waiting = 0
        self._position = 0
        self._channels, self._sample_rate = channels, sample_rate
        self._open = False
        self.device = open_device(self._hear)

    @property
    def sample_rate(self) -> int:
        """In Hz."""
        return self._sample_rate

    @property
    def channels(self) -> int:
        """1 or 2; channel 0 is contact."""
        return self._channels

    @property
    def fault(self) -> str:
        """What is wrong with the device now, in words; empty when nothing is."""
        return self.device.fault

    def __enter__(self) -> Self:
        self.device.open()
        if self.device.sample_rate != self._sample_rate:
            found = self.device.sample_rate
            self.device.close()
            raise DeviceError(
                f"the sound device runs at {found} Hz, but {self._sample_rate} Hz is wanted: start it with that rate "
                f"(jackd ... -r {self._sample_rate})"
            )
        self._open = True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the sound, also from another thread: whoever iterates comes to the end."""
        self._open = False
        self._queue.put(None)
        self.device.close()

    def __iter__(self) -> Iterator[AudioBlock]:
        while self._open:
            try:
                block = self._queue.get(timeout=REVIVE_EVERY)
            except queue.Empty:
                self.device.revive()
                continue
            if block is None:
                return
            self._waiting -= block.size
            yield block

    def _hear(self, inputs: list[FloatArray], _: list[FloatArray]) -> None:
        start = self._position
        self._position = start + len(inputs[0])
        if self._waiting > LONGEST_WAIT * self._sample_rate:
            self.overflows += 1
            return
        samples = np.stack(inputs, axis=1)
        self._waiting += len(samples)
        self._queue.put(AudioBlock(samples, sample_rate=self._sample_rate, start=start))
