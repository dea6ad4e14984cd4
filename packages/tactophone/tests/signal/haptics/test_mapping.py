import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.types import Prediction, Touch
from tactophone.signal.haptics.profiles import PROFILES, PaperProfile, open_profile


def prediction(touch: Touch, roughness: float) -> Prediction:
    return Prediction(
        (0.0, 1 - roughness, roughness),
        touch,
        roughness,
        level_dbfs=-20.0,
        start=1.0,
        end=1.256,
    )


@pytest.mark.parametrize(
    ("touch", "roughness", "amplitude", "frequency"),
    [
        (Touch.ROUGH, 1.0, 1.0, 60.0),
        (Touch.SMOOTH, 0.0, 10 ** (-25 / 20), 120.0),
        (Touch.NONE, 1.0, 0.0, 60.0),
    ],
)
def test_the_papers_three_stimuli(
    touch: Touch, roughness: float, amplitude: float, frequency: float
) -> None:
    command = PaperProfile().command(prediction(touch, roughness))
    assert command.amplitude == pytest.approx(amplitude)
    assert command.frequency == pytest.approx(frequency)
    assert command.time == 1.256


def test_confidence_moves_level_and_frequency_without_turning_back() -> None:
    commands = [
        PaperProfile().command(prediction(Touch.ROUGH, step / 100))
        for step in range(101)
    ]
    assert sorted(commands, key=lambda command: command.amplitude) == commands
    assert sorted(commands, key=lambda command: -command.frequency) == commands


@pytest.mark.parametrize("name", PROFILES)
def test_a_profile_is_opened_by_the_name_it_has(name: str) -> None:
    assert open_profile(name).name == name


def test_an_unknown_profile_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean paper"):
        open_profile("papr")
