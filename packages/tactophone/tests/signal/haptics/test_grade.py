import numpy as np
import pytest

from tactophone.core.types import HapticCommand, Prediction, Touch
from tactophone.signal.haptics.profiles import PaperProfile, open_profile
from tactophone.signal.haptics.psychophysics import LEVEL_JND_DB, sensation_db

GRADED = ("graded", "erm", "lra", "piezo", "dualsense")


def heard(
    logit: float, touch: Touch, *, at: float = 0.0, roughness: float = 0.3
) -> Prediction:
    rough = float(1 / (1 + np.exp(-logit)))
    return Prediction(
        (0.0, 1 - rough, rough),
        touch,
        roughness,
        level_dbfs=-20.0,
        start=at,
        end=at + 0.032,
    )


def strength(command: HapticCommand) -> float:
    return sensation_db(command.amplitude, command.frequency) / LEVEL_JND_DB


@pytest.mark.parametrize("name", GRADED)
def test_of_two_smooth_touches_the_rougher_one_is_drawn_stronger_by_a_difference(
    name: str,
) -> None:
    faint, strong = (
        open_profile(name).command(heard(logit, Touch.SMOOTH)) for logit in (-2.5, -1.0)
    )
    assert strength(strong) - strength(faint) > 1


@pytest.mark.parametrize("name", GRADED)
def test_a_false_bump_is_no_stronger_than_any_rough(name: str) -> None:
    bump = open_profile(name).command(heard(3.0, Touch.SMOOTH))
    rough = open_profile(name).command(heard(-3.0, Touch.ROUGH))
    assert strength(rough) > strength(bump)


def test_what_is_drawn_follows_slowly_and_begins_at_once() -> None:
    profile = open_profile("graded")
    first = profile.command(heard(-4.0, Touch.SMOOTH))
    assert strength(first) == pytest.approx(
        strength(open_profile("graded").command(heard(-4.0, Touch.SMOOTH)))
    )
    later = [
        profile.command(heard(-1.0, Touch.SMOOTH, at=step / 100))
        for step in range(1, 200)
    ]
    levels = [strength(each) for each in later]
    assert levels == sorted(levels)
    assert levels[5] - levels[0] < levels[100] - levels[0]


def test_another_touch_begins_anew() -> None:
    profile = open_profile("graded")
    for step in range(100):
        profile.command(heard(-4.0, Touch.SMOOTH, at=step / 100))
    fresh = open_profile("graded").command(heard(-1.0, Touch.SMOOTH))
    assert strength(
        profile.command(heard(-1.0, Touch.SMOOTH, at=2.0))
    ) == pytest.approx(strength(fresh))


def test_until_a_window_is_classified_a_touch_is_the_papers_smooth() -> None:
    onset = heard(4.0, Touch.SMOOTH, roughness=0.0)
    drawn, printed = (
        open_profile("graded").command(onset),
        PaperProfile().command(onset),
    )
    assert (drawn.amplitude, drawn.frequency) == pytest.approx(
        (printed.amplitude, printed.frequency)
    )
