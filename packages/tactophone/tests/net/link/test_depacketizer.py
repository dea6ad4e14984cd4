"""Order, gaps and lateness, with the delivery of each packet prescribed."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.core.types import AudioBlock, FloatArray
from tactophone.net.link.codec import Codec
from tactophone.net.link.packet import CLOCK_RATE, Packet, Payload, PayloadType
from tactophone.net.link.stream import (
    CONCEALED_AT_ONCE,
    CONCEALED_PACE,
    PACKET_HISTORY,
    SOUND_AT_ONCE,
    BlockEncoder,
    DecodedAudio,
    Depacketizer,
    Packetizer,
    Redundancy,
    RedundancyRule,
)

PCM = Codec("pcm16", packet_size=240)
SECOND = 0.005


def noise(size: int) -> FloatArray:
    return (
        np.random.default_rng(3).integers(-3_000, 3_000, (size, 2)).astype(np.float32)
        / 32_768
    )


def packets(sound: FloatArray, *, depth: int = 0, codec: Codec = PCM) -> list[Packet]:
    redundancy = Redundancy(RedundancyRule(least=depth, most=depth))
    packetizer = Packetizer(BlockEncoder(codec), ssrc=1, redundancy=redundancy)
    return list(
        map(packetizer.packet, packetizer.encoder.push(AudioBlock(sound, CLOCK_RATE)))
    )


def arrive(
    order: Sequence[Packet | None], depacketizer: Depacketizer | None = None
) -> tuple[list[DecodedAudio], Depacketizer]:
    """Deliver a packet every 5 ms; ``None`` for a lost one."""
    depacketizer = depacketizer or Depacketizer()
    decoded: list[DecodedAudio] = []
    for step, packet in enumerate(order):
        now = 100 + step * SECOND
        decoded += depacketizer.push([packet] if packet else [], now=now)
        decoded += depacketizer.poll(now)
    return decoded + depacketizer.poll(1e6), depacketizer


def joined(decoded: list[DecodedAudio]) -> FloatArray:
    return np.concatenate([audio.block.samples for audio in decoded])


def is_contiguous(decoded: list[DecodedAudio]) -> bool:
    return all(
        audio.block.end == following.block.start
        for audio, following in pairwise(decoded)
    )


def test_sound_passes_unchanged_and_without_waiting() -> None:
    sound = noise(2_400)
    depacketizer = Depacketizer()
    for step, packet in enumerate(packets(sound)):
        (decoded,) = depacketizer.push([packet], now=step * SECOND)
        np.testing.assert_array_equal(
            decoded.block.samples, sound[step * 240 : step * 240 + 240]
        )
        assert (decoded.block.start, decoded.block.concealed, decoded.stale) == (
            step * 240,
            False,
            False,
        )


def test_a_lost_packet_is_concealed_and_marked() -> None:
    sound = noise(2_400)
    sent = packets(sound)
    decoded, depacketizer = arrive([*sent[:4], None, *sent[5:]])
    assert [audio.block.start for audio in decoded if audio.block.concealed] == [960]
    assert joined(decoded).shape == sound.shape
    assert is_contiguous(decoded)
    stats = depacketizer.reception.stats
    assert (stats.packets_lost, stats.samples_concealed) == (1, 240)
    assert stats.packets_expected == 10


@pytest.mark.parametrize(("depth", "lost"), [(1, [4]), (2, [4, 5]), (1, [2, 4, 6])])
def test_redundancy_recovers_it_exactly(depth: int, lost: list[int]) -> None:
    codec = Codec("pcm16", packet_size=96)
    sound = noise(960)
    sent = packets(sound, depth=depth, codec=codec)
    decoded, depacketizer = arrive(
        [None if step in lost else packet for step, packet in enumerate(sent)]
    )
    np.testing.assert_array_equal(joined(decoded), sound)
    assert depacketizer.reception.stats.packets_recovered == len(lost)


def test_a_packet_that_overtook_another_waits_for_it() -> None:
    sound = noise(2_400)
    sent = packets(sound)
    sent[3], sent[4] = sent[4], sent[3]
    decoded, depacketizer = arrive(sent)
    np.testing.assert_array_equal(joined(decoded), sound)
    assert depacketizer.reception.stats.packets_late == 0


def test_without_a_reorder_window_nothing_waits() -> None:
    sent = packets(noise(2_400))
    depacketizer = Depacketizer(reorder=0)
    depacketizer.push(sent[:1], now=0)
    assert [
        audio.block.concealed for audio in depacketizer.push(sent[2:3], now=0.01)
    ] == [True, False]
    depacketizer.push(sent[1:2], now=0.011)
    assert depacketizer.reception.stats.packets_late == 1


def test_a_packet_waits_no_longer_than_the_next_one_should_take() -> None:
    sent = packets(noise(2_400))
    depacketizer = Depacketizer()
    depacketizer.push(sent[:1], now=0)
    assert depacketizer.push(sent[2:3], now=0.010) == []
    assert depacketizer.poll(0.0149) == []
    assert [audio.block.concealed for audio in depacketizer.poll(0.0151)] == [
        True,
        False,
    ]


def test_duplicates_are_counted_and_dropped() -> None:
    sound = noise(2_400)
    sent = packets(sound)
    decoded, depacketizer = arrive([packet for packet in sent for _ in range(2)])
    np.testing.assert_array_equal(joined(decoded), sound)
    assert depacketizer.reception.stats.packets_duplicated == 10


def test_a_stall_and_its_burst_are_stale_history() -> None:
    sound = noise(48_000)
    sent = packets(sound)
    depacketizer = Depacketizer()
    for step, packet in enumerate(sent[:100]):
        depacketizer.push([packet], now=step * SECOND)
    decoded = depacketizer.push(sent[100:140], now=140.5 * SECOND)
    assert is_contiguous(decoded)
    assert [audio.stale for audio in decoded] == [True] * 29 + [False] * 11
    assert not any(
        audio.stale for audio in depacketizer.push(sent[140:141], now=141 * SECOND)
    )


def test_a_longer_path_is_followed_within_a_second() -> None:
    depacketizer = Depacketizer()
    late: list[float] = []
    for step, packet in enumerate(packets(noise(240 * 600))):
        now = step * SECOND + (0.2 if step > 200 else 0)
        late += [now for audio in depacketizer.push([packet], now=now) if audio.stale]
    assert late[0] == pytest.approx(1.205)
    assert late[-1] < 2.3


def test_a_longer_path_is_followed_within_three_tenths_of_a_second() -> None:
    depacketizer = Depacketizer()
    late: list[float] = []
    for step, packet in enumerate(packets(noise(240 * 600))):
        now = step * SECOND + (0.2 if step > 200 else 0)
        late += [now for audio in depacketizer.push([packet], now=now) if audio.stale]
    assert late[-1] - late[0] < 0.3


def test_of_a_long_backlog_only_the_newest_is_decoded() -> None:
    depacketizer = Depacketizer()
    sent = packets(noise(240 * 500))
    for step, packet in enumerate(sent[:50]):
        depacketizer.push([packet], now=step * SECOND)
    decoded = depacketizer.push(sent[50:450], now=449.5 * SECOND)
    assert sum(audio.block.size for audio in decoded) == pytest.approx(
        PACKET_HISTORY * CLOCK_RATE, abs=480
    )
    assert is_contiguous(decoded)
    assert decoded[-1].block.end == 450 * 240
    assert not decoded[-1].stale
    stats = depacketizer.reception.stats
    assert stats.samples_skipped == 400 * 240 - sum(
        audio.block.size for audio in decoded
    )
    assert (
        stats.packets_skipped
        == sum(audio.stale for audio in decoded) + stats.samples_skipped / 240
    )


def test_a_gap_too_long_to_conceal_is_skipped() -> None:
    sent = packets(noise(240 * 60))
    decoded, depacketizer = arrive([*sent[:10], *[None] * 40, *sent[50:]])
    assert not is_contiguous(decoded)
    assert not any(audio.block.concealed for audio in decoded)
    assert depacketizer.reception.stats.samples_skipped == 40 * 240


def test_timestamps_and_numbers_may_wrap() -> None:
    content = np.zeros((240, 2), ">i2").tobytes()
    sent = [
        Packet(
            (65_530 + k) % 2**16,
            1,
            Payload(PayloadType.L16_STEREO, (2**32 - 960 + 240 * k) % 2**32, content),
        )
        for k in range(12)
    ]
    decoded, depacketizer = arrive(sent)
    assert [audio.block.start for audio in decoded] == [240 * k for k in range(12)]
    assert depacketizer.reception.stats.packets_lost == 0
    assert depacketizer.reception.stats.jitter < 1e-6


def test_a_broken_payload_is_a_gap() -> None:
    sent = packets(noise(2_400))
    sent[4] = Packet(
        sent[4].sequence,
        1,
        Payload(PayloadType.L16_STEREO, sent[4].payload.timestamp, b"odd"),
    )
    decoded, depacketizer = arrive(sent)
    assert [audio.block.start for audio in decoded if audio.block.concealed] == [960]
    assert depacketizer.reception.stats.packets_broken == 1


@given(
    st.lists(
        st.sampled_from(["deliver", "lose", "twice", "late"]), min_size=1, max_size=40
    ),
    st.integers(0, 2),
)
def test_sound_is_ordered_and_exact_where_not_marked_concealed(
    deliveries: list[str], depth: int
) -> None:
    codec = Codec("pcm16", packet_size=64)
    sound = noise(64 * len(deliveries))
    sent = packets(sound, depth=depth, codec=codec)
    order: list[Packet | None] = []
    held: list[Packet] = []
    for delivery, packet in zip(deliveries, sent, strict=True):
        order += {
            "deliver": [packet],
            "lose": [None],
            "twice": [packet, packet],
            "late": [],
        }[delivery]
        order += held
        held = [packet] if delivery == "late" else []
    decoded, _ = arrive(order)
    assert all(
        audio.block.end <= following.block.start
        for audio, following in pairwise(decoded)
    )
    begun = next((sent.index(packet) for packet in order if packet), 0)
    for audio in decoded:
        if not audio.block.concealed:
            start = audio.block.start + 64 * begun
            np.testing.assert_array_equal(
                audio.block.samples, sound[start : start + 64]
            )


def test_opus_stays_aligned_through_a_gap() -> None:
    time = np.arange(48_000, dtype=np.float32)[:, np.newaxis] / CLOCK_RATE
    sound = np.repeat(0.3 * np.sin(2 * np.pi * 200 * time), 2, axis=1).astype(
        np.float32
    )
    sent = packets(sound, codec=Codec("opus"))
    decoded, _ = arrive(
        [None if step % 20 == 7 else packet for step, packet in enumerate(sent)]
    )
    error = joined(decoded)[4_920:] - sound[4_800:-120]
    assert joined(decoded).shape == sound.shape
    assert error.std() < 0.1 * sound.std()


def test_only_two_reorder_windows_exist() -> None:
    with pytest.raises(ValueError, match="0 or 1"):
        Depacketizer(reorder=2)


def test_a_stream_keeps_its_codec_and_channels_until_the_next_handshake() -> None:
    stereo = packets(noise(1_200))
    mono = [
        Packet(
            sequence,
            ssrc=1,
            payload=Payload(PayloadType.L16_MONO, packet.payload.timestamp, bytes(480)),
        )
        for sequence, packet in enumerate(stereo, stereo[0].sequence)
    ]
    mixed = [
        pair[number % 2] for number, pair in enumerate(zip(stereo, mono, strict=True))
    ]
    decoded, depacketizer = arrive(mixed)
    assert {audio.block.channels for audio in decoded} == {2}
    assert depacketizer.reception.stats.packets_broken >= 2


@pytest.mark.parametrize(
    "order", [range(8), (0, 1, 3, 2, 4, 5, 6, 7), (0, 1, 2, 4, 5, 6, 7)]
)
def test_whether_the_robot_moves_comes_with_the_sound(order: Sequence[int]) -> None:
    packetizer = Packetizer(
        BlockEncoder(PCM),
        ssrc=1,
        redundancy=Redundancy(RedundancyRule(least=1, most=1)),
    )
    sent = []
    for number in range(8):
        packetizer.encoder.moving = 4 <= number < 6
        block = AudioBlock(noise(240), CLOCK_RATE, 240 * number)
        sent += map(packetizer.packet, packetizer.encoder.push(block))
    decoded, _ = arrive([sent[number] for number in order])
    # Sound that is recovered comes with what the packet says that brought it.
    still = 4 - (len(order) < 8)
    assert [audio.block.moving for audio in decoded] == [False] * still + [True] * (
        6 - still
    ) + [False] * 2


@pytest.mark.parametrize("jump", [0, 1, 240, 4_800, 4_801])
@pytest.mark.parametrize("times_as_many", [1, 10])
def test_a_robot_whose_timestamps_run_ahead_makes_no_sound_faster_than_it_lasts(
    jump: int, times_as_many: int
) -> None:
    """What is decoded is computed: a backlog of it would be felt when the robot is long
    silent."""
    seconds = 8.0
    content = packets(noise(240))[0].payload.content
    depacketizer = Depacketizer()
    decoded: list[DecodedAudio] = []
    for number in range(round(times_as_many * seconds / SECOND)):
        now = 100 + number * SECOND / times_as_many
        position = number * (240 + jump) % (1 << 32)
        payload = Payload(PayloadType.L16_STEREO, position, content)
        packet = Packet(number % (1 << 16), 1, payload)
        decoded += depacketizer.push([packet], now=now)
        decoded += depacketizer.poll(now)
    fresh, concealed = (
        sum(audio.block.size for audio in decoded if audio.block.concealed == kind)
        / CLOCK_RATE
        for kind in (False, True)
    )
    assert fresh <= 1.02 * seconds + SOUND_AT_ONCE
    assert concealed <= CONCEALED_PACE * seconds + CONCEALED_AT_ONCE
    if times_as_many == 1:
        # The robot's own sound is all there.
        assert fresh > 0.95 * seconds
