import numpy as np
import pytest

from tactophone.endpoints import Pipeline, open_pipeline
from tactophone.measurement.decision_delay import LONGEST, Delays, measure_decisions
from tactophone.types import AudioBlock, HapticCommand, PipelineStep


class Deaf(Pipeline):
    """A walk that commands the same whatever it hears."""

    def __init__(self, amplitude: float) -> None:
        self._command = HapticCommand(amplitude, 60.0, 0.0)

    def push(self, block: AudioBlock) -> PipelineStep:
        return PipelineStep(block, (), (self._command,))


@pytest.fixture(scope="module")
def delays() -> Delays:
    return measure_decisions(open_pipeline(sample_rate=48_000, channels=2), passes=8)


def test_a_touch_is_felt_long_before_a_window_is_full(delays: Delays) -> None:
    assert (len(delays.touch), delays.missed_touches) == (2, 0)
    assert np.median(delays.touch) < 0.01


def test_edges_are_told_later_than_touches_and_never_before_they_are_reached(delays: Delays) -> None:
    assert len(delays.edge) + delays.missed_edges == 8
    assert all(np.median(delays.touch) < delay < LONGEST for delay in delays.edge)


def test_who_feels_nothing_misses_every_touch_and_who_always_feels_rough_every_edge_to_smooth() -> None:
    assert measure_decisions(Deaf(0.0), passes=4).missed_touches == 1
    always = measure_decisions(Deaf(0.5), passes=4)
    assert (always.missed_edges, len(always.edge)) == (2, 2)
