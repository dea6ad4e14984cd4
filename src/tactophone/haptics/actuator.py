"""Where the vibration goes: the actuator's amplifier behind JACK or PortAudio, a gamepad, a WAV file, or nothing.

An actuator requests the waveform, period by period, in a thread of its own, and plays it. All five obey one contract.
"""

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self, TypeAlias

from tactophone.devices import ClockedDevice, Device, GamepadDevice, JackClient, PortAudioStream, Process, open_at_rate
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray

Render: TypeAlias = Callable[[FloatArray], None]
"""Writes the next samples of the waveform in place; its array has shape ``(samples,)``."""


class Actuator(Protocol):
    """Plays what ``render`` writes; a context manager. Once entered it never raises, and every fault is silence."""

    @property
    def device(self) -> Device:
        """Its device, with rate, delay, faults and counts."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class DeviceActuator:
    """An `Actuator` on any device; made by `jack_actuator`, `portaudio_actuator` or `clocked_actuator`."""

    def __init__(self, device: Device, *, sample_rate: int = LIVE_SAMPLE_RATE) -> None:
        self.device = device
        self._sample_rate = sample_rate

    def __enter__(self) -> Self:
        open_at_rate(self.device, self._sample_rate)
        return self

    def __exit__(self, *_: object) -> None:
        self.device.close()


def jack_actuator(
    render: Render, *, port: str = "system:playback_1", server: str = "", name: str = "tactophone-operator"
) -> DeviceActuator:
    """Play on a JACK port; ``"-"`` leaves the output unconnected, for a patch bay."""
    wires = {"vibration": port.removeprefix("-")}
    return DeviceActuator(JackClient(name, _only_output(render), inputs={}, outputs=wires, server=server))


def portaudio_actuator(
    render: Render, *, device: str = "", channel: int = 1, sample_rate: int = LIVE_SAMPLE_RATE
) -> DeviceActuator:
    """Play on one channel of a PortAudio device, given by number or part of its name; the other channels are silent.

    Parameters
    ----------
    channel
        Counted from 1. Beyond the first, channels are opened in pairs, because sound servers name them by their number:
        four are front and rear left and right, as a DualSense expects, but three would be left, right and bass.
    """
    channels = 1 if channel == 1 else channel + channel % 2
    process = _only_output(render, channel)
    stream = PortAudioStream(process, "output", device=device, channels=channels, sample_rate=sample_rate)
    return DeviceActuator(stream, sample_rate=sample_rate)


def gamepad_actuator(
    render: Render,
    *,
    device: str = "",
    roughness: Callable[[], float],
    ceiling: Callable[[], float],
    find: Callable[[], list[Any]] | None = None,
) -> DeviceActuator:
    """Turn the motors of a gamepad; arguments as of `tactophone.devices.GamepadDevice`."""
    return DeviceActuator(
        GamepadDevice(_only_output(render), device=device, roughness=roughness, ceiling=ceiling, find=find)
    )


def clocked_actuator(
    render: Render, *, period: int = 128, sample_rate: int = LIVE_SAMPLE_RATE, path: Path | None = None
) -> DeviceActuator:
    """Request the waveform in step with the system clock; write it to a WAV file, or discard it."""
    device = ClockedDevice(_only_output(render), period=period, sample_rate=sample_rate, path=path)
    return DeviceActuator(device, sample_rate=sample_rate)


def _only_output(render: Render, channel: int = 1) -> Process:
    def process(_: list[FloatArray], outputs: list[FloatArray]) -> None:
        # A sound library reuses its buffers, so a channel that nobody writes would repeat old samples.
        for number, output in enumerate(outputs, 1):
            if number != channel:
                output[:] = 0.0
        render(outputs[channel - 1])

    return process
