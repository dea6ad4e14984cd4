import time

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
