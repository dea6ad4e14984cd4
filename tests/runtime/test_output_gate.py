import math

import pytest

from tactophone.runtime.output_gate import EMERGENCY_STOP, MUTED, RESTARTED, OutputGate
from tactophone.telemetry import Request


def test_a_page_lowers_the_ceiling_and_never_raises_it_over_the_machines_own() -> None:
    guard = OutputGate(ceiling=0.5)
    assert guard.obey([Request("ceiling", 0.2)]) == []
    assert guard.ceiling == 0.2
    assert guard.obey([Request("ceiling", 0.5)]) == []
    assert guard.obey([Request("ceiling", 0.51)]) == ["ceiling"]
    assert (guard.ceiling, guard.local_ceiling) == (0.5, 0.5)


@pytest.mark.parametrize("value", [math.nan, math.inf, -0.1, 1.1])
@pytest.mark.parametrize("action", ["ceiling", "output_level"])
def test_what_is_no_share_is_refused(action: str, value: float) -> None:
    guard = OutputGate(ceiling=1.0)
    assert guard.obey([Request(action, value)]) == [action]
    assert (guard.ceiling, guard.output_level) == (1.0, 1.0)


def test_an_emergency_stop_latches_until_armed() -> None:
    guard = OutputGate(ceiling=1.0)
    guard.stop()
    assert (guard.armed, guard.muted_because, guard.amplitude(1.0)) == (False, EMERGENCY_STOP, 0.0)
    guard.obey([Request("mute"), Request("output_level", 1.0), Request("ceiling", 1.0)])
    assert guard.muted_because == EMERGENCY_STOP
    guard.obey([Request("arm")])
    assert guard.amplitude(1.0) == 1.0


@pytest.mark.parametrize("action", ["stop", "mute"])
def test_stopping_wins_over_arming_in_the_same_moment(action: str) -> None:
    guard = OutputGate(ceiling=1.0, muted_because=RESTARTED)
    guard.obey([Request(action, time=1.0), Request("arm", time=2.0)])
    assert not guard.armed


def test_nothing_but_arming_ends_a_restarts_mute() -> None:
    guard = OutputGate(ceiling=1.0, muted_because=RESTARTED)
    guard.obey([Request("ceiling", 0.9), Request("output_level", 0.9)])
    assert guard.muted_because == RESTARTED
    guard.obey([Request("mute")])
    assert guard.muted_because == RESTARTED
    guard.obey([Request("arm"), Request("arm")])
    assert guard.armed
    guard.obey([Request("mute")])
    assert guard.muted_because == MUTED


@pytest.mark.parametrize("wished", [math.nan, math.inf, -math.inf, -1.0])
def test_what_is_no_amplitude_is_none(wished: float) -> None:
    assert OutputGate(ceiling=1.0).amplitude(wished) == 0.0


def test_the_level_scales_and_the_ceiling_cuts() -> None:
    guard = OutputGate(ceiling=0.3, output_level=0.5)
    assert guard.amplitude(0.4) == 0.2
    assert guard.amplitude(1.0) == 0.3


def test_what_the_guard_does_not_know_it_refuses() -> None:
    assert OutputGate(ceiling=1.0).obey([Request("profile", text="paper")]) == ["profile"]
