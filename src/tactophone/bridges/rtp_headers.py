"""RTP headers in a log: one that follows from those before it is left out, 12 bytes in a packet of 130.

Within a message of `/tactophone/packets` each header is the one before with the next number, and a timestamp as much
later as that was than its own predecessor. It is left out where that holds, and computed again when the log is read.
"""

import struct

FOLLOWING = 16
"""Kind of an event, in its first byte: an RTP packet without its header (docs/reference/log.md)."""

_RTP_PACKET = 0
_HEADER = struct.Struct("!BBHII")  # flags, payload type, number, timestamp, source (RFC 3550 section 5.1)


class RtpHeaders:
    """The headers of one message, in order; one object to write them, another to read them.

    Examples
    --------
    >>> packets = [bytes([0]) + _HEADER.pack(128, 99, number, 240 * number, 1) + b"sound" for number in range(4)]
    >>> writing, reading = RtpHeaders(), RtpHeaders()
    >>> written = [writing.shorten(packet) for packet in packets]
    >>> [len(event) for event in written], [reading.restore(event) for event in written] == packets
    ([18, 18, 6, 6], True)
    """

    def __init__(self) -> None:
        self._last = self._before = (0, 0, 0, 0, 0)

    def shorten(self, event: bytes) -> bytes:
        """Return an event without its RTP header, if that follows from those before."""
        if event[:1] != bytes([_RTP_PACKET]) or len(event) <= _HEADER.size:
            return event
        header, expected = _HEADER.unpack_from(event, 1), self._expected()
        self._last, self._before = header, self._last
        return bytes([FOLLOWING]) + event[1 + _HEADER.size :] if header == expected else event

    def restore(self, event: bytes) -> bytes:
        """Return an event as it was."""
        if event[:1] == bytes([_RTP_PACKET]) and len(event) > _HEADER.size:
            self._last, self._before = _HEADER.unpack_from(event, 1), self._last
        elif event[:1] == bytes([FOLLOWING]):
            self._last, self._before = self._expected(), self._last
            return bytes([_RTP_PACKET]) + _HEADER.pack(*self._last) + event[1:]
        return event

    def _expected(self) -> tuple[int, int, int, int, int]:
        flags, kind, number, timestamp, source = self._last
        step = timestamp - self._before[3]
        return flags, kind, (number + 1) % (1 << 16), (timestamp + step) % (1 << 32), source
