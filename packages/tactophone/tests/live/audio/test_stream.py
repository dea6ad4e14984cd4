"""Sound that arrives over a pipe."""

import struct
import time
from multiprocessing import Pipe

import numpy as np

from tactophone.live.audio.device import StreamDevice
from tactophone.live.audio.sources import browser_source

from .test_jack import eventually


def message(start: int, samples: np.ndarray) -> bytes:
    return struct.pack("<I", start % (1 << 32)) + samples.astype("<f4").tobytes()


def test_samples_arrive_bit_for_bit_and_a_gap_is_counted() -> None:
    inbox, outbox = Pipe(duplex=False)
    found: list[np.ndarray] = []
    device = StreamDevice(
        inbox, lambda inputs, _: found.append(inputs[0]), absent="nobody"
    )
    outbox.send_bytes(message(0, np.ones(8)))  # out of date when the device opens
    device.open()
    assert device.fault == "nobody"
    samples = np.random.default_rng(1).uniform(-1, 1, (3, 256)).astype(np.float32)
    for start, block in zip(((1 << 32) - 256, 0, 512), samples, strict=True):
        outbox.send_bytes(message(start, block))
    assert eventually(lambda: len(found) == 3)
    device.close()
    assert np.array_equal(np.array(found), samples)
    assert (device.xruns, device.losses, device.fault) == (1, 0, "")


def test_a_page_process_that_ends_is_a_fault_and_no_error() -> None:
    inbox, outbox = Pipe(duplex=False)
    with browser_source(inbox) as source:
        assert source.channels == 1
        outbox.close()
        time.sleep(0.05)
        assert "Use this microphone" in source.device.fault


def test_a_process_that_closes_its_own_device_is_not_waited_for() -> None:
    inbox, outbox = Pipe(duplex=False)
    closed: list[str] = []

    def close(inputs: list[np.ndarray], _: list[np.ndarray]) -> None:
        device.close()
        closed.append("in order")

    device = StreamDevice(inbox, close, absent="nobody")
    device.open()
    outbox.send_bytes(message(0, np.ones(8)))
    assert eventually(lambda: closed == ["in order"])
