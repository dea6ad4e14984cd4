"""The contract of a sound device: it calls periodically, may be lost at any time and reconnects."""

from collections.abc import Callable
from typing import Protocol, TypeAlias

from tactophone.errors import DeviceError
from tactophone.types import FloatArray

Process: TypeAlias = Callable[[list[FloatArray], list[FloatArray]], None]
"""What a device calls each period, with one array of shape ``(samples,)`` for each input and each output.

It runs in the device's own thread: it copies the input or renders the output, and returns. If it raises, the period is
silent and counted, and the next one is requested as usual.
"""


class Device(Protocol):
    """A sound device behind JACK or PortAudio.

    A device never raises after `open`. When it is lost, its ``fault`` says so, the process is no longer called and the
    output is silent; `revive`, called regularly, reconnects it as soon as it is available.
    """

    xruns: int
    """Periods lost since `open`, as counted by the system."""

    process_faults: int
    """Periods in which the process raised."""

    losses: int
    """Times that the device was lost."""

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
        """Start; raises `DeviceError` with the candidates when the device is missing or unsuitable."""

    def revive(self) -> None:
        """Try to reconnect, if lost."""

    def close(self) -> None:
        """Stop; silent from here on."""


def open_at_rate(device: Device, sample_rate: int) -> None:
    """Open a device that must run at a rate in Hz; raises `DeviceError`, with the device closed, if it does not."""
    device.open()
    found = device.sample_rate
    if found != sample_rate:
        device.close()
        raise DeviceError(
            f"the sound device runs at {found} Hz, but {sample_rate} Hz is needed: start it with that rate "
            f"(jackd ... -r {sample_rate})"
        )
