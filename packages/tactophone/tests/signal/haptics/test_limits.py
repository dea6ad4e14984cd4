import math
from dataclasses import dataclass

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.core.types import HapticCommand, Prediction, Touch
from tactophone.signal.haptics.limits import Limits, peak_amplitude


@given(st.floats(), st.floats(), st.floats(0, 1))
def test_no_command_exceeds_the_bounds(
    amplitude: float, frequency: float, ceiling: float
) -> None:
    bounded = Limits(ceiling=ceiling).bound(
        HapticCommand(amplitude, frequency, time=0.0)
    )
    assert 0 <= bounded.amplitude <= ceiling
    assert 35 <= bounded.frequency <= 1000


@pytest.mark.parametrize("garbage", [math.nan, math.inf, -math.inf])
def test_garbage_is_silence(garbage: float) -> None:
    assert Limits().bound(HapticCommand(garbage, 60.0, time=0.0)).amplitude == 0
    assert Limits().bound(HapticCommand(1.0, garbage, time=0.0)).amplitude == 0


def test_an_allowed_command_is_unchanged() -> None:
    command = HapticCommand(0.7, 60.0, time=3.0)
    assert Limits(ceiling=1.0).bound(command) == command


@pytest.mark.parametrize(
    "wrong",
    [
        {"ceiling": 1.1},
        {"ceiling": math.nan},
        {"lowest": 0},
        {"lowest": 90.0, "highest": 80.0},
    ],
)
def test_invalid_limits_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="wanted"):
        Limits(**wrong)


def test_the_ends_of_each_range_are_allowed() -> None:
    limits = Limits(ceiling=1.0, lowest=0.5, highest=0.5)
    for allowed in (HapticCommand(0.0, 0.5, 3.0), HapticCommand(1.0, 0.5, 3.0)):
        assert limits.bound(allowed) is allowed


@pytest.mark.parametrize("frequency", [35.0, 1000.0])
@pytest.mark.parametrize("amplitude", [0.0, 0.25, 0.5])
def test_a_command_on_a_bound_is_passed_on_as_it_is(
    amplitude: float, frequency: float
) -> None:
    command = HapticCommand(amplitude, frequency, time=1.0)
    assert Limits(ceiling=0.5).bound(command) is command


def test_what_exceeds_a_bound_is_moved_to_it() -> None:
    assert Limits(ceiling=0.5).bound(HapticCommand(-0.1, 10.0, 2.0)) == HapticCommand(
        0.0, 35.0, 2.0
    )
    assert Limits(ceiling=0.5).bound(HapticCommand(0.6, 2000.0, 2.0)) == HapticCommand(
        0.5, 1000.0, 2.0
    )


def test_the_machines_ceiling_is_the_first_one_unless_it_is_higher() -> None:
    assert Limits(ceiling=0.3).machine == 0.3
    assert Limits(ceiling=0.3, machine=0.6).machine == 0.6
    assert Limits(ceiling=0.3, machine=0.1).machine == 0.3
    assert "machine" not in repr(Limits())


def test_no_limit_is_infinite() -> None:
    with pytest.raises(ValueError, match="wanted"):
        Limits(highest=math.inf)


@dataclass(frozen=True)
class Ramp:
    """Asks for an amplitude between two, by roughness."""

    name: str = "ramp"
    smooth: float = 0.0
    rough: float = 0.0

    def command(self, prediction: Prediction) -> HapticCommand:
        smooth, rough = (
            prediction.probabilities[Touch.SMOOTH],
            prediction.probabilities[Touch.ROUGH],
        )
        assert smooth + rough == pytest.approx(1.0)
        assert 0 <= prediction.roughness <= 1
        assert prediction.probabilities[Touch.NONE] == 0
        return HapticCommand(
            smooth * self.smooth + prediction.roughness * self.rough, 60.0, 0.0
        )


def test_a_profiles_peak_is_found_at_either_end_and_is_full_drive_at_most() -> None:
    assert peak_amplitude(Ramp(rough=0.3)) == pytest.approx(0.3)
    assert peak_amplitude(Ramp(smooth=0.4)) == pytest.approx(0.4)
    assert peak_amplitude(Ramp(smooth=0.2, rough=7.0)) == 1.0
    assert peak_amplitude(Ramp()) == 0.0
    assert peak_amplitude(Ramp(smooth=-0.5, rough=-0.5)) == pytest.approx(-0.5)
    assert peak_amplitude(Ramp(rough=math.nan)) == 0.0


def test_a_profile_without_amplitude_is_left_as_it_is() -> None:
    assert Limits(ceiling=0.5).scale_for(0.0) == 1.0
    assert Limits(ceiling=0.5).scale_for(-1.0) == 1.0
    assert Limits(ceiling=0.5).scale_for(0.5) == 1.0
