import numpy as np
import pytest

from paper_tables import play_task, task_methods, vibration_of
from tactophone.core.errors import ConfigError
from tactophone.signal.haptics.passthrough import passthrough_names
from tests.sounds import noise


@pytest.mark.long
def test_an_operator_plays_rounds_and_the_outcome_has_intervals() -> None:
    (outcome,) = play_task(["direct"], rounds=50, visits=1)
    assert outcome.name == "direct"
    assert 0 <= outcome.both.low <= outcome.both.value <= outcome.both.high <= 1
    assert outcome.duration.value > 5


def test_methods_are_shipped_models_and_renderers() -> None:
    assert {"paper", *passthrough_names()} <= set(task_methods())
    with pytest.raises(ConfigError, match="no method guesswork"):
        play_task(["guesswork"])


@pytest.mark.parametrize("name", ["paper", "paper:perceptual", "direct"])
def test_the_vibration_is_as_long_as_the_sound_and_within_full_drive(name: str) -> None:
    wave = vibration_of(name)(noise(duration=0.6))
    assert wave.shape == (28_800,)
    assert 0 < np.abs(wave).max() <= 1
