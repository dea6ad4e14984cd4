"""What a session reports: its events, their bytes in a log, and a session that repeats
a log.

The operator's end is a function of the decrypted packets, the connections and their
times. A log of those is enough to run it again, without keys: `LoggedSession` stands in
for `Session`, and its datagrams are the logged events.
"""

import json
from typing import TypeAlias

import msgspec

from tactophone.core.errors import PacketError
from tactophone.net.link.packet import Address


class Connected(msgspec.Struct, frozen=True):
    """Both ends have authenticated themselves; keys and SSRCs are fresh."""

    peer: str
    local_ssrc: int
    remote_ssrc: int


class Renewed(msgspec.Struct, frozen=True):
    """The session continues under fresh keys and SSRCs; sequence numbers and timestamps
    run on."""

    local_ssrc: int
    remote_ssrc: int


class Disconnected(msgspec.Struct, frozen=True):
    """The session has ended."""

    reason: str


class PacketReceived(msgspec.Struct, frozen=True):
    """An authentic packet, decrypted: RTP, or RTCP where ``report`` is true."""

    packet: bytes
    report: bool


Event: TypeAlias = Connected | Renewed | Disconnected | PacketReceived

# First byte of an event in a log: old logs must stay readable, so a number keeps its
# meaning.
_PACKET = 0
_REPORT = 1
_CONNECTED = 2
_DISCONNECTED = 3
_RENEWED = 4


def write_event(event: Event) -> bytes:
    """Encode an event: one byte for its kind, then the packet, or JSON.

    >>> read_event(write_event(Disconnected("hung up")))
    Disconnected(reason='hung up')
    """
    match event:
        case PacketReceived(packet, report):
            return bytes([_REPORT if report else _PACKET]) + packet
        case Connected(peer, local, remote):
            return bytes([_CONNECTED]) + json.dumps([peer, local, remote]).encode()
        case Disconnected(reason):
            return bytes([_DISCONNECTED]) + reason.encode()
        case Renewed(local, remote):
            return bytes([_RENEWED]) + json.dumps([local, remote]).encode()


def read_event(content: bytes) -> Event:
    """Decode what `write_event` encoded; raises `PacketError` when the bytes are not an
    event."""
    try:
        kind = content[0]
        rest = content[1:]
        if kind in (_PACKET, _REPORT):
            return PacketReceived(rest, report=kind == _REPORT)
        if kind == _CONNECTED:
            peer, local, remote = json.loads(rest)
            return Connected(str(peer), int(local), int(remote))
        if kind == _DISCONNECTED:
            return Disconnected(rest.decode())
        if kind == _RENEWED:
            local, remote = json.loads(rest)
            return Renewed(int(local), int(remote))
    except (IndexError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise PacketError(
            f"a logged event of {len(content)} bytes that cannot be read: {error}"
        ) from error
    raise PacketError(f"a logged event of kind {kind}, but there are {_RENEWED + 1}")


class LoggedSession:
    """Repeats the events of a log in place of a `Session`, as far as `ReceiveSession`
    uses one; it sends nothing.

    ``polled``: events, encoded, that the next `poll` returns.
    """

    def __init__(self) -> None:
        self.refused = 0
        self.peer: str | None = None
        self.polled: list[bytes] = []

    def receive(self, datagram: bytes, *, source: Address, now: float) -> list[Event]:
        return [self._followed(read_event(datagram))]

    def poll(self, now: float) -> list[Event]:
        events = [self._followed(read_event(content)) for content in self.polled]
        self.polled = []
        return events

    def send(self, packet: bytes) -> None:
        """Drop the packet: nobody listens."""

    def contain(self, error: Exception, *, now: float) -> list[Event]:
        """Pass over an error that ended the session that was logged: the log says so
        next."""
        return []

    def _followed(self, event: Event) -> Event:
        if isinstance(event, Connected | Disconnected):
            self.peer = event.peer if isinstance(event, Connected) else None
        return event
