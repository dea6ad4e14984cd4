"""The seal alone; what a whole session refuses is in test_session."""

import pytest

from tactophone.errors import PacketError
from tactophone.link.rtcp import Goodbye
from tactophone.link.srtp import OVERHEAD, Secrets, SrtpCrypto, is_report

FIRST, SECOND = bytes(range(44)), bytes(range(100, 144))
RTP = b"\x80\x62\x00\x01" + bytes(4) + (1).to_bytes(4) + b"sound"


def pair() -> tuple[SrtpCrypto, SrtpCrypto]:
    return SrtpCrypto(Secrets(FIRST, SECOND, local_ssrc=1, remote_ssrc=2)), SrtpCrypto(Secrets(SECOND, FIRST, 2, 1))


def test_what_is_sealed_opens_once_at_the_other_end_only() -> None:
    robot, operator = pair()
    sealed = robot.close(RTP)
    assert len(sealed) == len(RTP) + OVERHEAD
    assert operator.open(sealed) == RTP
    with pytest.raises(PacketError, match="replay"):
        operator.open(sealed)
    with pytest.raises(PacketError):
        robot.open(sealed)


def test_reports_are_sealed_too() -> None:
    robot, operator = pair()
    report = bytes(Goodbye(1))
    sealed = robot.close(report)
    assert is_report(sealed)
    assert operator.open(sealed) == report


def test_another_stream_under_the_same_key_is_refused() -> None:
    _, operator = pair()
    other = SrtpCrypto(Secrets(FIRST, SECOND, local_ssrc=3, remote_ssrc=2))
    with pytest.raises(PacketError):
        operator.open(other.close(RTP[:8] + (3).to_bytes(4) + b"sound"))


def test_the_keys_are_not_shown() -> None:
    assert FIRST.hex() not in repr(Secrets(FIRST, SECOND, 1, 2))
    assert "hidden" in repr(Secrets(FIRST, SECOND, 1, 2))
