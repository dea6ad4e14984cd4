from collections.abc import Iterator

import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone.live.audio.pacing import LONGEST_DELAY, paced


class Clock:
    """Time that passes by sleeping alone."""

    def __init__(self) -> None:
        self.now = 0.0
        self.slept: list[float] = []

    def __call__(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        self.slept.append(duration)
        self.now += duration


def blocks(count: int) -> list[AudioBlock]:
    return [
        AudioBlock(np.zeros((480, 1), np.float32), sample_rate=48_000, start=480 * n)
        for n in range(count)
    ]


def test_blocks_come_when_their_last_sample_would() -> None:
    clock = Clock()
    times = [clock.now for _ in paced(blocks(5), clock=clock, sleep=clock.sleep)]
    np.testing.assert_allclose(times, [0.01, 0.02, 0.03, 0.04, 0.05])


def test_a_short_delay_is_made_up_and_a_long_one_forgiven() -> None:
    clock = Clock()
    times = []
    for index, _ in enumerate(paced(blocks(30), clock=clock, sleep=clock.sleep)):
        clock.now += {3: 0.03, 12: 0.5}.get(index, 0.0)
        times.append(clock.now)
    np.testing.assert_allclose(times[8], 0.09)
    assert times[13] - times[12] <= 0.01
    np.testing.assert_allclose(np.diff(times[14:]), 0.01)


def after_a_stall(*, skip: bool) -> list[tuple[float, AudioBlock]]:
    """Blocks of 10 ms, each with the time at which it came; the reader stands still for
    half a second at block 12."""
    clock, found = Clock(), []
    for index, block in enumerate(
        paced(blocks(100), skip=skip, clock=clock, sleep=clock.sleep)
    ):
        found.append((clock.now, block))
        clock.now += 0.5 if index == 12 else 0.0
    return found


@pytest.mark.parametrize("skip", [False, True])
def test_times_go_on_with_the_clock_after_a_stall(skip: bool) -> None:
    assert (
        max(
            now - block.end / block.sample_rate
            for now, block in after_a_stall(skip=skip)
        )
        < LONGEST_DELAY + 1e-6
    )


def test_a_recording_skips_missed_sound_and_a_simulation_goes_on_with_it() -> None:
    recording, simulation = (after_a_stall(skip=skip) for skip in (True, False))
    assert [block.start % 480 for _, block in recording] == [0] * len(recording)
    assert len(recording) == pytest.approx(100 - 50, abs=7)
    assert len(simulation) == 100


def test_a_recording_that_cannot_be_skipped_in_time_goes_on_at_later_times() -> None:
    clock = Clock()

    def slow() -> Iterator[AudioBlock]:
        for block in blocks(300):
            clock.now += 0.012 if block.start else 1.0  # slower than the sound plays
            yield block

    found = [
        (clock.now, block)
        for block in paced(slow(), skip=True, clock=clock, sleep=clock.sleep)
    ]
    assert len(found) > 150
    assert (
        max(now - block.end / block.sample_rate for now, block in found)
        < LONGEST_DELAY + 0.013
    )


def test_interruptions_while_missed_sound_is_skipped_do_not_move_the_times() -> None:
    """A busy machine interrupts the reading itself: what follows must still lie where
    its labels are."""
    clock = Clock()

    def interrupted() -> Iterator[AudioBlock]:
        for index, block in enumerate(blocks(600)):
            clock.now += 0.2 if index in (20, 25, 30) else 0.0001
            yield block

    found = []
    for block in paced(interrupted(), skip=True, clock=clock, sleep=clock.sleep):
        found.append((clock.now, block))
        clock.now += 0.7 if len(found) == 12 else 0.0
    assert [block.start % 480 for _, block in found] == [0] * len(found)
    assert (
        max(now - block.end / block.sample_rate for now, block in found)
        < LONGEST_DELAY + 1e-6
    )
    assert len(found) > 450
