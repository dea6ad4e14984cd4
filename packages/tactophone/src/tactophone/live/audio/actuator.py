"""Where the vibration goes: the actuator's amplifier behind JACK or PortAudio, a
gamepad, a WAV file, or nothing.

An actuator requests the waveform, period by period, in a thread of its own, and plays
it. All five obey one contract.
"""

import math
import os
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, suppress
from pathlib import Path
from typing import Any, Self, TypeAlias

import numpy as np

from tactophone.core.errors import DeviceError
from tactophone.core.processes import hold, make_private, make_room
from tactophone.core.types import FloatArray
from tactophone.live.audio.device import (
    Device,
    Process,
    ThreadedDevice,
    open_at_live_rate,
)
from tactophone.live.audio.gamepad import GamepadDevice
from tactophone.live.audio.jack import JackClient
from tactophone.live.audio.portaudio import PortAudioStream

Render: TypeAlias = Callable[[FloatArray], None]
"""Writes the next samples of the waveform in place; its array has shape
``(samples,)``."""

RenderHand: TypeAlias = Callable[[Sequence[FloatArray]], None]
"""The same for all fingers of a hand: an array for each."""


class Actuator(AbstractContextManager["Actuator", None]):
    """Plays on a device what ``render`` writes. Once entered it never raises, and every
    fault is silence.

    ``device`` has its rate, delay, faults and counts.
    """

    def __init__(self, device: Device) -> None:
        self.device = device

    def __enter__(self) -> Self:
        open_at_live_rate(self.device)
        return self

    def __exit__(self, *_: object) -> None:
        self.device.close()


VIBRATION_FORMATS = ("WAV", "W64")
"""Kinds of files for a vibration: of these libsndfile reads what a killed process had
written, and goes on after it."""

BYTES_PER_SAMPLE = 4
"""Of a vibration's file, whose samples are floats."""

LONGEST_CATCH_UP = 2.0
"""Seconds of a stall that a `ClockedDevice` makes up for; after a longer one, the
machine probably slept."""


class ClockedDevice(ThreadedDevice):
    """A device without hardware that requests one period after another in step with the
    clock, and writes it into a WAV file, if any.

    After a stall it catches up, so that the waveform keeps its length. After a stall
    longer than `LONGEST_CATCH_UP` its periods are lost and counted.

    A WAV file ends at 4 GB, where a fault says so; W64 holds any length.

    ``resume``: a process before this one has written part of the file, which goes on
    at its end.
    """

    def __init__(
        self,
        process: Process,
        *,
        period: int,
        path: Path | None = None,
        outputs: int = 1,
        resume: bool = False,
    ) -> None:
        super().__init__(process, thread="actuator")
        self.latency = period / self.sample_rate
        self.fault = ""
        self._period = period
        self._path = path
        self._outputs = outputs
        self._resume = resume
        self._room = math.inf
        """Samples that the file can still take."""

    def open(self) -> None:
        """Start; the file, if any, is overwritten, unless it is resumed."""
        self._file = self._open_file(self._path) if self._path else None
        if self._file is not None and self._file.format == "WAV":
            from tactophone.core.recordings.sound_file import LARGEST_WAV

            room = LARGEST_WAV // (BYTES_PER_SAMPLE * self._outputs)
            self._room = room - int(self._file.frames)
        super().open()

    def _open_file(self, path: Path) -> Any:
        import soundfile

        kind = path.suffix.removeprefix(".").upper()
        # Asked before anything is put in the place of what is there.
        if kind not in VIBRATION_FORMATS:
            raise DeviceError(
                f"{path}: no name of a file for a vibration; choose one that ends in "
                ".wav for output.device"
            )
        if self._resume and (begun := self._reopened(path)):
            return begun
        try:
            make_private(path)  # it tells when something was touched
        except OSError as error:
            raise _unwritable(path, error.strerror) from None
        try:
            file = os.open(path, os.O_RDWR)
            hold(file)
            return soundfile.SoundFile(
                file, "w", self.sample_rate, self._outputs, "FLOAT", format=kind
            )
        except (OSError, soundfile.LibsndfileError) as error:
            # On a full disk the file was made before its first byte failed.
            with suppress(OSError):
                make_room(path)
            raise _unwritable(path, error) from None

    def _reopened(self, path: Path) -> Any:
        """Return the file at its end, or nothing where no vibration of this kind is in
        it that could go on."""
        import soundfile

        with suppress(OSError, soundfile.LibsndfileError):
            descriptor = os.open(path, os.O_RDWR)
            if hold(descriptor):
                # Where it fails, libsndfile closes the descriptor, and so lets go.
                file = soundfile.SoundFile(descriptor, "r+")
                if (file.samplerate, file.channels, file.subtype) == (
                    self.sample_rate,
                    self._outputs,
                    "FLOAT",
                ):
                    file.seek(0, soundfile.SEEK_END)
                    return file
                file.close()
            else:
                os.close(descriptor)
        return None

    def _run(self) -> None:
        waveform = np.zeros((self._outputs, self._period), np.float32)
        due = time.monotonic()
        while not self._ended.wait(max(0.0, due - time.monotonic())):
            now = time.monotonic()
            if now - due > LONGEST_CATCH_UP:
                self.xruns += int((now - due) / self.latency)
                due = now
            self._render(waveform)
            due += self.latency
            if self._file is not None and not self.fault:
                self._room -= self._period
                if self._room < 0:
                    self.fault = (
                        f"{self._path} has 4 GB, the most that a WAV file holds, and "
                        "ends here: name a file that ends in .w64 for a longer run"
                    )
                    continue
                try:
                    self._file.write(waveform.T)
                except Exception as error:
                    # The fault ends the writing: the file would have a gap.
                    self.fault = (
                        f"{self._path} can no longer be written ({error}): "
                        "free the disk, and start again"
                    )
        if self._file is not None:
            self._file.close()


