"""Received packets in a log: what follows from others is left out, and computed again when the log is read.

An RTP header follows from the one before if its number is the next and its timestamp as much later as that was than its
own predecessor. A payload follows from the sound in the log, and the payloads that redundancy repeats from those of the
packets before. Packets that are then alike differ in their times only. The layout is in docs/reference/log.md.
"""

import struct
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise
from statistics import median_low

from tactophone.bridges import protobuf
from tactophone.bridges.sound_payload import RTP_HEADER, LoggedSound, PacketLayout, read_layout
from tactophone.telemetry import ARRIVAL_DIGITS, EventBatch

FOLLOWING, SOUND, REPEATED = 16, 32, 64
"""Bits of an event's kind, its first byte: without its RTP header, newest payload, repeated payloads. The first of a
report (RTCP): as differences from the report before."""

_RTP_PACKET, _REPORT = 0, 1
_WORD = 1 << 32
_TICKS = 10**ARRIVAL_DIGITS  # in a second
_MOST_REPEATED = 4  # packets back that redundancy reaches, and one more


class RtpHeaders:
    """The headers of RTP packets, in order; one object to write them, another to read them.

    Examples
    --------
    >>> packets = [bytes([0]) + RTP_HEADER.pack(128, 99, number, 240 * number, 1) + b"sound" for number in range(4)]
    >>> writing, reading = RtpHeaders(), RtpHeaders()
    >>> written = [writing.shorten(packet) for packet in packets]
    >>> [len(event) for event in written], [reading.restore(event) for event in written] == packets
    ([18, 18, 6, 6], True)
    """

    def __init__(self) -> None:
        self._last = self._before = (0, 0, 0, 0, 0)

    def shorten(self, event: bytes) -> bytes:
        """Return an event without its RTP header, if that follows from those before."""
        if event[:1] != bytes([_RTP_PACKET]) or len(event) <= RTP_HEADER.size:
            return event
        header, expected = RTP_HEADER.unpack_from(event, 1), self._expected()
        self._last, self._before = header, self._last
        return bytes([FOLLOWING]) + event[1 + RTP_HEADER.size :] if header == expected else event

    def restore(self, event: bytes) -> bytes:
        """Return an event as it was."""
        if event[:1] == bytes([_RTP_PACKET]) and len(event) > RTP_HEADER.size:
            self._last, self._before = RTP_HEADER.unpack_from(event, 1), self._last
        elif event[:1] == bytes([FOLLOWING]):
            self._last, self._before = self._expected(), self._last
            return bytes([_RTP_PACKET]) + RTP_HEADER.pack(*self._last) + event[1:]
        return event

    def _expected(self) -> tuple[int, int, int, int, int]:
        flags, kind, number, timestamp, source = self._last
        step = timestamp - self._before[3]
        return flags, kind, (number + 1) % (1 << 16), (timestamp + step) % (1 << 32), source


