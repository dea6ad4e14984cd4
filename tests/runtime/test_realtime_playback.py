import numpy as np

from tactophone.runtime.realtime_playback import paced
from tactophone.types import AudioBlock


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
    return [AudioBlock(np.zeros((480, 1), np.float32), sample_rate=48_000, start=480 * n) for n in range(count)]


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
