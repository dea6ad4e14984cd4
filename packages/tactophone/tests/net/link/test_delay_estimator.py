"""The minimum transit time, and the clock skew."""

import math

import pytest

from tactophone.net.link.stats import TRANSIT_WINDOW, MinDelayFilter, Skew


def test_a_shorter_path_is_followed_at_once_and_a_longer_one_after_windows() -> None:
    delay = MinDelayFilter()
    seen = []
    for step in range(1_000):
        now = step * 0.005
        if step < 400:
            transit = 0.010
        elif step < 800:
            transit = 0.030
        else:
            transit = 0.005
        delay.push(transit, now=now)
        seen.append(delay.minimum)
    longer = next(step for step, minimum in enumerate(seen) if minimum == 0.030)
    assert TRANSIT_WINDOW <= (longer - 400) * 0.005 <= 2 * TRANSIT_WINDOW + 0.01
    assert seen[800] == 0.005


def test_a_stall_and_its_burst_are_not_taken_for_a_longer_path() -> None:
    delay = MinDelayFilter()
    for step in range(200):
        delay.push(0.010, now=step * 0.005)
    for step in range(400):
        delay.push(0.010 + (400 - step) * 0.005, now=3.0)
    assert delay.minimum == 0.010


def test_the_initial_values_are_undefined() -> None:
    assert math.isinf(MinDelayFilter().minimum)
    assert math.isnan(Skew().ppm)


@pytest.mark.parametrize("ppm", [200, -50, 0])
def test_skew_is_found_beneath_jitter(ppm: float) -> None:
    skew = Skew()
    for step in range(30 * 200):
        now = step * 0.005
        skew.push(1.0 - ppm * 1e-6 * now + 0.003 * (step % 7) / 7, now=now)
    assert skew.ppm == pytest.approx(ppm, abs=3)
