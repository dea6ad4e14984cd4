"""The control of the playout, with packets that have times but no sound."""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest

from tactophone.net.link.playout import PLAYOUT_WARM_UP, PlayoutController

RATE = 48_000
PACKET = 240
BLOCK = 128


@dataclass
class Simulation:
    """Simulates minutes in a second: delays (s) against the sender's true time, number
    of late packets and of jumps."""

    skew_ppm: float = 0.0
    jitter: float = 0.002
    duration: float = 120.0
    loss: float = 0.0
    longer_path: float = 0.0

    def __post_init__(self) -> None:
        random, speed = np.random.default_rng(0), RATE * (1 + self.skew_ppm * 1e-6)
        sent = (np.arange(int(self.duration * speed / PACKET)) + 1) * PACKET / speed
        came = sent + 0.001 + random.exponential(self.jitter, len(sent))
        came[sent > self.duration / 2] += self.longer_path
        order = np.argsort(came, kind="stable")
        order = order[random.random(len(sent))[order] >= self.loss]
        self.packets = deque(
            zip(came[order].tolist(), (order * PACKET).tolist(), strict=True)
        )
        self.controller = PlayoutController(block_size=BLOCK)
        self.late = 0
        self.jumps = 0
        self.delays = np.array(
            [
                self._play(block * BLOCK / RATE)
                for block in range(int(self.duration * RATE / BLOCK))
            ]
        )

    def _play(self, now: float) -> float:
        while self.packets and self.packets[0][0] <= now:
            came, start = self.packets.popleft()
            self.late += start < self.controller.position
            self.controller.push(start, PACKET, now=came)
        self.jumps += self.controller.step(BLOCK, now=now).jumped
        return now - self.controller.position / (RATE * (1 + self.skew_ppm * 1e-6))


@pytest.mark.parametrize("skew_ppm", [200, -200, 0])
def test_two_clocks_are_reconciled_and_the_delay_stays(skew_ppm: float) -> None:
    run = Simulation(skew_ppm)
    settled = run.delays[len(run.delays) // 2 :]
    assert np.ptp(settled) < 0.002
    assert 1e6 * run.controller._integral == pytest.approx(skew_ppm, abs=15)
    assert run.late < 0.001 * 24_000
    assert run.jumps == 1


def test_loss_changes_nothing() -> None:
    clean, lossy = Simulation(duration=60), Simulation(duration=60, loss=0.05)
    assert lossy.delays[-1] == pytest.approx(clean.delays[-1], abs=0.003)


@pytest.mark.parametrize("jitter", [0.0005, 0.002, 0.005])
def test_the_margin_follows_the_jitter(jitter: float) -> None:
    run = Simulation(jitter=jitter, duration=60)
    packet_and_block = (PACKET + BLOCK) / RATE
    assert run.late < 0.003 * 12_000
    # All but 1 in 1000 of an exponential lie below 6.9 times its mean.
    assert run.controller.margin - packet_and_block == pytest.approx(
        6.9 * jitter, rel=0.45, abs=0.002
    )


def test_a_longer_path_is_followed_within_a_moment() -> None:
    run = Simulation(longer_path=0.1, jitter=0.001)
    assert run.late < 100
    assert run.jumps <= 4
    assert np.ptp(run.delays[-2_000:]) < 0.002


def test_nothing_is_played_during_the_warm_up() -> None:
    controller = PlayoutController(block_size=BLOCK)
    assert np.isnan(controller.position)
    controller.step(BLOCK, now=0.0)
    controller.push(0, PACKET, now=0.01)
    controller.step(BLOCK, now=0.02)
    assert np.isnan(controller.position)
    assert controller.step(BLOCK, now=0.02 + PLAYOUT_WARM_UP).jumped


def test_speed_stays_below_the_noticeable_difference() -> None:
    run, speeds = PlayoutController(block_size=BLOCK), []
    random = np.random.default_rng(1)
    for block in range(20_000):
        now = block * BLOCK / RATE
        run.push(
            block * BLOCK,
            BLOCK,
            now=now + float(random.exponential(0.004 if block > 10_000 else 0.0005)),
        )
        speeds.append(run.step(BLOCK, now=now).speed)
    assert max(abs(speed - 1) for speed in speeds) < 0.021
    assert all(abs(speed - following) < 0.021 for speed, following in pairwise(speeds))
