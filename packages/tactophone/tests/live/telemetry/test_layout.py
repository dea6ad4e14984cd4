import pytest

from tactophone.live.telemetry.layout import COUNTERS, GAUGES, STAGES, Fault, RunState


def test_every_stage_of_the_budget_has_its_gauge() -> None:
    assert all(f"latency_{stage}" in GAUGES for stage in STAGES)
    assert not set(COUNTERS) & set(GAUGES)


@pytest.mark.parametrize(
    "state",
    [
        RunState(),
        RunState(role="receive", profiles=("paper",), faults=(Fault("a", "b"),)),
    ],
)
def test_a_state_survives_the_memory(state: RunState) -> None:
    assert RunState.parse(bytes(state)) == state
