"""Arrivals as a log holds them: whatever came, at whatever time, is read back to the bit."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.bridges import protobuf
from tactophone.bridges.packet_coding import PacketReader, PacketWriter
from tactophone.bridges.sound_messages import SoundMessages
from tactophone.bridges.sound_payload import split_payload
from tactophone.telemetry import EventBatch

KINDS = (96, 97, 98, 99, 101)


def rtp(kind: int, number: int, payload: bytes) -> bytes:
    return bytes([0]) + struct.pack("!BBHII", 0x80, kind, number % 65536, 240 * number, 7) + payload


def read_back(arrivals: list[EventBatch]) -> list[EventBatch]:
    """Write arrivals as `RunReader` does, and read them as `read_log` does."""
    writer, reader, sound = PacketWriter(), PacketReader(), SoundMessages()
    marked = []
    messages = []
    for arrival in arrivals:
        known = []
        for event in arrival.events:
            parts = sound.push(event[1:], arrival=arrival.time) if event[:1] == b"\0" else None
            messages += parts or []
            known.append(parts is not None)
        marked.append((arrival, known))
    for topic, _, data in [*messages, *sound.flush()]:
        reader.sound.add(topic.finger, topic.kind, data)
    return list(reader.decode(writer.encode(marked)))


@given(
    st.lists(
        st.tuples(
            st.sampled_from([0.005, 0.00512345678, 0.0, -0.001, 3.0]),
            st.booleans(),
            st.lists(st.tuples(st.sampled_from(KINDS), st.binary(max_size=12)), max_size=3),
            st.binary(max_size=12),
        ),
        min_size=1,
        max_size=12,
    )
)
def test_any_arrivals_are_read_back(entries: list[tuple[float, bool, list[tuple[int, bytes]], bytes]]) -> None:
    arrivals, time, number = [], 100.0, 0
    for delay, polled, payloads, report in entries:
        time += delay
        events = []
        for kind, payload in payloads:
            number += 1
            events.append(rtp(kind, number, payload))
        arrivals.append(EventBatch(time, (*events, bytes([1]) + report), polled))
    assert read_back(arrivals) == arrivals


def test_a_stream_that_repeats_its_payloads_costs_a_byte_or_two_for_each_packet() -> None:
    payloads = [bytes([0xE8, 3, *[n, n, n], 0xE8, *[n, 1, 2]]) for n in range(100)]
    packets = [
        rtp(
            101, n, bytes([0x80 | 99]) + struct.pack("!I", 240 << 10 | len(before))[1:] + bytes([99]) + before + payload
        )
        for n, (before, payload) in enumerate(zip([payloads[0], *payloads], payloads, strict=False))
    ]
    arrivals = [EventBatch(round(0.005 * n, 5), (packet,)) for n, packet in enumerate(packets)]
    assert read_back(arrivals) == arrivals
    written = PacketWriter().encode([(arrival, [True]) for arrival in arrivals])
    assert len(written) < 100 + 2 * len(packets)


def test_times_of_packets_that_follow_one_another_cost_a_byte_each_and_reports_their_changes() -> None:
    reports = [
        struct.pack("!7I", 0x80C80006, 7, n, (0xFFFFFF00 + 17 * n) % (1 << 32), 9600 * n, 40 * n, 4800 * n)
        for n in range(20)
    ]
    arrivals = [EventBatch(round(time, 5), (bytes([1]) + report,))
                for time, report in zip(np.arange(0, 4, 0.2), reports, strict=True)]  # fmt: skip
    assert read_back(arrivals) == arrivals
    assert len(PacketWriter().encode([(arrival, [False]) for arrival in arrivals])) < 50 + 18 * len(arrivals)


def test_a_message_with_more_arrivals_than_times_is_an_error() -> None:
    message = protobuf.signed(4, [0]) + protobuf.octets(1, protobuf.octets(3, b"\2{}") + protobuf.integer(4, 1 << 60))
    with pytest.raises(ValueError, match="1 times"):
        list(PacketReader().decode(message))


def test_sound_that_is_missing_is_an_error() -> None:
    payload = bytes([0xE8, 1, 5, 0xE8, 6])
    assert split_payload(99, payload) == [b"\xe8\x05", b"\xe8\x06"]
    written = PacketWriter().encode([(EventBatch(1.0, (rtp(99, 1, payload),)), [True])])
    reader = PacketReader()
    with pytest.raises(ValueError, match="missing"):
        list(reader.decode(written))
