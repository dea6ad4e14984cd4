"""Order, holes and lateness, with the fate of each packet written down."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.link import Codec, DecodedAudio, Depacketizer, Packetizer, Redundancy, RedundancyRule
from tactophone.link.packet import CLOCK_RATE, Packet, Payload, PayloadType
from tactophone.types import AudioBlock, FloatArray

PCM = Codec("pcm16", packet_size=240)
SECOND = 0.005


def noise(size: int) -> FloatArray:
    return np.random.default_rng(3).integers(-3_000, 3_000, (size, 2)).astype(np.float32) / 32_768


def packets(sound: FloatArray, *, depth: int = 0, codec: Codec = PCM) -> list[Packet]:
    redundancy = Redundancy(RedundancyRule(least=depth, most=depth))
    return Packetizer(codec, ssrc=1, redundancy=redundancy).push(AudioBlock(sound, CLOCK_RATE))


def arrive(
    order: Sequence[Packet | None], arrival: Depacketizer | None = None
) -> tuple[list[DecodedAudio], Depacketizer]:
    """Let one packet come each 5 ms; ``None`` where none does."""
    arrival = arrival or Depacketizer()
    heard: list[DecodedAudio] = []
    for step, packet in enumerate(order):
        now = 100 + step * SECOND
        heard += arrival.push([packet] if packet else [], now=now)
        heard += arrival.poll(now)
    return heard + arrival.poll(1e6), arrival


def joined(heard: list[DecodedAudio]) -> FloatArray:
    return np.concatenate([one.block.samples for one in heard])


def is_contiguous(heard: list[DecodedAudio]) -> bool:
    return all(one.block.end == other.block.start for one, other in pairwise(heard))


def test_sound_passes_unchanged_and_without_waiting() -> None:
    sound = noise(2_400)
    arrival = Depacketizer()
    for step, packet in enumerate(packets(sound)):
        (heard,) = arrival.push([packet], now=step * SECOND)
        np.testing.assert_array_equal(heard.block.samples, sound[step * 240 : step * 240 + 240])
        assert (heard.block.start, heard.block.concealed, heard.stale) == (step * 240, False, False)


def test_a_lost_packet_is_concealed_and_marked() -> None:
    sound = noise(2_400)
    sent = packets(sound)
    heard, arrival = arrive([*sent[:4], None, *sent[5:]])
    assert [one.block.start for one in heard if one.block.concealed] == [960]
    assert joined(heard).shape == sound.shape
    assert is_contiguous(heard)
    stats = arrival.reception.stats
    assert (stats.packets_lost, stats.samples_concealed, stats.concealment_events) == (1, 240, 1)
    assert stats.packets_expected == 10


@pytest.mark.parametrize(("depth", "lost"), [(1, [4]), (2, [4, 5]), (1, [2, 4, 6])])
def test_redundancy_brings_it_back_to_the_bit(depth: int, lost: list[int]) -> None:
    codec = Codec("pcm16", packet_size=96)
    sound = noise(960)
    sent = packets(sound, depth=depth, codec=codec)
    heard, arrival = arrive([None if step in lost else packet for step, packet in enumerate(sent)])
    np.testing.assert_array_equal(joined(heard), sound)
    assert arrival.reception.stats.packets_recovered == len(lost)


def test_a_packet_that_overtook_another_waits_for_it() -> None:
    sound = noise(2_400)
    sent = packets(sound)
    sent[3], sent[4] = sent[4], sent[3]
    heard, arrival = arrive(sent)
    np.testing.assert_array_equal(joined(heard), sound)
    assert arrival.reception.stats.packets_late == 0


def test_without_a_reorder_window_nothing_waits() -> None:
    sent = packets(noise(2_400))
    arrival = Depacketizer(reorder=0)
    arrival.push(sent[:1], now=0)
    assert [one.block.concealed for one in arrival.push(sent[2:3], now=0.01)] == [True, False]
    arrival.push(sent[1:2], now=0.011)
    assert arrival.reception.stats.packets_late == 1


def test_a_packet_waits_no_longer_than_the_next_one_should_take() -> None:
    sent = packets(noise(2_400))
    arrival = Depacketizer()
    arrival.push(sent[:1], now=0)
    assert arrival.push(sent[2:3], now=0.010) == []
    assert arrival.poll(0.0149) == []
    assert [one.block.concealed for one in arrival.poll(0.0151)] == [True, False]


def test_duplicates_are_counted_and_dropped() -> None:
    sound = noise(2_400)
    sent = packets(sound)
    heard, arrival = arrive([packet for packet in sent for _ in range(2)])
    np.testing.assert_array_equal(joined(heard), sound)
    assert arrival.reception.stats.packets_duplicated == 10


def test_a_stall_and_a_clump_leave_history_that_is_not_judged() -> None:
    sound = noise(48_000)
    sent = packets(sound)
    arrival = Depacketizer()
    for step, packet in enumerate(sent[:100]):
        arrival.push([packet], now=step * SECOND)
    heard = arrival.push(sent[100:140], now=140.5 * SECOND)
    assert is_contiguous(heard)
    assert [one.stale for one in heard] == [True] * 29 + [False] * 11
    assert not any(one.stale for one in arrival.push(sent[140:141], now=141 * SECOND))


def test_a_longer_way_is_believed_within_a_second() -> None:
    arrival = Depacketizer()
    late: list[float] = []
    for step, packet in enumerate(packets(noise(240 * 600))):
        now = step * SECOND + (0.2 if step > 200 else 0)
        late += [now for one in arrival.push([packet], now=now) if one.stale]
    assert late[0] == pytest.approx(1.205)
    assert late[-1] < 2.3


def test_a_hole_too_long_to_guess_is_skipped() -> None:
    sent = packets(noise(240 * 60))
    heard, arrival = arrive([*sent[:10], *[None] * 40, *sent[50:]])
    assert not is_contiguous(heard)
    assert not any(one.block.concealed for one in heard)
    assert arrival.reception.stats.samples_skipped == 40 * 240


def test_timestamps_and_numbers_may_wrap() -> None:
    content = np.zeros((240, 2), ">i2").tobytes()
    sent = [
        Packet((65_530 + k) % 2**16, 1, Payload(PayloadType.L16_STEREO, (2**32 - 960 + 240 * k) % 2**32, content))
        for k in range(12)
    ]
    heard, arrival = arrive(sent)
    assert [one.block.start for one in heard] == [240 * k for k in range(12)]
    assert arrival.reception.stats.packets_lost == 0
    assert arrival.reception.stats.jitter < 1e-6


def test_a_broken_payload_is_a_hole() -> None:
    sent = packets(noise(2_400))
    sent[4] = Packet(sent[4].sequence, 1, Payload(PayloadType.L16_STEREO, sent[4].payload.timestamp, b"odd"))
    heard, arrival = arrive(sent)
    assert [one.block.start for one in heard if one.block.concealed] == [960]
    assert arrival.reception.stats.packets_broken == 1


@given(st.lists(st.sampled_from(["come", "lose", "twice", "late"]), min_size=1, max_size=40), st.integers(0, 2))
def test_whatever_happens_sound_is_contiguous_and_real_where_unmarked(fates: list[str], depth: int) -> None:
    codec = Codec("pcm16", packet_size=64)
    sound = noise(64 * len(fates))
    sent = packets(sound, depth=depth, codec=codec)
    order: list[Packet | None] = []
    held: list[Packet] = []
    for fate, packet in zip(fates, sent, strict=True):
        order += {"come": [packet], "lose": [None], "twice": [packet, packet], "late": []}[fate]
        order += held
        held = [packet] if fate == "late" else []
    heard, _ = arrive(order)
    assert all(one.block.end <= other.block.start for one, other in pairwise(heard))
    begun = next((sent.index(packet) for packet in order if packet), 0)
    for one in heard:
        if not one.block.concealed:
            start = one.block.start + 64 * begun
            np.testing.assert_array_equal(one.block.samples, sound[start : start + 64])


def test_opus_through_a_hole_stays_in_step() -> None:
    time = np.arange(48_000, dtype=np.float32)[:, np.newaxis] / CLOCK_RATE
    sound = np.repeat(0.3 * np.sin(2 * np.pi * 200 * time), 2, axis=1).astype(np.float32)
    sent = packets(sound, codec=Codec("opus"))
    heard, _ = arrive([None if step % 20 == 7 else packet for step, packet in enumerate(sent)])
    error = joined(heard)[4_920:] - sound[4_800:-120]
    assert joined(heard).shape == sound.shape
    assert error.std() < 0.1 * sound.std()


def test_only_two_reorder_windows_exist() -> None:
    with pytest.raises(ValueError, match="0 or 1"):
        Depacketizer(reorder=2)
