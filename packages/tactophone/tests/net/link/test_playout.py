"""The clocked buffer with real sound: no click, no drift, and what was lost is
counted."""

import sys
from collections.abc import Iterator

import numpy as np
import pytest

from tactophone.core.types import AudioBlock, FloatArray
from tactophone.net.link.codec import Codec
from tactophone.net.link.packet import Packet, Payload, PayloadType
from tactophone.net.link.playout import Playout
from tactophone.net.link.stream import (
    BlockEncoder,
    Packetizer,
    Redundancy,
    RedundancyRule,
)

RATE = 48_000
BLOCK = 128
PCM = Codec("pcm16", packet_size=96)
AMPLITUDE = 0.25
PITCH = 120.0
STEEPEST = AMPLITUDE * 2 * np.pi * PITCH / RATE


def tone(seconds: float) -> FloatArray:
    wave = AMPLITUDE * np.sin(
        2 * np.pi * PITCH * np.arange(round(seconds * RATE)) / RATE
    )
    return np.stack([wave, wave], axis=1).astype(np.float32)


def packets(sound: FloatArray, codec: Codec, redundancy: Redundancy) -> list[Packet]:
    packetizer = Packetizer(BlockEncoder(codec), ssrc=1, redundancy=redundancy)
    return list(
        map(packetizer.packet, packetizer.encoder.push(AudioBlock(sound, RATE)))
    )


def played(
    seconds: float,
    *,
    codec: Codec = PCM,
    skew_ppm: float = 0.0,
    jitter: float = 0.001,
    loss: float = 0.0,
    depth: int = 0,
    stall: tuple[float, float] = (0, 0),
) -> tuple[FloatArray, Playout]:
    """Play a tone over a line, block by block."""
    random, redundancy = (
        np.random.default_rng(4),
        Redundancy(RedundancyRule(least=depth, most=depth)),
    )
    sent = packets(tone(seconds), codec, redundancy)
    speed = RATE * (1 + skew_ppm * 1e-6)
    times = (np.arange(len(sent)) + 1) * codec.packet_size / speed + random.exponential(
        jitter, len(sent)
    )
    times[(times > stall[0]) & (times < stall[1])] = stall[1]
    kept = [
        index for index in np.argsort(times, kind="stable") if random.random() >= loss
    ]
    waiting: Iterator[int] = iter(kept)
    playout = Playout(block_size=BLOCK)
    following = next(waiting, None)
    blocks = []
    for now in np.arange(0, seconds, BLOCK / RATE):
        while following is not None and times[following] <= now:
            playout.push(sent[following], now=float(times[following]))
            following = next(waiting, None)
        blocks.append(playout.pull(now=float(now)))
    return np.concatenate(blocks), playout


@pytest.mark.slow
@pytest.mark.parametrize("skew_ppm", [200, -200])
@pytest.mark.parametrize(
    "codec", [PCM, Codec("opus", packet_size=120)], ids=["pcm16", "opus"]
)
def test_two_clocks_and_jitter_make_no_click(codec: Codec, skew_ppm: float) -> None:
    sound, playout = played(12, codec=codec, skew_ppm=skew_ppm)
    assert np.abs(np.diff(sound[RATE * 6 :], axis=0)).max() < 0.02 + STEEPEST
    assert playout.reception.stats.packets_lost == 0


def test_the_tone_keeps_its_level_and_pitch() -> None:
    sound, _ = played(8, skew_ppm=100)
    spectrum = np.abs(np.fft.rfft(sound[-4 * RATE :, 0] * np.hanning(4 * RATE))) / RATE
    assert np.argmax(spectrum) / 4 == pytest.approx(PITCH, abs=0.3)
    assert sound[-4 * RATE :, 0].std() == pytest.approx(
        AMPLITUDE / np.sqrt(2), rel=0.02
    )


@pytest.mark.parametrize(
    "codec", [PCM, Codec("opus", packet_size=120)], ids=["pcm16", "opus"]
)
def test_loss_and_a_stall_make_no_step(codec: Codec) -> None:
    sound, playout = played(8, codec=codec, loss=0.05, stall=(5.0, 5.2))
    assert np.abs(np.diff(sound, axis=0)).max() < 0.02 + STEEPEST
    assert playout.reception.stats.samples_concealed > 0
    # Normal again within 150 ms of the stall's end.
    after = sound[round(5.35 * RATE) : round(5.85 * RATE), 0]
    assert after.std() == pytest.approx(AMPLITUDE / np.sqrt(2), rel=0.1)


@pytest.mark.slow
def test_redundancy_recovers_nearly_all() -> None:
    _, bare = played(8, loss=0.05)
    _, mended = played(8, loss=0.05, depth=1)
    assert (
        mended.reception.stats.samples_concealed
        < 0.2 * bare.reception.stats.samples_concealed
    )


