"""RTCP reports, to the byte and back."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.core.errors import PacketError
from tactophone.net.link.rtcp import (
    Goodbye,
    Introduction,
    ReceiverReport,
    ReceiverRequest,
    Report,
    SenderReport,
    parse_report,
    round_trip_time,
)

REPORT = ReceiverReport(
    1,
    2,
    fraction_lost=0.25,
    lost=300,
    highest=70_000,
    jitter=0.001,
    last_report=9,
    since=0.5,
)


@pytest.mark.parametrize(
    "report",
    [
        REPORT,
        SenderReport(1, 5.5, 960, 4, 1000),
        Goodbye(7),
        Introduction(2, "0.1.0"),
        ReceiverRequest(3, 7_600),
    ],
)
def test_reports_survive_the_wire(report: Report) -> None:
    assert parse_report(bytes(report)) == report


@pytest.mark.parametrize("version", ["0.1.0[/x]", "0.1.0\x1b[2J", "0 1", "1" * 65])
def test_a_version_holds_nothing_that_a_terminal_could_take_for_its_own(
    version: str,
) -> None:
    with pytest.raises(PacketError, match="a version of"):
        parse_report(bytes(Introduction(1, version)))


def test_a_receiver_report_has_the_bytes_of_the_standard() -> None:
    assert bytes(REPORT).hex(" ", -4) == (
        "81c90007 00000001 00000002 4000012c 00011170 00000030 00000009 "
        "00008000"  # RFC 3550 section 6.4.2
    )


@given(st.binary(max_size=60))
def test_no_bytes_crash_the_parser(content: bytes) -> None:
    for start in (
        b"",
        b"\x80\xc8\x00\x06",
        b"\x81\xc9\x00\x07",
        b"\x81\xca\x00\x06\x00\x00\x00\x01\x06",
    ):
        try:
            parse_report(start + content)
        except PacketError:
            continue


def test_the_round_trip_excludes_the_time_at_the_peer() -> None:
    sent = SenderReport(1, 100.0, 0, 0, 0)
    answer = ReceiverReport(2, 1, 0, 0, 0, 0, last_report=sent.stamp, since=0.2)
    assert round_trip_time(answer, now=100.23) == pytest.approx(0.03, abs=1e-3)
    assert round_trip_time(ReceiverReport(2, 1, 0, 0, 0, 0), now=100.0) is None
