"""Golden packets, one for each shape and each fault, and round trips that hypothesis
searches."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from tactophone.core.errors import PacketError
from tactophone.net.link.packet import (
    MAX_DATAGRAM,
    MAX_EARLIER_OFFSET,
    MAX_EARLIER_SIZE,
    MOTION,
    PAYLOAD_SPACE,
    SRTP_OVERHEAD,
    Packet,
    Payload,
    PayloadType,
    ahead,
    is_dtls,
    is_report,
    is_srtp,
    parse_packet,
)

GOLDEN = Path(__file__).parents[5] / "tests" / "data" / "packets"

FAULTS = {
    "empty": "0 bytes",
    "truncated_header": "11 bytes",
    "wrong_version": "version 1",
    "unknown_payload_type": "payload type 0",
    "sources_past_the_end": "header of 72 bytes",
    "extension_past_the_end": "header of 1036 bytes",
    "extension_header_cut": "header extension",
    "padding_of_nothing": "0 bytes of padding",
    "padding_past_the_start": "255 bytes of padding",
    "earlier_header_cut": "ends within",
    "earlier_past_the_end": "earlier payload of 2 bytes, but 1",
    "no_payload_of_its_own": "own payload is missing",
    "redundancy_within_redundancy": "payload type 101",
}

SOUND = Payload(PayloadType.OPUS, 960, b"sound")
BEFORE = Payload(PayloadType.OPUS, 720, b"ab")
PLAIN = Packet(7, ssrc=42, payload=SOUND)
SHAPES = {
    "plain": PLAIN,
    "marked": Packet(7, ssrc=42, payload=SOUND, marker=True),
    "one_earlier": Packet(7, ssrc=42, payload=SOUND, earlier=(BEFORE,)),
    "two_earlier": Packet(
        7,
        ssrc=42,
        payload=SOUND,
        earlier=(Payload(PayloadType.OPUS, 480, b"Z"), BEFORE),
    ),
}

kinds = st.sampled_from([kind for kind in PayloadType if kind != PayloadType.RED])
earlier = st.tuples(
    kinds, st.integers(0, MAX_EARLIER_OFFSET), st.binary(max_size=MAX_EARLIER_SIZE)
)


def golden(name: str) -> bytes:
    return (GOLDEN / f"{name}.bin").read_bytes()


@pytest.mark.parametrize("name", FAULTS)
def test_each_fault_is_named(name: str) -> None:
    with pytest.raises(PacketError, match=FAULTS[name]):
        parse_packet(golden(name))


@pytest.mark.parametrize("name", SHAPES)
def test_each_shape_is_read_and_written_to_the_byte(name: str) -> None:
    assert parse_packet(golden(name)) == SHAPES[name]
    assert bytes(SHAPES[name]) == golden(name)


@pytest.mark.parametrize("name", ["contributing_sources", "extension", "padded"])
def test_fields_of_other_senders_are_skipped(name: str) -> None:
    assert parse_packet(golden(name)) == PLAIN


@given(
    st.integers(0, 65_535),
    st.integers(0, 2**32 - 1),
    st.lists(earlier, max_size=2),
    st.binary(),
    st.booleans(),
)
def test_any_packet_survives_the_wire(
    sequence: int,
    timestamp: int,
    past: list[tuple[PayloadType, int, bytes]],
    content: bytes,
    marker: bool,
) -> None:
    before = tuple(
        Payload(kind, (timestamp - offset) % 2**32, sound)
        for kind, offset, sound in past
    )
    payload = Payload(PayloadType.L16_STEREO, timestamp, content)
    packet = Packet(sequence, ssrc=9, payload=payload, earlier=before, marker=marker)
    assert parse_packet(bytes(packet)) == packet


@given(st.binary(max_size=80))
def test_no_bytes_crash_the_parser(datagram: bytes) -> None:
    for start in (b"", b"\x80\x65", b"\xb1\x62"):
        try:
            parse_packet(start + datagram)
        except PacketError:
            continue


@given(st.integers(0, 2**16 - 1), st.integers(-(2**15), 2**15 - 1))
def test_wrapping_counters_are_compared_by_the_shorter_distance(
    reference: int, step: int
) -> None:
    assert ahead((reference + step) % 2**16, reference, bits=16) == step


@pytest.mark.parametrize("name", SHAPES)
def test_a_robot_that_moves_is_a_contributing_source_and_the_packet_reads_back(
    name: str,
) -> None:
    moving = replace(SHAPES[name], moving=True)
    data = bytes(moving)
    assert (data[0], data[12:16]) == (0x81, MOTION)
    assert parse_packet(data) == moving
    assert len(data) == len(bytes(SHAPES[name])) + 4
    # Another sender's sources are no motion.
    assert parse_packet(data[:12] + b"ELSE" + data[16:]) == SHAPES[name]


def test_the_largest_packet_fits_a_datagram_while_the_robot_moves() -> None:
    packet = Packet(
        1,
        ssrc=1,
        payload=Payload(PayloadType.L16_HAND_5, 0, bytes(PAYLOAD_SPACE)),
        moving=True,
    )
    assert len(bytes(packet)) + SRTP_OVERHEAD == MAX_DATAGRAM


def test_an_empty_datagram_is_of_no_kind() -> None:
    """UDP may carry nothing at all."""
    assert not is_dtls(b"")
    assert not is_srtp(b"")
    assert not is_report(b"")
    assert not is_report(b"\x80")
