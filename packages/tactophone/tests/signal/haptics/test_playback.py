import numpy as np
import pytest

from tactophone.core.types import FloatArray, HapticCommand
from tactophone.signal.haptics.oscillator import Oscillator, Playback
from tests.sounds import ODD_SIZES

COMMANDS = [
    HapticCommand(amplitude, 60.0 + 5 * n, 0.0107 * n)
    for n, amplitude in enumerate([1, 0.3, 0, 0.7] * 10)
]


def played(size: int) -> FloatArray:
    playback = Playback(Oscillator())
    waves = []
    waiting = list(COMMANDS)
    for end in range(size, 24_000 + size, size):
        due = [command for command in waiting if command.time * 48_000 <= end]
        waiting = waiting[len(due) :]
        waves.append(playback.push(due, until=end / 48_000))
    return np.concatenate(waves)[:24_000]


@pytest.mark.slow
@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_portions_give_the_same_bits(size: int) -> None:
    np.testing.assert_array_equal(played(size), played(24_000))


def test_a_command_takes_effect_at_its_own_sample() -> None:
    wave = Playback(Oscillator()).push([HapticCommand(1.0, 60.0, time=0.1)], until=0.2)
    assert len(wave) == 9600
    assert np.flatnonzero(wave)[0] == 4800


def test_a_command_that_comes_late_takes_effect_at_once() -> None:
    playback = Playback(Oscillator())
    playback.push([], until=0.1)
    assert playback.push([HapticCommand(1.0, 60.0, time=0.05)], until=0.2)[0] != 0