def _unwritable(path: Path, why: object) -> DeviceError:
    return DeviceError(
        f"{path} cannot be written ({why}): choose another file for output.device"
    )


def jack_hand_actuator(
    render: RenderHand,
    *,
    ports: Mapping[str, str],
    server: str = "",
    name: str = "tactophone-operator",
) -> Actuator:
    """Play each finger on a JACK port, by the name of the client's own port; ``"-"``
    leaves one unconnected."""
    wires = {own: port.removeprefix("-") for own, port in ports.items()}
    process = _outputs(render, range(1, len(ports) + 1))
    return Actuator(JackClient(name, process, inputs={}, outputs=wires, server=server))


def portaudio_hand_actuator(
    render: RenderHand, *, device: str = "", channels: Sequence[int]
) -> Actuator:
    """Play each finger on a channel of a PortAudio device, given by number or part of
    its name; all other channels are silent.

    ``channels``: counted from 1. Beyond the first, channels are opened in pairs,
    because sound servers name them by their number: four are front and rear left and
    right, as a DualSense expects, but three would be left, right and bass.
    """
    process = _outputs(render, channels)
    highest = max(channels)
    opened = 1 if highest == 1 else highest + highest % 2
    return Actuator(PortAudioStream(process, "output", device=device, channels=opened))


def gamepad_actuator(
    render: Render,
    *,
    device: str = "",
    roughness: Callable[[], float],
    ceiling: Callable[[], float],
    find: Callable[[], list[Any]] | None = None,
) -> Actuator:
    """Turn the motors of a gamepad; for the arguments see
    `tactophone.live.audio.gamepad.GamepadDevice`."""
    process = _outputs(lambda outs: render(outs[0]), [1])
    return Actuator(
        GamepadDevice(
            process, device=device, roughness=roughness, ceiling=ceiling, find=find
        )
    )


def clocked_hand_actuator(
    render: RenderHand,
    *,
    fingers: int,
    period: int = 128,
    path: Path | None = None,
    resume: bool = False,
) -> Actuator:
    """Request waveforms in step with the system clock; discard them, or write a WAV
    file with a channel for each, or go on with one (`ClockedDevice`)."""
    process = _outputs(render, range(1, fingers + 1))
    return Actuator(
        ClockedDevice(process, period=period, path=path, outputs=fingers, resume=resume)
    )


def _outputs(render: RenderHand, channels: Sequence[int]) -> Process:
    """Return a device's process that renders to these channels, counted from 1, and is
    silent on all others."""
    places = [channel - 1 for channel in channels]

    def process(_: list[FloatArray], outputs: list[FloatArray]) -> None:
        # A sound library reuses its buffers, so a channel that nobody writes would
        # repeat old samples.
        if len(outputs) > len(places):
            for place, output in enumerate(outputs):
                if place not in places:
                    output[:] = 0.0
        render([outputs[place] for place in places])

    return process
