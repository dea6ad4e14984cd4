"""PortAudio streams that reconnect, for systems without JACK.

The block size is left to PortAudio (``blocksize=0``): requesting the device's own
period costs one period more (measured: 128 samples become 256).
"""

import contextlib
from dataclasses import dataclass
from typing import Any, Literal

from tactophone.core.errors import DeviceError
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.live.audio.device import Process


@dataclass(frozen=True, slots=True)
class PortAudioDevice:
    """A device as PortAudio lists it; latencies in s."""

    index: int
    name: str
    system: str
    inputs: int
    outputs: int
    sample_rate: float
    input_latency: float
    output_latency: float


class PortAudioStream:
    """One direction of a PortAudio device, given by number or part of its name; empty
    is the system's default."""

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(
        self,
        process: Process,
        direction: Literal["input", "output"],
        *,
        device: str = "",
        channels: int = 1,
    ) -> None:
        self.xruns = 0
        self.process_faults = 0
        self.losses = 0
        self._process = process
        self._direction = direction
        self._device = device
        self._channels = channels
        self._system = ""
        self._stream: Any = None

    @property
    def latency(self) -> float:
        return float(self._stream.latency) if self._stream else 0.0

    @property
    def fault(self) -> str:
        if self._stream is None or not self._stream.active:
            which = self._device or "the default device"
            return (
                f"PortAudio lost {which}: plug it in again, and the stream reconnects"
            )
        return ""

    def open(self) -> None:
        """Start the stream; raises `DeviceError` when no device matches; the message
        lists the candidates."""
        sound = _sounddevice()
        chosen = self._choose(sound)
        try:
            stream = self._make(sound, chosen.index)
            stream.start()
        except sound.PortAudioError as error:
            raise DeviceError(
                f"{chosen.name} does not support {self._channels} channels "
                f"at {self.sample_rate} Hz ({error.args[0]}): "
                "choose another with `tactophone devices`"
            ) from None
        self._stream = stream
        self._system = chosen.system

    def revive(self) -> None:
        """Open again if the stream has stopped; PortAudio must be initialised again to
        find a device that came back.

        On top of JACK this is impossible: PortAudio aborts the whole process when it
        ends after its JACK server.
        """
        running = self._stream is not None and self._stream.active
        if running or self._system.startswith("JACK"):
            return
        if self._stream is not None:
            self.losses += 1
        self.close()
        sound = _sounddevice()
        # sounddevice documents these two for this purpose, though their names are
        # private.
        sound._terminate()
        sound._initialize()
        with contextlib.suppress(DeviceError):
            self.open()

    def close(self) -> None:
        stream = self._stream
        self._stream = None
        if stream is not None:
            with contextlib.suppress(_sounddevice().PortAudioError):
                stream.abort()
                stream.close()

    def _choose(self, sound: Any) -> PortAudioDevice:
        """Return the only device that matches; several or none are an error that lists
        them."""
        known = [
            device
            for device in devices()
            if getattr(device, f"{self._direction}s") >= self._channels
        ]
        if not self._device:
            default = sound.default.device[self._direction]
            matching = [device for device in known if device.index == default]
        elif self._device.isdigit():
            number = int(self._device)
            matching = [device for device in known if device.index == number]
        else:
            part = self._device.lower()
            matching = [device for device in known if part in device.name.lower()]
        if len(matching) == 1:
            return matching[0]
        listed = "; ".join(
            f"{device.index} {device.name} ({device.system})"
            for device in matching or known
        )
        raise DeviceError(
            f"{len(matching)} PortAudio devices for {self._direction} match "
            f"{self._device or 'the default'!r}, but exactly one with "
            f"{self._channels} channels must; there are: {listed or 'none'}"
        )

    def _make(self, sound: Any, index: int) -> Any:
        opened = sound.InputStream if self._direction == "input" else sound.OutputStream
        return opened(
            device=index,
            channels=self._channels,
            samplerate=self.sample_rate,
            blocksize=0,
            latency="low",
            dtype="float32",
            callback=self._call,
        )

    def _call(self, block: FloatArray, _size: int, _time: Any, flags: Any) -> None:
        self.xruns += bool(flags)
        playing = self._direction == "output"
        channels = list(block.T)
        try:
            if playing:
                self._process([], channels)
            else:
                self._process(channels, [])
        except Exception:  # PortAudio would stop the stream
            self.process_faults += 1
            if playing:
                block[:] = 0.0


def devices() -> list[PortAudioDevice]:
    sound = _sounddevice()
    systems = [system["name"] for system in sound.query_hostapis()]
    return [
        PortAudioDevice(
            index=int(entry["index"]),
            name=str(entry["name"]),
            system=systems[entry["hostapi"]],
            inputs=int(entry["max_input_channels"]),
            outputs=int(entry["max_output_channels"]),
            sample_rate=float(entry["default_samplerate"]),
            input_latency=float(entry["default_low_input_latency"]),
            output_latency=float(entry["default_low_output_latency"]),
        )
        for entry in sound.query_devices()
    ]


def _sounddevice() -> Any:
    try:
        import sounddevice
    except ImportError:
        raise DeviceError(
            "sounddevice is not installed: `pip install 'tactophone[portaudio]'`"
        ) from None
    except OSError:
        raise DeviceError(
            "libportaudio2 is not installed: `apt install libportaudio2`"
        ) from None
    return sounddevice
