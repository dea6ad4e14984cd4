"""Times of a stream on this machine's clock, whatever the other machine says."""

from tactophone.live.log.reader import LONGEST_DELAY, StreamClock

NOW = 1.8e9
"""Seconds since 1970."""


def test_a_time_of_the_stream_is_late_by_the_least_delay() -> None:
    clock = StreamClock()
    for made, end in ((NOW + 1.0, 0.9), (NOW + 2.0, 1.95), (NOW + 3.0, 2.8)):
        clock.follow(made, end)
    assert abs(clock.time(2.8) - (NOW + 2.85)) < 1e-3


def test_what_stood_still_for_a_while_keeps_its_clock() -> None:
    clock = StreamClock()
    clock.follow(NOW, 0.0)
    clock.follow(NOW + 5.0, 1.0)
    assert abs(clock.time(1.0) - (NOW + 1.0)) < 1e-3


def test_a_stream_that_begins_anew_gets_a_clock_of_its_own() -> None:
    clock = StreamClock()
    clock.follow(NOW, 3600.0)
    clock.follow(NOW + 60.0, 0.1)
    assert clock.time(0.1) == NOW + 60.0


def test_no_time_is_far_from_this_machines_however_a_stream_jumps() -> None:
    clock = StreamClock()
    made = NOW
    for end in (0.0, 43_200.0, 1.8e9, 99.0, 4e9, 0.0):
        made += 0.01
        clock.follow(made, end)
        assert -1e-3 <= made - clock.time(end) <= LONGEST_DELAY
