"""Encryption of single packets; whole sessions are in test_session."""

import pytest

from tactophone.core.errors import PacketError
from tactophone.net.link.handshake import Secrets
from tactophone.net.link.packet import SRTP_OVERHEAD, is_report
from tactophone.net.link.rtcp import Goodbye
from tactophone.net.link.session import SrtpCrypto

FIRST, SECOND = bytes(range(44)), bytes(range(100, 144))
RTP = b"\x80\x62\x00\x01" + bytes(4) + (1).to_bytes(4) + b"sound"


def pair() -> tuple[SrtpCrypto, SrtpCrypto]:
    return SrtpCrypto(Secrets(FIRST, SECOND, local_ssrc=1, remote_ssrc=2)), SrtpCrypto(
        Secrets(SECOND, FIRST, 2, 1)
    )


def test_a_packet_decrypts_once_and_only_at_the_other_end() -> None:
    robot, operator = pair()
    encrypted = robot.protect(RTP)
    assert len(encrypted) == len(RTP) + SRTP_OVERHEAD
    assert operator.unprotect(encrypted) == RTP
    with pytest.raises(PacketError, match="replay"):
        operator.unprotect(encrypted)
    with pytest.raises(PacketError):
        robot.unprotect(encrypted)


def test_reports_are_encrypted_too() -> None:
    robot, operator = pair()
    report = bytes(Goodbye(1))
    encrypted = robot.protect(report)
    assert is_report(encrypted)
    assert operator.unprotect(encrypted) == report


def test_another_stream_under_the_same_key_is_refused() -> None:
    _, operator = pair()
    other = SrtpCrypto(Secrets(FIRST, SECOND, local_ssrc=3, remote_ssrc=2))
    with pytest.raises(PacketError):
        operator.unprotect(other.protect(RTP[:8] + (3).to_bytes(4) + b"sound"))


def test_the_keys_are_not_shown() -> None:
    assert FIRST.hex() not in repr(Secrets(FIRST, SECOND, 1, 2))
    assert "hidden" in repr(Secrets(FIRST, SECOND, 1, 2))
