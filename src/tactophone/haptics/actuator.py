"""Where the vibration goes: a voice coil's amplifier behind JACK or PortAudio, a WAV file, or nothing.

An actuator calls for the waveform, period by period, in a thread of its own; what it is given it plays. All four
obey one contract, and the rest of the program cannot tell them apart.
"""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Protocol, Self, TypeAlias

from tactophone.devices import ClockedDevice, Device, JackClient, PortAudioStream
from tactophone.devices.device import Process
from tactophone.errors import DeviceError
from tactophone.types import FloatArray

Render: TypeAlias = Callable[[FloatArray], None]
"""Writes the next samples of the waveform in place; its array has shape ``(samples,)``."""


class Actuator(Protocol):
    """Plays what ``render`` writes; a context manager. Never raises once entered, and silent whenever in doubt."""

    @property
    def device(self) -> Device:
        """The device behind it: its rate, delay, faults and counts."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class DeviceActuator:
    """An `Actuator` on any device; use `jack_actuator`, `portaudio_actuator` or `clocked_actuator` to make one."""

    def __init__(self, device: Device, *, sample_rate: int = 48_000) -> None:
        self.device = device
        self._sample_rate = sample_rate

    def __enter__(self) -> Self:
        self.device.open()
        if self.device.sample_rate != self._sample_rate:
            found = self.device.sample_rate
            self.device.close()
            raise DeviceError(
                f"the actuator's device runs at {found} Hz, but {self._sample_rate} Hz is wanted: start it with that "
                f"rate (jackd ... -r {self._sample_rate})"
            )
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.device.close()


def jack_actuator(
    render: Render, *, port: str = "system:playback_1", server: str = "", name: str = "tactophone-operator"
) -> DeviceActuator:
    """Play on a JACK port; ``"-"`` leaves the output unwired, for a patch bay to wire."""
    wires = {"vibration": port.removeprefix("-")}
    return DeviceActuator(JackClient(name, _only_output(render), inputs={}, outputs=wires, server=server))


def portaudio_actuator(render: Render, *, device: str = "", sample_rate: int = 48_000) -> DeviceActuator:
    """Play on the first channel of a PortAudio device, given by number or part of its name."""
    stream = PortAudioStream(_only_output(render), "output", device=device, sample_rate=sample_rate)
    return DeviceActuator(stream, sample_rate=sample_rate)


def clocked_actuator(
    render: Render, *, period: int = 128, sample_rate: int = 48_000, path: Path | None = None
) -> DeviceActuator:
    """Call for the waveform at the pace of the clock; write it to a WAV file, or let it go."""
    device = ClockedDevice(_only_output(render), period=period, sample_rate=sample_rate, path=path)
    return DeviceActuator(device, sample_rate=sample_rate)


def _only_output(render: Render) -> Process:
    def process(_: list[FloatArray], outputs: list[FloatArray]) -> None:
        render(outputs[0])

    return process
