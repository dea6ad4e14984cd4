import numpy as np
import pytest

from tactophone.benchmark.stone_task import felt_through, play_task, ways_to_feel
from tactophone.errors import ConfigError
from tactophone.haptics import PASSTHROUGH
from tests.sounds import noise


def test_an_operator_plays_rounds_and_the_outcome_has_intervals() -> None:
    (outcome,) = play_task(["direct"], rounds=50, visits=1)
    assert outcome.name == "direct"
    assert 0 <= outcome.success <= 1
    assert outcome.median_duration > 5
    assert "(" in outcome.both


def test_there_are_models_and_renderers_to_feel_through() -> None:
    assert {"paper", *PASSTHROUGH} <= set(ways_to_feel())
    with pytest.raises(ConfigError, match="cannot feel through guesswork"):
        play_task(["guesswork"])


@pytest.mark.parametrize("name", ["paper", "paper:perceptual", "pitch"])
def test_what_is_felt_is_as_long_as_the_sound_and_within_full_drive(name: str) -> None:
    wave = felt_through(name)(noise(duration=0.6))
    assert wave.shape == (28_800,)
    assert 0 < np.abs(wave).max() <= 1
