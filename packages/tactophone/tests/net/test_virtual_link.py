"""Two ends joined in virtual time."""

from collections.abc import Iterator
from itertools import repeat

import numpy as np
import pytest

from benchmarks.virtual_link import VirtualLink, paired_sessions
from tactophone.core.types import AudioBlock
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.stream import DecodedAudio

CODEC = Codec("pcm16", channels=1, packet_size=240)


def test_sound_crosses_in_virtual_time() -> None:
    link = VirtualLink(*paired_sessions(CODEC))
    now, received = link.connect(3_600.0), 0
    for start in range(0, 48_000, 240):
        link.robot.push(AudioBlock(np.zeros((240, 1), np.float32), 48_000, start))
        received += sum(
            isinstance(event, DecodedAudio)
            for event in link.carry(now + start / 48_000)
        )
    assert received == 200


def test_a_dead_link_raises() -> None:
    lost: Iterator[bool] = repeat(True)
    link = VirtualLink(
        *paired_sessions(CODEC), to_operator=ImpairedLink(NetworkProfile(), lost=lost)
    )
    with pytest.raises(TimeoutError, match="no session"):
        link.connect(0.0)
