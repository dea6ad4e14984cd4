"""Measurements of the running system: impulse latency, time to silence after a failure, decision delay."""

from tactophone.measurement.decision_delay import MAX_DECISION_DELAY, DecisionDelays, measure_decisions
from tactophone.measurement.failsafe_timing import EndlessStroke, PeakRecorder, measure_time_to_silence, recording
from tactophone.measurement.impulse_latency import ImpulseLatency
from tactophone.measurement.latency import Graph, Sides, measure, running_sides

__all__ = [
    "MAX_DECISION_DELAY",
    "DecisionDelays",
    "EndlessStroke",
    "Graph",
    "ImpulseLatency",
    "PeakRecorder",
    "Sides",
    "measure",
    "measure_decisions",
    "measure_time_to_silence",
    "recording",
    "running_sides",
]
