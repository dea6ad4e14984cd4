import numpy as np
import pytest

from tactophone.core.types import AudioBlock, HapticCommand, PipelineStep
from tactophone.signal.pipeline import Pipeline, open_pipeline
from tactophone_lab.measurement.delays import (
    MAX_DECISION_DELAY,
    DecisionDelays,
    measure_decisions,
)


class Constant(Pipeline):
    """A pipeline that always returns the same command."""

    def __init__(self, amplitude: float) -> None:
        self._command = HapticCommand(amplitude, 60.0, 0.0)

    def push(self, block: AudioBlock) -> PipelineStep:
        return PipelineStep(block, (), (self._command,))


@pytest.fixture(scope="module")
def delays() -> DecisionDelays:
    return measure_decisions(open_pipeline(sample_rate=48_000, channels=2), passes=8)


@pytest.mark.slow
def test_a_touch_is_rendered_long_before_a_window_is_full(
    delays: DecisionDelays,
) -> None:
    assert (len(delays.touch), delays.missed_touches) == (2, 0)
    assert np.median(delays.touch) < 0.01


def test_edges_are_detected_later_than_touches_and_never_early(
    delays: DecisionDelays,
) -> None:
    assert len(delays.edge) + delays.missed_edges == 8
    assert all(
        np.median(delays.touch) < delay < MAX_DECISION_DELAY for delay in delays.edge
    )


@pytest.mark.slow
def test_a_constant_pipeline_misses_touches_or_edges() -> None:
    assert measure_decisions(Constant(0.0), passes=4).missed_touches == 1
    always = measure_decisions(Constant(0.5), passes=4)
    assert (always.missed_edges, len(always.edge)) == (2, 2)
