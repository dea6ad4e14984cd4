"""A path that does everything wrong at once."""

import random

from benchmarks.virtual_link import VirtualLink, paired_sessions
from tactophone.net.endpoints import OperatorEndpoint, RobotEndpoint
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.signal.pipeline import open_pipeline
from tests.sounds import blocks, noise

RATE = 48_000
PACKET = 240

EVERYTHING = NetworkProfile(loss=0.3, duplicates=0.1, spread=0.12, overtaking=True)

CORRUPT = 0.05
"""Share of the datagrams in which a bit is changed."""


class CorruptingLink(ImpairedLink):
    """Changes a bit in some datagrams."""

    def __init__(self, profile: NetworkProfile, *, seed: int = 0) -> None:
        super().__init__(profile, seed=seed)
        self._dice = random.Random(seed)

    def pull(self, now: float) -> list[bytes]:
        return [self._carried(datagram) for datagram in super().pull(now)]

    def _carried(self, datagram: bytes) -> bytes:
        if self._dice.random() >= CORRUPT:
            return datagram
        changed = bytearray(datagram)
        changed[self._dice.randrange(len(changed))] ^= 1 << self._dice.randrange(8)
        return bytes(changed)


def test_an_untouched_fingertip_stays_silent() -> None:
    robot, operator = paired_sessions(Codec("opus", packet_size=PACKET))
    sender = RobotEndpoint(robot)
    pipeline = open_pipeline("", sample_rate=RATE, channels=2)
    link = VirtualLink(robot, OperatorEndpoint(operator, pipeline))
    begun = link.connect(0.0)
    link.to_operator = CorruptingLink(EVERYTHING, seed=1)
    link.to_robot = CorruptingLink(EVERYTHING, seed=2)
    commands = []
    for block in blocks(noise(level_dbfs=-60, duration=8.0), PACKET):
        sender.push(block)
        for _, step in link.carry(begun + block.end / RATE):
            commands += step.commands if step else ()
    assert operator.counters["packets_rejected"] > 50
    assert operator.counters["packets_concealed"] > 100
    assert len(commands) > 100
    assert not any(command.amplitude for command in commands)
