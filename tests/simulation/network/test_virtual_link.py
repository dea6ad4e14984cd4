"""Two ends joined in virtual time."""

from collections.abc import Iterator
from itertools import repeat

import numpy as np
import pytest

from tactophone.link import Codec, DecodedAudio
from tactophone.simulation.network.impairments import ImpairedLine, NetworkProfile
from tactophone.simulation.network.virtual_link import VirtualLine, paired_ends
from tactophone.types import AudioBlock

CODEC = Codec("pcm16", channels=1, packet_size=240)


def test_sound_crosses_hours_in_no_time() -> None:
    line = VirtualLine(*paired_ends(CODEC))
    now, heard = line.connect(3_600.0), 0
    for start in range(0, 48_000, 240):
        line.robot.push(AudioBlock(np.zeros((240, 1), np.float32), 48_000, start))
        heard += sum(isinstance(one, DecodedAudio) for one in line.carry(now + start / 48_000))
    assert heard == 200


def test_a_dead_line_is_told() -> None:
    lost: Iterator[bool] = repeat(True)
    line = VirtualLine(*paired_ends(CODEC), there=ImpairedLine(NetworkProfile(), lost=lost))
    with pytest.raises(TimeoutError, match="no session"):
        line.connect(0.0)
