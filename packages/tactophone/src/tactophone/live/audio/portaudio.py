"""PortAudio streams that reconnect, for systems without JACK.

The block size is left to PortAudio (``blocksize=0``): requesting the device's own
period costs one period more (measured: 128 samples become 256).
"""

import contextlib
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from tactophone.core.errors import DeviceError
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.live.audio.device import Process
from tactophone.live.audio.jack_files import damage


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

    @property
    def card(self) -> str:
        """Name without the number that ALSA gives a card in the order of plugging."""
        return re.sub(r" \(hw:\d+,\d+\)$", "", self.name)


class PortAudioStream:
    """One direction of a PortAudio device, given by number or part of its name; empty
    is the system's default.

    It reconnects to the device that it began with and to no other: when a sound card is
    unplugged, its number, or the place of the default, goes to another, which may be a
    loudspeaker.
    """

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
        self._held: PortAudioDevice | None = None
        """The device that the stream began with."""
        self._refused = ""
        """Why the device has not come back."""
        self._stream: Any = None

    @property
    def latency(self) -> float:
        return float(self._stream.latency) if self._stream else 0.0

    @property
    def lost(self) -> bool:
        return self._stream is None or not self._stream.active

    @property
    def fault(self) -> str:
        if not self.lost:
            return ""
        which = self._device or "the default device"
        if self._held:
            which = self._held.name
        why = f" ({self._refused})" if self._refused else ""
        return (
            f"PortAudio lost {which}{why}: plug it in again, and the stream "
            "reconnects; to use another, start the run again"
        )

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
        self._held = chosen
        self._refused = ""

    def revive(self) -> None:
        """Open again if the stream has stopped; PortAudio must be initialised again to
        find a device that came back.

        On top of JACK this is impossible: PortAudio aborts the whole process when it
        ends after its JACK server.
        """
        on_jack = self._held is not None and self._held.system.startswith("JACK")
        if not self.lost or on_jack:
            return
        if self._stream is not None:
            self.losses += 1
        self.close()
        if damaged := damage():
            self._refused = damaged
            return
        sound = _sounddevice()
        # sounddevice documents these two for this purpose, though their names are
        # private.
        sound._terminate()
        sound._initialize()
        try:
            self.open()
        except DeviceError as error:
            self._refused = str(error)

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
        if self._held:
            return self._held_among(known)
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
        raise DeviceError(
            f"{len(matching)} PortAudio devices for {self._direction} match "
            f"{self._device or 'the default'!r}, but exactly one with "
            f"{self._channels} channels must; there are: {_listed(matching or known)}"
        )

    def _held_among(self, known: Sequence[PortAudioDevice]) -> PortAudioDevice:
        """Return the device that the stream began with, wherever it is plugged in
        now."""
        held = self._held
        assert held is not None
        same = [
            device
            for device in known
            if (device.system, device.card) == (held.system, held.card)
        ]
        # Of two cards of one kind, it is the one with the same number.
        exact = [device for device in same if device.name == held.name]
        if len(exact or same) != 1:
            raise DeviceError(
                f"devices for {self._direction} with {self._channels} channels now: "
                f"{_listed(known)}"
            )
        return (exact or same)[0]

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


def _listed(found: Sequence[PortAudioDevice]) -> str:
    """Return devices in words, as `tactophone devices` names them."""
    named = [f"{device.index} {device.name} ({device.system})" for device in found]
    return "; ".join(named) or "none"


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
    # PortAudio asks libjack for its devices when it is loaded.
    if "sounddevice" not in sys.modules and (damaged := damage()):
        raise DeviceError(damaged)
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
