import math

import pytest

from tactophone.live.runtime.output_gate import (
    EMERGENCY_STOP,
    MUTED,
    RESTARTED,
    OutputGate,
)
from tactophone.live.telemetry.layout import Request
from tactophone.signal.haptics.limits import Limits


def test_a_page_lowers_the_ceiling_and_never_raises_it_over_the_machines_own() -> None:
    gate = OutputGate(Limits(ceiling=0.5))
    assert gate.apply([Request("ceiling", 0.2)]) == []
    assert gate.limits.ceiling == 0.2
    assert gate.apply([Request("ceiling", 0.5)]) == []
    assert gate.apply([Request("ceiling", 0.51)]) == ["ceiling"]
    assert (gate.limits.ceiling, gate.local_ceiling) == (0.5, 0.5)


def test_who_may_only_weaken_undoes_no_lowering() -> None:
    gate = OutputGate(Limits(ceiling=0.5))
    gate.apply([Request("ceiling", 0.1), Request("output_level", 0.2)])
    higher = [Request("lower_ceiling", 0.5), Request("lower_output_level", 1.0)]
    assert gate.apply(higher) == []
    assert (gate.limits.ceiling, gate.output_level) == (0.1, 0.2)
    gate.apply([Request("lower_ceiling", 0.05), Request("lower_output_level", 0.1)])
    assert (gate.limits.ceiling, gate.output_level) == (0.05, 0.1)
    broken = [Request("lower_ceiling", math.nan), Request("lower_output_level", -0.1)]
    assert gate.apply(broken) == ["lower_ceiling", "lower_output_level"]


@pytest.mark.parametrize("value", [math.nan, math.inf, -0.1, 1.1])
@pytest.mark.parametrize("action", ["ceiling", "output_level"])
def test_values_outside_0_to_1_are_refused(action: str, value: float) -> None:
    gate = OutputGate(Limits(ceiling=1.0))
    assert gate.apply([Request(action, value)]) == [action]
    assert (gate.limits.ceiling, gate.output_level) == (1.0, 1.0)


def test_an_emergency_stop_latches_until_armed() -> None:
    gate = OutputGate(Limits(ceiling=1.0))
    gate.stop()
    assert (gate.armed, gate.muted_because, gate.bound(1.0)) == (
        False,
        EMERGENCY_STOP,
        0.0,
    )
    gate.apply([Request("mute"), Request("output_level", 1.0), Request("ceiling", 1.0)])
    assert gate.muted_because == EMERGENCY_STOP
    assert gate.apply([Request("arm")]) == []
    assert gate.bound(1.0) == 1.0


@pytest.mark.parametrize("action", ["stop", "mute"])
def test_stopping_wins_over_arming_in_the_same_moment(action: str) -> None:
    gate = OutputGate(Limits(ceiling=1.0), muted_because=RESTARTED)
    gate.apply([Request(action, time=1.0), Request("arm", time=2.0)])
    assert not gate.armed


def test_a_stop_by_signal_wins_over_an_arming_that_waited() -> None:
    gate = OutputGate(Limits(ceiling=1.0), muted_because=RESTARTED)
    gate.stop()
    assert gate.apply([Request("arm")]) == ["arm"]
    assert gate.muted_because == EMERGENCY_STOP
    assert gate.apply([Request("arm")]) == []
    assert gate.armed


def test_a_stop_by_signal_wins_over_an_arming_that_is_being_granted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    gate = OutputGate(Limits(ceiling=1.0), muted_because=RESTARTED)
    grant = gate._grant

    def interrupted(request: Request) -> bool:
        gate.stop()
        return grant(request)

    monkeypatch.setattr(gate, "_grant", interrupted)
    gate.apply([Request("arm")])
    assert gate.muted_because == EMERGENCY_STOP


def test_nothing_but_arming_ends_a_restarts_mute() -> None:
    gate = OutputGate(Limits(ceiling=1.0), muted_because=RESTARTED)
    gate.apply([Request("ceiling", 0.9), Request("output_level", 0.9)])
    assert gate.muted_because == RESTARTED
    gate.apply([Request("mute")])
    assert gate.muted_because == RESTARTED
    gate.apply([Request("arm"), Request("arm")])
    assert gate.armed
    gate.apply([Request("mute")])
    assert gate.muted_because == MUTED


@pytest.mark.parametrize("amplitude", [math.nan, math.inf, -math.inf, -1.0])
def test_an_invalid_amplitude_is_zero(amplitude: float) -> None:
    assert OutputGate(Limits(ceiling=1.0)).bound(amplitude) == 0.0


def test_the_level_scales_and_the_ceiling_cuts() -> None:
    gate = OutputGate(Limits(ceiling=0.3), output_level=0.5)
    assert gate.bound(0.4) == 0.2
    assert gate.bound(1.0) == 0.3


def test_an_unknown_request_is_refused() -> None:
    assert OutputGate(Limits(ceiling=1.0)).apply(
        [Request("profile", text="paper")]
    ) == ["profile"]


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_ceiling_and_level_may_be_set_to_the_ends_of_their_range(value: float) -> None:
    gate = OutputGate(Limits(ceiling=1.0))
    assert gate.apply([Request("ceiling", value), Request("output_level", value)]) == []
    assert (gate.limits.ceiling, gate.output_level) == (value, value)


def test_stops_are_counted_once_until_armed() -> None:
    gate = OutputGate(Limits(ceiling=1.0))
    assert gate.stops == 0
    gate.stop()
    assert gate.stops == 1
    gate.stop()
    assert gate.stops == 1
    gate.apply([])
    gate.apply([Request("arm")])
    gate.apply([Request("mute")])
    assert gate.stops == 1
    gate.apply([Request("stop"), Request("stop")])
    assert gate.stops == 2


@pytest.mark.parametrize("action", ["stop", "mute"])
def test_muting_takes_back_a_buzz_and_none_is_granted_until_armed(action: str) -> None:
    gate = OutputGate(Limits(ceiling=1.0))
    assert gate.apply([Request("buzz", time=5.0)]) == []
    assert gate.buzz_asked == 5.0
    gate.apply([Request(action)])
    assert gate.buzz_asked == 0.0
    assert gate.apply([Request("buzz", time=6.0)]) == ["buzz"]
    gate.apply([Request("arm")])
    assert gate.buzz_asked == 0.0
    assert gate.apply([Request("buzz", time=7.0)]) == []
