import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.core.types import HapticCommand
from tactophone.signal.haptics.limits import Limits


@given(st.floats(), st.floats(), st.floats(0, 1))
def test_no_command_exceeds_the_bounds(amplitude: float, frequency: float, ceiling: float) -> None:
    bounded = Limits(ceiling=ceiling).bound(HapticCommand(amplitude, frequency, time=0.0))
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
    [{"ceiling": 1.1}, {"ceiling": math.nan}, {"lowest": 0}, {"lowest": 90.0, "highest": 80.0}],
)
def test_invalid_limits_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="wanted"):
        Limits(**wrong)
