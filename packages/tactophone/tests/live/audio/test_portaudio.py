import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from tactophone.core.errors import DeviceError
from tactophone.core.types import FloatArray
from tactophone.live.audio.portaudio import PortAudioStream

from .test_jack import eventually


class Faulty:
    """Plays a level, and raises on request."""

    def __init__(self) -> None:
        self.failing = False
        self.calls = 0

    def __call__(self, inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        self.calls += 1
        for samples in outputs:
            samples[:] = 0.5
        if self.failing:
            raise RuntimeError("the process fails")


def test_an_unknown_device_is_refused_by_name() -> None:
    stream = PortAudioStream(Faulty(), "output", device="no such card")
    with pytest.raises(DeviceError, match="match 'no such card'"):
        stream.open()
    assert "plug it in again" in stream.fault


class Cards:
    """Stands in for the module sounddevice: cards that are plugged in and out."""

    class PortAudioError(Exception):
        pass

    def __init__(self, *names: str, outputs: int = 2) -> None:
        self.plug(*names, outputs=outputs)
        self.played: list[str] = []
        self.default = type("Default", (), {"device": {"input": 0, "output": 0}})
        self.OutputStream = self._open
        self.stream: Any = None

    def plug(self, *names: str, outputs: int = 2) -> None:
        self._cards = [
            {
                "index": index,
                "name": name,
                "hostapi": 0,
                "max_input_channels": 2,
                "max_output_channels": outputs,
                "default_samplerate": 48_000.0,
                "default_low_input_latency": 0.01,
                "default_low_output_latency": 0.01,
            }
            for index, name in enumerate(names)
        ]

    def query_hostapis(self) -> list[dict[str, str]]:
        return [{"name": "ALSA"}]

    def query_devices(self) -> list[dict[str, Any]]:
        return self._cards

    def _open(self, *, device: int, **_: Any) -> Any:
        self.played.append(self._cards[device]["name"])
        self.stream = Stream()
        return self.stream

    def _initialize(self) -> None: ...

    _terminate = _initialize


@dataclass
class Stream:
    active: bool = True
    latency: float = 0.01

    def start(self) -> None: ...

    abort = close = start


COIL, SPEAKER = "USB DAC: - (hw:1,0)", "Laptop: Speaker (hw:0,0)"


@pytest.mark.parametrize("asked", ["", "0", "usb"])
def test_another_card_in_the_place_of_a_lost_one_is_not_played_to(
    asked: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    cards = Cards(COIL)
    monkeypatch.setattr("tactophone.live.audio.portaudio._sounddevice", lambda: cards)
    stream = PortAudioStream(Faulty(), "output", device=asked)
    stream.open()
    cards.stream.active = False
    cards.plug(SPEAKER, "Cheap USB Headset: - (hw:2,0)")
    stream.revive()
    assert (stream.lost, cards.played) == (True, [COIL])
    assert f"lost {COIL} (devices for output with 1 channels now: 0 {SPEAKER}" in (
        stream.fault
    )
    # Plugged in last, it has another number.
    cards.plug(SPEAKER, "Cheap USB Headset: - (hw:2,0)", "USB DAC: - (hw:3,0)")
    stream.revive()
    assert (stream.fault, cards.played) == ("", [COIL, "USB DAC: - (hw:3,0)"])
    assert not stream.lost
    stream.close()


def test_a_card_that_comes_back_with_fewer_channels_is_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    cards = Cards(COIL, outputs=4)
    monkeypatch.setattr("tactophone.live.audio.portaudio._sounddevice", lambda: cards)
    stream = PortAudioStream(Faulty(), "output", channels=3)
    stream.open()
    cards.stream.active = False
    cards.plug(COIL, outputs=2)
    stream.revive()
    assert "devices for output with 3 channels now: none" in stream.fault
    cards.plug(COIL, outputs=4)
    stream.revive()
    assert stream.fault == ""
    stream.close()


@pytest.mark.realtime
@pytest.mark.usefixtures("portaudio")
def test_a_failing_process_is_counted_and_the_stream_goes_on() -> None:
    process = Faulty()
    stream = PortAudioStream(process, "output", device="syst", channels=2)
    stream.open()
    try:
        assert eventually(lambda: process.calls > 5)
        process.failing = True
        assert eventually(lambda: stream.process_faults > 5)
        process.failing, calls = False, process.calls
        assert eventually(lambda: process.calls > calls + 5)
        assert not stream.fault
    finally:
        stream.close()


def test_what_a_failing_process_wrote_is_not_played() -> None:
    """PortAudio's own callback, called as PortAudio calls it, as its output cannot be
    recorded here."""
    process = Faulty()
    process.failing = True
    stream = PortAudioStream(process, "output")
    block = np.ones((64, 1), np.float32)
    stream._call(block, 64, None, None)
    assert not block.any()
    assert stream.process_faults == 1


@pytest.mark.realtime
@pytest.mark.usefixtures("portaudio")
def test_blocks_arrive_by_the_devices_clock() -> None:
    sizes: list[int] = []
    stream = PortAudioStream(
        lambda inputs, outputs: sizes.append(len(inputs[0])),
        "input",
        device="syst",
        channels=2,
    )
    stream.open()
    begun = time.monotonic()
    try:
        assert eventually(lambda: sum(sizes) > 9600)
    finally:
        stream.close()
    assert time.monotonic() - begun > 0.1
    assert set(sizes) == {128}