def test_silence_before_the_first_packet_and_in_a_long_gap() -> None:
    playout = Playout(block_size=BLOCK)
    assert not playout.pull(now=0.0).any()
    sound, _ = played(6, stall=(4.0, 6.0))
    assert np.abs(sound[round(4.1 * RATE) : round(5.9 * RATE)]).max() < 1e-9


def test_late_and_doubled_packets_are_counted() -> None:
    sent = packets(tone(1), PCM, Redundancy(RedundancyRule(most=0)))
    playout = Playout(block_size=BLOCK)
    late = sent.pop(50)
    for step, packet in enumerate(sent[:180]):
        playout.push(packet, now=step * 0.002)
        playout.push(packet, now=step * 0.002)
    for block in range(150):
        playout.pull(now=block * BLOCK / RATE)
    playout.push(late, now=0.4)
    playout.pull(now=0.4)
    assert playout.reception.stats.packets_duplicated == 180
    assert playout.reception.stats.packets_late == 1


@pytest.mark.parametrize(("sent", "played"), [(1, 2), (2, 1)])
def test_channels_are_fitted_to_the_listener(sent: int, played: int) -> None:
    codec = Codec("pcm16", channels=sent, packet_size=96)
    playout = Playout(block_size=96, channels=played)
    for step, packet in enumerate(
        packets(tone(1)[:, :sent], codec, Redundancy(RedundancyRule(most=0)))
    ):
        playout.push(packet, now=step * 0.002)
        block = playout.pull(now=step * 0.002)
    assert block.shape == (96, played)
    assert block.any(axis=0).all()


class FaultyRobot:
    """Sends packets of PCM with whatever timestamps, and counts how much is computed
    for a period of the actuator."""

    def __init__(self) -> None:
        self.playout = Playout(block_size=BLOCK)
        self.content = bytes(2)
        self.now = 0.0
        self.greatest = 0
        self._sequence = 0

    def push(self, position: int) -> None:
        payload = Payload(PayloadType.L16_MONO, position % (1 << 32), self.content)
        packet = Packet(self._sequence % (1 << 16), 1, payload)
        self.playout.push(packet, now=self.now)
        self._sequence += 1

    def pull(self) -> None:
        """Take a period, and count the functions that it calls."""
        self.now += BLOCK / RATE
        calls = 0

        def count(_: object, event: str, __: object) -> None:
            nonlocal calls
            calls += event == "call"

        sys.setprofile(count)
        try:
            self.playout.pull(now=self.now)
        finally:
            sys.setprofile(None)
        self.greatest = max(self.greatest, calls)


MOST_CALLS = 500
"""Functions called for a period: a tenth of what takes as long as the period."""


def test_a_robot_that_ends_after_packets_of_one_sample_costs_no_more_than_any() -> None:
    robot = FaultyRobot()
    for _ in range(100):
        for sample in range(BLOCK):
            robot.push(round(robot.now * RATE) + sample)
        robot.playout.pull(now=robot.now)
        robot.now += BLOCK / RATE
    for _ in range(50):
        robot.pull()
    assert robot.greatest < MOST_CALLS


def test_packets_of_one_sample_make_no_period_last_longer_than_itself() -> None:
    robot = FaultyRobot()
    for _ in range(200):
        # Packets a few at a time, as a period's own take no time to receive.
        robot.push(round(robot.now * RATE))
        robot.push(round(robot.now * RATE) + 2)
        robot.pull()
    assert robot.greatest < MOST_CALLS


def test_sound_for_a_future_that_never_comes_takes_no_more_memory() -> None:
    robot = FaultyRobot()
    robot.content = bytes(200)
    for _ in range(100):
        robot.push(round(robot.now * RATE))
        robot.pull()
    far = 1 << 30
    for _ in range(20):
        # The position jumps far ahead with these, and back with those that are late.
        for ahead in range(300):
            robot.push(far + ahead)
        far -= 400
        robot.pull()
        for _ in range(21):
            robot.push(round(robot.now * RATE))
        robot.pull()
    assert sys.getrefcount(robot.content) < 1000


def test_a_robot_that_changes_its_codec_in_the_stream_is_not_followed() -> None:
    robot = FaultyRobot()
    for number in range(10):
        kind = PayloadType.L16_STEREO if number % 2 else PayloadType.L16_MONO
        payload = Payload(kind, number * 48, bytes(192))
        robot.playout.push(Packet(number, 1, payload), now=number / 1000)
    robot.playout.pull(now=0.01)
    assert robot.playout.reception.stats.packets_broken == 5
