import numpy as np
import pytest

from tactophone.core.types import Prediction, Touch
from tactophone.signal.haptics.profiles import (
    PROFILES,
    PaperProfile,
    PerceptualProfile,
    discriminable_steps,
    open_profile,
)
from tactophone.signal.haptics.psychophysics import (
    LEVEL_JND_DB,
    PITCH_JND,
    sensation_db,
)

NAMES = ("perceptual", "erm", "lra", "piezo", "dualsense")


def prediction(touch: Touch, roughness: float) -> Prediction:
    return Prediction(
        (0.0, 1 - roughness, roughness),
        touch,
        roughness,
        level_dbfs=-20.0,
        start=1.0,
        end=1.032,
    )


@pytest.mark.parametrize("name", NAMES)
def test_rough_is_stronger_than_smooth_and_no_contact_is_silent(name: str) -> None:
    profile = open_profile(name)
    commands = [
        open_profile(name).command(prediction(Touch.ROUGH, step / 50))
        for step in range(51)
    ]
    levels = [
        sensation_db(command.amplitude, command.frequency) for command in commands
    ]
    assert levels == sorted(levels)
    assert levels[0] > 0
    assert max(command.amplitude for command in commands) <= 1
    assert profile.command(prediction(Touch.NONE, 1.0)).amplitude == 0


def test_perceptual_steps_are_even_in_frequency_and_level() -> None:
    commands = [
        PerceptualProfile().command(prediction(Touch.ROUGH, step / 10))
        for step in range(11)
    ]
    pitch = np.diff(np.log([command.frequency for command in commands]))
    level = np.diff(
        [sensation_db(command.amplitude, command.frequency) for command in commands]
    )
    assert pitch == pytest.approx(np.full(10, pitch[0]))
    assert level == pytest.approx(np.full(10, level[0]), abs=0.1)


def test_the_steps_of_each_profile_that_a_finger_discriminates() -> None:
    steps = {name: discriminable_steps(open_profile(name)) for name in PROFILES}
    # Just-noticeable steps of 18 %: 60 to 120 Hz span about 4 steps of frequency, 40 to
    # 250 Hz about 11.
    assert steps["paper"][0] == pytest.approx(4.2, abs=0.1)
    assert steps["perceptual"][0] == pytest.approx(11.1, abs=0.1)
    assert steps["lra"][0] == 0
    assert steps["lra"][1] == pytest.approx(25 / LEVEL_JND_DB, abs=0.1)
    assert steps["perceptual"][1] > steps["paper"][1]


def test_a_jnd_is_a_step() -> None:
    class OneStep(PaperProfile):
        def command(self, prediction: Prediction):  # type: ignore[no-untyped-def]
            frequency = 250.0 * (1 + PITCH_JND) ** -prediction.roughness
            return super().command(prediction).__class__(1.0, frequency, 0.0)

    assert discriminable_steps(OneStep())[0] == pytest.approx(1.0)


def test_an_erms_speed_is_its_strength() -> None:
    faint, strong = (
        open_profile("erm").command(prediction(Touch.ROUGH, share))
        for share in (0.2, 0.9)
    )
    assert strong.frequency > faint.frequency
    assert strong.amplitude / faint.amplitude == pytest.approx(
        (strong.frequency / faint.frequency) ** 2
    )
