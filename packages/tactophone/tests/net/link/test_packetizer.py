"""Blocks of any length become packets of one length, with the redundancy that the loss
requires."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.core.types import AudioBlock, FloatArray
from tactophone.net.link.codec import Codec, open_decoder
from tactophone.net.link.packet import MAX_DATAGRAM, SRTP_OVERHEAD, Packet, parse_packet
from tactophone.net.link.stream import (
    BlockEncoder,
    Packetizer,
    Redundancy,
    RedundancyRule,
)
from tests.sounds import ODD_SIZES, blocks

RATE = 48_000
PCM = Codec("pcm16", packet_size=120)


def packetizer(codec: Codec = PCM, depth: int = 0) -> Packetizer:
    return Packetizer(
        BlockEncoder(codec),
        ssrc=1,
        redundancy=Redundancy(RedundancyRule(least=depth, most=depth)),
    )


def push(packetizer: Packetizer, block: AudioBlock) -> list[Packet]:
    return list(map(packetizer.packet, packetizer.encoder.push(block)))


def noise(size: int) -> FloatArray:
    return np.random.default_rng(0).normal(0, 0.1, (size, 2)).astype(np.float32)


def contents(packets: list[Packet]) -> list[bytes]:
    return [packet.payload.content for packet in packets]


@pytest.mark.parametrize("codec", [PCM, Codec("opus")], ids=["pcm16", "opus"])
@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_bits(codec: Codec, size: int) -> None:
    sound = noise(4_000)
    cut = packetizer(codec)
    whole = packetizer(codec)
    pieces = [packet for block in blocks(sound, size) for packet in push(cut, block)]
    assert contents(pieces) == contents(push(whole, AudioBlock(sound, RATE)))


def test_numbers_and_times_go_on_and_a_gap_is_marked() -> None:
    out = packetizer()
    first = push(out, AudioBlock(noise(240), RATE))
    after = push(out, AudioBlock(noise(240), RATE, start=960))
    packets = first + after
    assert [packet.marker for packet in packets] == [True, False, True, False]
    begun = packets[0]
    assert [packet.sequence - begun.sequence for packet in packets] == [0, 1, 2, 3]
    times = [
        (packet.payload.timestamp - begun.payload.timestamp) % 2**32
        for packet in packets
    ]
    assert times == [0, 120, 960, 1_080]


@pytest.mark.parametrize("size", [1, 100, 128, 240])
@pytest.mark.parametrize("depth", [0, 1, 2])
def test_a_packet_never_outgrows_a_datagram(size: int, depth: int) -> None:
    packets = push(
        packetizer(Codec("pcm16", packet_size=size), depth),
        AudioBlock(noise(4 * size), RATE),
    )
    assert max(len(bytes(packet)) + SRTP_OVERHEAD for packet in packets) <= MAX_DATAGRAM
    assert all(parse_packet(bytes(packet)) == packet for packet in packets)


def test_the_past_that_is_carried_is_the_newest() -> None:
    packets = push(
        packetizer(Codec("opus", packet_size=120), depth=2),
        AudioBlock(noise(1_200), RATE),
    )
    assert packets[5].earlier == (packets[3].payload, packets[4].payload)


def test_what_is_no_number_is_sent_as_silence_and_counted() -> None:
    sound = noise(240)
    sound[3], sound[7, 0] = np.nan, np.inf
    out = packetizer()
    packets = push(out, AudioBlock(sound, RATE))
    assert packets[0].payload.content[12:16] == bytes(4)
    assert out.encoder.faults == {"invalid samples": 3}


@pytest.mark.parametrize(
    "block", [AudioBlock(noise(10), 44_100), AudioBlock(noise(10)[:, :1], RATE)]
)
def test_other_sound_is_refused(block: AudioBlock) -> None:
    with pytest.raises(ValueError, match="this stream carries"):
        push(packetizer(), block)


@given(st.lists(st.sampled_from([0.0, 0.01, 0.1]), max_size=200))
def test_redundancy_stays_within_its_rule(losses: list[float]) -> None:
    redundancy = Redundancy(RedundancyRule())
    for loss in losses:
        redundancy.update(loss)
        assert redundancy.depth in range(3)
        assert redundancy.depth >= 1 or loss == 0


def test_redundancy_is_shed_step_by_step() -> None:
    redundancy = Redundancy(RedundancyRule())
    redundancy.update(0.2)
    depths = []
    for _ in range(100):
        redundancy.update(0.0)
        depths.append(redundancy.depth)
    assert (depths[0], depths[49], depths[99]) == (2, 1, 0)


def test_a_rule_that_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="between 0 and 2"):
        RedundancyRule(least=2, most=1)


@pytest.mark.parametrize(
    "codec",
    [Codec("opus", packet_size=480), Codec("opus"), Codec("pcm16", packet_size=240)],
)
def test_the_rest_of_a_long_block_need_not_wait_for_the_next(codec: Codec) -> None:
    rule = RedundancyRule(most=0)
    prompt = Packetizer(
        BlockEncoder(codec, prompt=True), ssrc=1, redundancy=Redundancy(rule)
    )
    decoder, decoded = open_decoder(codec.kind), 0
    for block in blocks(noise(512 * 40), 512):
        for packet in push(prompt, block):
            assert (packet.payload.timestamp - prompt.encoder.origin) % (
                1 << 32
            ) == decoded
            decoded += len(decoder.decode(packet.payload.content))
        assert 0 <= block.end - decoded < (120 if codec.name == "opus" else 1)
