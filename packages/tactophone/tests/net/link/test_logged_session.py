"""A session that repeats a log stands in for one that has a peer."""

from typing import Any

import pytest

from tactophone.net.link import receive
from tactophone.net.link.events import (
    Connected,
    Disconnected,
    LoggedSession,
    PacketReceived,
    write_event,
)
from tactophone.net.link.receive import ReceiveSession

NOWHERE = ("", 0)


def test_a_packet_that_made_our_code_raise_does_so_again_and_the_log_ends_the_session(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def fail(packet: bytes) -> Any:
        raise RuntimeError("our mistake")

    monkeypatch.setattr(receive, "parse_packet", fail)
    logged = LoggedSession()
    session = ReceiveSession(logged)
    connected = Connected("robot", 1, 2)
    assert session.receive([(write_event(connected), NOWHERE)], now=0.0) == [connected]
    packet = PacketReceived(bytes(20), report=False)
    assert session.receive([(write_event(packet), NOWHERE)], now=0.1) == []
    ended = Disconnected("an error on the other side (RuntimeError)")
    logged.polled = [write_event(ended)]
    assert ended in session.poll(0.1)
    assert session.peer is None
