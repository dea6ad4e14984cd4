import math

import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.types import Prediction, Touch
from tactophone.signal.haptics.profiles import (
    ActuatorResponse,
    PaperProfile,
    open_profile,
    parse_levels,
)


def command(
    name: str, response: ActuatorResponse | None, roughness: float
) -> tuple[float, float]:
    touch = Touch.ROUGH if roughness >= 0.5 else Touch.SMOOTH
    # No classified window is smooth with a roughness of exactly 0.
    least = 0.0 if name == "perceptual" else 1e-9
    prediction = Prediction(
        (0.0, 1 - roughness, roughness), touch, max(roughness, least), -20.0, 0.0, 0.1
    )
    found = (open_profile(name, response) if response else open_profile(name)).command(
        prediction
    )
    return found.amplitude, found.frequency


@pytest.mark.parametrize(
    "name", ["paper", "perceptual", "erm", "lra", "piezo", "dualsense"]
)
def test_an_actuator_that_was_not_measured_changes_nothing(name: str) -> None:
    shares = (0.0, 0.5, 1.0)
    assert [command(name, ActuatorResponse(), share) for share in shares] == [
        command(name, None, share) for share in shares
    ]


def test_the_paper_s_profile_never_changes() -> None:
    assert open_profile(
        "paper", ActuatorResponse(lowest=100.0, resonance=150.0)
    ) == open_profile("paper")


def test_resonance_and_speeds_replace_typical_figures() -> None:
    measured = ActuatorResponse(resonance=160.0, slowest=50.0, fastest=180.0)
    assert command("lra", measured, 1.0) == (1.0, 160.0)
    assert command("piezo", measured, 0.0)[1] == pytest.approx(160.0)
    assert command("piezo", measured, 1.0) == (1.0, 80.0)
    assert command("erm", measured, 0.0)[1] == pytest.approx(50.0)
    assert command("erm", measured, 1.0) == (1.0, 180.0)


def test_perceptual_stays_in_the_band_and_compensates_the_response() -> None:
    measured = ActuatorResponse(
        lowest=80.0, highest=200.0, levels=((80.0, 0.0), (200.0, -6.0))
    )
    flat = ActuatorResponse(lowest=80.0, highest=200.0)
    assert [
        command("perceptual", measured, share)[1] for share in (0.0, 1.0)
    ] == pytest.approx([200.0, 80.0])
    louder = (
        command("perceptual", measured, 0.0)[0] / command("perceptual", flat, 0.0)[0]
    )
    assert 20 * math.log10(louder) == pytest.approx(6.0)


def test_dualsense_keeps_an_octave_in_a_narrow_band() -> None:
    measured = ActuatorResponse(lowest=80.0, highest=400.0)
    profile = open_profile("dualsense", measured)
    assert isinstance(profile, PaperProfile)
    assert (profile.smooth.frequency, profile.rough.frequency) == (160.0, 80.0)


@pytest.mark.parametrize(
    "text", ["40", "40:x", "80:0,40:-3", "40:nan", "-5:0", "40:1:2"]
)
def test_levels_of_another_form_are_refused_with_an_example(text: str) -> None:
    with pytest.raises(ConfigError, match="wanted frequencies in Hz"):
        parse_levels(text)


def test_a_band_upside_down_is_refused() -> None:
    with pytest.raises(ConfigError, match="no range"):
        ActuatorResponse(lowest=200.0, highest=100.0)
