import queue
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from tactophone.core.errors import DeviceError
from tactophone.core.types import AudioBlock
from tactophone.live.audio.device import Process
from tactophone.live.audio.sources import LiveSource


class HandDevice:
    """A device whose periods the test delivers."""

    def __init__(self, process: Process, *, sample_rate: int = 48_000) -> None:
        self.process = process
        self.sample_rate = sample_rate
        self.xruns = self.process_faults = self.losses = 0
        self.lost = False
        self.latency = 0.0
        self.fault = ""
        self.revived = threading.Event()
        self.is_open = False

    def open(self) -> None:
        self.is_open = True

    def revive(self) -> None:
        self.fault = ""
        self.revived.set()

    def close(self) -> None:
        self.is_open = False

    def deliver(self, value: float, size: int) -> None:
        self.process(
            [np.full(size, value, np.float32), np.full(size, -value, np.float32)], []
        )


@pytest.fixture
def source() -> Iterator[LiveSource]:
    with LiveSource(HandDevice, channels=2) as source:
        yield source


def test_blocks_come_in_order_with_contact_first(source: LiveSource) -> None:
    blocks = iter(source)
    for value, size in ((0.1, 128), (0.2, 17), (0.3, 128)):
        source.device.deliver(value, size)
    first, second, third = (next(blocks) for _ in range(3))
    assert (first.start, second.start, third.start) == (0, 128, 145)
    np.testing.assert_allclose(
        second.samples, np.tile(np.float32([0.2, -0.2]), (17, 1))
    )


def test_sound_that_nobody_fetches_is_dropped_and_counted(source: LiveSource) -> None:
    for _ in range(60):
        source.device.deliver(0.1, 128)
    assert source.overflows > 0
    blocks = iter(source)
    waiting = [next(blocks) for _ in range(60 - source.overflows)]
    source.device.deliver(0.5, 128)
    after = next(blocks)
    assert after.start == 60 * 128 > waiting[-1].end


def test_a_late_reader_gets_all_that_waits_at_once_up_to_a_gap(
    source: LiveSource,
) -> None:
    for _ in range(60):
        source.device.deliver(0.1, 128)
    blocks = source.joined()
    assert next(blocks).size == (60 - source.overflows) * 128
    for value in (0.2, 0.3):
        source.device.deliver(value, 128)
    after = next(blocks)
    assert (after.start, after.size) == (60 * 128, 256)
    np.testing.assert_allclose(after.samples[[0, -1], 0], np.float32([0.2, 0.3]))
    source.device.deliver(0.4, 8)
    source.close()
    assert [block.size for block in blocks] == []


def test_a_reader_that_waits_is_woken_for_as_much_as_it_needs(
    source: LiveSource,
) -> None:
    received: queue.SimpleQueue[AudioBlock] = queue.SimpleQueue()
    needed = 240

    def read() -> None:
        for block in source.joined(lambda: needed):
            received.put(block)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    while not source._idle:
        time.sleep(0.001)
    source.device.deliver(0.1, 128)
    with pytest.raises(queue.Empty):
        received.get(timeout=0.05)
    source.device.deliver(0.2, 128)
    block = received.get(timeout=5)
    assert (block.start, block.size) == (0, 256)
    np.testing.assert_allclose(block.samples[[0, -1], 0], np.float32([0.1, 0.2]))
    while not source._idle:
        time.sleep(0.001)
    needed = 128
    source.device.deliver(0.3, 128)
    assert received.get(timeout=5).start == 256
    source.close()
    reader.join(5)
    assert not reader.is_alive()


def test_a_silent_device_is_revived(source: LiveSource) -> None:
    blocks = iter(source)
    threading.Timer(0.3, lambda: source.device.deliver(0.1, 8)).start()
    assert next(blocks).size == 8
    assert source.device.revived.is_set()


def test_closing_from_another_thread_ends_the_sound(source: LiveSource) -> None:
    threading.Timer(0.05, source.close).start()
    assert list(source) == []
    assert not source.device.is_open


def test_another_rate_is_refused() -> None:
    source = LiveSource(
        lambda process: HandDevice(process, sample_rate=44_100), channels=2
    )
    with pytest.raises(DeviceError, match="44100 Hz, but 48000"), source:
        pass
    assert not source.device.is_open
