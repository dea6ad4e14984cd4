"""Opus packets taken apart and put together, without a codec: what link and logs both need.

A payload of two microphones is a packet of two streams, the first in its self-delimited form (RFC 6716 appendix B, RFC
7845 section 5.1.1): after its first byte stands the length of its frame.
"""

from collections.abc import Sequence

FRAME_SIZES = (120, 240, 480, 960)
"""Frame sizes at low delay, in samples at 48 kHz, by the two lowest bits of their configuration (RFC 6716, 3.1)."""

LARGEST_FRAME = 1275
"""Bytes of the largest frame (RFC 6716 section 3.4)."""

LONG_LENGTH = 252
"""Least length of a frame that takes two bytes to write (RFC 6716 section 3.2.1)."""

_CODE = 3  # bits of the first byte with the number of frames


def frame_length(size: int) -> bytes:
    """Encode the length of a frame (RFC 6716 section 3.2.1).

    >>> frame_length(251).hex(), frame_length(1275).hex()
    ('fb', 'ffff')
    """
    if size < LONG_LENGTH:
        return bytes([size])
    low = LONG_LENGTH + size % 4
    return bytes([low, (size - low) // 4])


def read_frame_length(packet: bytes, position: int) -> tuple[int, int]:
    """Return the length of a frame that stands at `position`, and the position after it."""
    size = packet[position]
    return (size, position + 1) if size < LONG_LENGTH else (size + 4 * packet[position + 1], position + 2)


def split_streams(payload: bytes, streams: int) -> list[bytes]:
    """Return a packet of each stream, 1 or 2, where each holds one frame of the same kind; nothing otherwise.

    Examples
    --------
    >>> split_streams(bytes([0xE0, 2, 7, 8, 0xE0, 9]), 2) == [bytes([0xE0, 7, 8]), bytes([0xE0, 9])]
    True
    """
    if streams == 1 or len(payload) < 3:
        return [payload] if payload and streams == 1 else []
    length, start = read_frame_length(payload, 1)
    end = start + length
    if payload[0] & _CODE or not end < len(payload) <= end + 1 + LARGEST_FRAME or payload[end] != payload[0]:
        return []
    return [payload[:1] + payload[start:end], payload[end:]]


def join_streams(packets: Sequence[bytes]) -> bytes:
    """Return the payload that `split_streams` takes apart.

    >>> join_streams([bytes([0xE0, 7, 8]), bytes([0xE0, 9])]).hex()
    'e0020708e009'
    """
    *first, last = packets
    return b"".join(packet[:1] + frame_length(len(packet) - 1) + packet[1:] for packet in first) + last


def join_frames(head: int, frames: list[bytes]) -> bytes:
    """Join frames of the same configuration to a packet of code 3 (RFC 6716 section 3.2.5)."""
    if len(frames) == 1:
        return bytes([head]) + frames[0]
    if len({len(frame) for frame in frames}) == 1:
        return bytes([head | _CODE, len(frames)]) + b"".join(frames)
    lengths = b"".join(frame_length(len(frame)) for frame in frames[:-1])
    return bytes([head | _CODE, 0x80 | len(frames)]) + lengths + b"".join(frames)


def split_frames(packet: bytes) -> list[bytes]:
    """Return the packets of one frame each that `join_frames` has joined.

    >>> split_frames(join_frames(0xF0, [b"abc", b"d", b"ef"]))
    [b'\\xf0abc', b'\\xf0d', b'\\xf0ef']
    """
    if packet[0] & _CODE == 0:
        return [packet]
    head, count, position = bytes([packet[0] & ~_CODE]), packet[1] & 0x3F, 2
    sizes = [(len(packet) - 2) // max(count, 1)] * (count - 1)
    if packet[1] & 0x80:
        for number in range(count - 1):
            sizes[number], position = read_frame_length(packet, position)
    frames = []
    for size in sizes:
        frames.append(head + packet[position : position + size])
        position += size
    return [*frames, head + packet[position:]]
