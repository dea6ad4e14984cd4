"""The contract of a sound device: it calls for sound periodically, may go away at any time and comes back."""

from collections.abc import Callable
from typing import Protocol, TypeAlias

from tactophone.types import FloatArray

Process: TypeAlias = Callable[[list[FloatArray], list[FloatArray]], None]
"""What a device calls each period, with one array of shape ``(samples,)`` for each input and each output.

It runs in the device's own thread: it copies in or renders out and leaves. If it raises, the period is silent and
counted, and the next one is asked for as if nothing had happened.
"""


class Device(Protocol):
    """A sound device behind JACK or PortAudio.

    A device never raises after `open`: when it is lost, its ``fault`` says so in words, the process is no longer
    called, the output is silent, and `revive`, called now and then, brings it back as soon as it can be had.
    """

    xruns: int
    """Periods lost since `open`, as the system counts them."""

    process_faults: int
    """Periods that the process failed."""

    losses: int
    """Times that the device went away."""

    @property
    def sample_rate(self) -> int:
        """In Hz."""
        ...

    @property
    def latency(self) -> float:
        """Seconds that the device itself adds, as it says."""
        ...

    @property
    def fault(self) -> str:
        """What is wrong now and what to do, in words; empty when nothing is."""
        ...

    def open(self) -> None:
        """Begin; `DeviceError` with the candidates when the device is missing or not fit."""
        ...

    def revive(self) -> None:
        """Try to come back, if lost."""
        ...

    def close(self) -> None:
        """End; silent from here on."""
        ...
