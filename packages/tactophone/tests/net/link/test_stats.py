"""Counters, by the algorithms of RFC 3550's appendix."""

import pytest

from tactophone.net.link.rtcp import SenderReport
from tactophone.net.link.stats import Reception


def reception_of(sequences: list[int]) -> Reception:
    reception = Reception()
    for step, sequence in enumerate(sequences):
        reception.count(sequence % 2**16, 240 * step, now=0.005 * step)
    return reception


def test_loss_is_expected_less_received() -> None:
    stats = reception_of([10, 11, 13, 14, 17]).stats
    assert (stats.packets_expected, stats.packets_received, stats.packets_lost) == (
        8,
        5,
        3,
    )


def test_numbers_wrap() -> None:
    stats = reception_of(list(range(65_530, 65_545))).stats
    assert (stats.packets_expected, stats.packets_lost, stats.packets_reordered) == (
        15,
        0,
        0,
    )


def test_order_and_doubles_are_counted_apart() -> None:
    stats = reception_of([1, 3, 2, 2, 4]).stats
    assert (
        stats.packets_reordered,
        stats.packets_duplicated,
        stats.packets_received,
    ) == (1, 1, 4)


def test_a_report_contains_the_loss_since_the_last_report() -> None:
    reception = reception_of([1, 2, 4])
    assert reception.report(ssrc=1, of=2, now=1).fraction_lost == pytest.approx(0.25)
    assert reception.report(ssrc=1, of=2, now=2).fraction_lost == 0
    assert reception.report(ssrc=1, of=2, now=2).lost == 1


def test_a_report_returns_the_peers_stamp_and_its_age() -> None:
    reception = reception_of([1])
    sent = SenderReport(2, 50.0, 0, 0, 0)
    reception.note_sender_report(sent, now=7.0)
    report = reception.report(ssrc=1, of=2, now=7.25)
    assert (report.last_report, report.since) == (sent.stamp, 0.25)


def test_jitter_is_smoothed_by_a_sixteenth() -> None:
    reception = Reception()
    for step in range(3_000):
        reception.count(step, 240 * step, now=0.005 * step + 0.002 * (step % 2))
    assert reception.stats.jitter == pytest.approx(0.002, rel=0.01)


def test_memory_is_bounded() -> None:
    reception = reception_of(list(range(20_000)))
    assert len(reception._seen) <= 2_049


@pytest.mark.parametrize("step", [2**32 - 24_000, 2**31, 2**31 - 1, 23_000, -23_000])
def test_jitter_is_never_negative_and_always_fits_its_report(step: int) -> None:
    reception = Reception()
    for number in range(200):
        reception.count(number, (step * (number % 2)) % 2**32, now=0.005 * number)
        assert reception.stats.jitter >= 0
        bytes(reception.report(ssrc=1, of=2, now=0.005 * number))


def test_a_clump_that_ends_at_the_timestamps_wrap_adds_its_own_jitter_only() -> None:
    clump, calm = Reception(), Reception()
    for number in range(120):
        held = 0.1 if 40 <= number < 60 else 0.0
        clump.count(
            number, (240 * (number - 60)) % 2**32, now=10 + 0.005 * number + held
        )
        calm.count(number, 240 * number, now=10 + 0.005 * number + held)
    assert clump.stats.jitter == pytest.approx(calm.stats.jitter)