class _Reports:
    """Reports in words of four bytes, of which few change much; one object to write them, another to read them."""

    def __init__(self) -> None:
        self._last: tuple[int, ...] = ()

    def shorten(self, event: bytes) -> bytes:
        """Return a report as differences from the one before, if that was as long."""
        if event[:1] != bytes([_REPORT]) or len(event) % 4 != 1:
            return event
        last, self._last = self._last, struct.unpack(f"!{len(event) // 4}I", event[1:])
        if len(last) != len(self._last):
            return event
        differences = [(word - before + _WORD // 2) % _WORD - _WORD // 2
                       for before, word in zip(last, self._last, strict=True)]  # fmt: skip
        return bytes([_REPORT | FOLLOWING]) + protobuf.zigzag(differences)

    def restore(self, event: bytes) -> bytes:
        """Return a report as it was."""
        if event[:1] == bytes([_REPORT | FOLLOWING]):
            differences = protobuf.signed_numbers(event[1:])
            words = [(word + before) % _WORD for before, word in zip(self._last, differences, strict=True)]
            event = bytes([_REPORT]) + struct.pack(f"!{len(words)}I", *words)
        if event[:1] == bytes([_REPORT]) and len(event) % 4 == 1:
            self._last = struct.unpack(f"!{len(event) // 4}I", event[1:])
        return event


class _Payloads:
    """Newest payloads of the packets before, by timestamp; written and read alike."""

    def __init__(self) -> None:
        self._newest: deque[tuple[int, bytes]] = deque(maxlen=_MOST_REPEATED)

    def keep(self, packet: bytes, layout: PacketLayout) -> None:
        self._newest.append((layout.timestamp, packet[layout.newest :]))

    def repeated(self, layout: PacketLayout) -> bytes | None:
        """Return what redundancy repeats in a packet; ``None`` if one of these packets was lost."""
        known = dict(self._newest)
        found = [known.get((layout.timestamp - age) % (1 << 32)) for age, _ in layout.repeated]
        return None if None in found else b"".join(payload for payload in found if payload is not None)


class PacketWriter:
    """Encodes the arrivals of a log, message after message."""

    def __init__(self) -> None:
        self._headers, self._reports, self._payloads = RtpHeaders(), _Reports(), _Payloads()

    def encode(self, arrivals: Sequence[tuple[EventBatch, Sequence[bool]]]) -> bytes:
        """Return the message ``tactophone.Packets``; each event of an arrival with whether its sound is in the log."""
        ticks = [round(arrival.time * _TICKS) for arrival, _ in arrivals]
        base = max(0, ticks[0])
        delays = [later - earlier for earlier, later in pairwise([base, *ticks])]
        step = max(0, median_low(delays))
        encoded = protobuf.integer(2, base) + protobuf.integer(3, step)
        encoded += protobuf.signed(4, [delay - step for delay in delays])
        contents = [
            (b"" if tick / _TICKS == arrival.time else protobuf.double(1, arrival.time))
            + self._content(arrival, with_sound)
            for (arrival, with_sound), tick in zip(arrivals, ticks, strict=True)
        ]
        for content, alike in groupby(contents):
            count = len(list(alike))
            encoded += protobuf.octets(1, content + (protobuf.integer(4, count) if count > 1 else b""))
        return encoded

    def _content(self, arrival: EventBatch, with_sound: Sequence[bool]) -> bytes:
        events = zip(arrival.events, with_sound, strict=True)
        return protobuf.integer(2, arrival.polled) * arrival.polled + b"".join(
            protobuf.octets(3, self._event(event, known)) for event, known in events
        )

    def _event(self, event: bytes, with_sound: bool) -> bytes:
        shortened, layout = self._reports.shorten(self._headers.shorten(event)), None
        if event[:1] == bytes([_RTP_PACKET]):
            layout = read_layout(event[1:])
        if layout is None:
            return shortened
        packet, repeated = event[1:], self._payloads.repeated(layout)
        self._payloads.keep(packet, layout)
        if not with_sound:
            return shortened
        head = shortened[1 : len(shortened) - len(packet) + layout.start]
        if repeated == packet[layout.start : layout.newest]:
            return bytes([shortened[0] | SOUND | REPEATED]) + head
        return bytes([shortened[0] | SOUND]) + head + packet[layout.start : layout.newest]


class PacketReader:
    """Decodes them again; `sound` takes the messages that hold their sound, which come first."""

    def __init__(self) -> None:
        self.sound = LoggedSound()
        self._headers, self._reports, self._payloads = RtpHeaders(), _Reports(), _Payloads()

    def decode(self, message: bytes) -> Iterator[EventBatch]:
        """Yield the arrivals of a message ``tactophone.Packets``.

        Raises `ValueError` when the bytes are not such a message.
        """
        reached, step, delays = 0, 0, deque[int]()
        for number, value in protobuf.fields(message):
            if number == 1:
                time, polled, events, count = _read_content(_bytes(value))
                if count > len(delays):
                    raise ValueError(f"{count} arrivals, but {len(delays)} times")
                for _ in range(count):
                    reached += step + delays.popleft()
                    content = tuple(self._event(event) for event in events)
                    yield EventBatch(reached / _TICKS if time is None else time, content, polled)
            elif number == 2:
                reached = int(value)
            elif number == 3:
                step = int(value)
            elif number == 4:
                delays = deque(protobuf.signed_numbers(_bytes(value)))

    def _event(self, event: bytes) -> bytes:
        left_out = event[0] & (SOUND | REPEATED) if event else 0
        if event[:1] and event[0] & ~(SOUND | REPEATED | FOLLOWING):
            return self._reports.restore(event)
        event = self._headers.restore(bytes([event[0] & ~left_out]) + event[1:]) if event else event
        packet = event[1:]
        layout = read_layout(packet)
        if layout is None:
            if left_out:
                raise ValueError("a packet without sound refers to sound")
            return event
        if left_out:
            repeated = self._payloads.repeated(layout) if left_out & REPEATED else b""
            if repeated is None:
                raise ValueError("a packet repeats one that is missing")
            packet += repeated + self.sound.next_payload(layout.kind)
        self._payloads.keep(packet, layout)
        return bytes([_RTP_PACKET]) + packet


def _read_content(message: bytes) -> tuple[float | None, bool, list[bytes], int]:
    """Return what arrivals that are alike have in common, and their number; their time only if it is no delay."""
    time, polled, events, count = None, False, list[bytes](), 1
    for number, value in protobuf.fields(message):
        if number == 1:
            (time,) = struct.unpack("<d", _bytes(value))
        elif number == 2:
            polled = bool(value)
        elif number == 3:
            events.append(_bytes(value))
        elif number == 4:
            count = int(value)
    return time, polled, events, count


def _bytes(value: int | bytes) -> bytes:
    if isinstance(value, int):
        raise ValueError("a number in place of bytes")
    return value
