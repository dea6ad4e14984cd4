"""Measurements of the running system: impulse latency, time to silence after a failure, decision delay."""

from tactophone.measurement.delays import MAX_DECISION_DELAY, DecisionDelays, measure_decisions
from tactophone.measurement.failsafe import (
    ENDLESS_TONE,
    EndlessStroke,
    PeakRecorder,
    freeze_operator,
    freeze_robot,
    kill_operator,
    kill_robot,
    measure_time_to_silence,
    recording,
)
from tactophone.measurement.impulses import Graph, ImpulseLatency, Sides, measure, running_sides

__all__ = [
    "ENDLESS_TONE",
    "MAX_DECISION_DELAY",
    "DecisionDelays",
    "EndlessStroke",
    "Graph",
    "ImpulseLatency",
    "PeakRecorder",
    "Sides",
    "freeze_operator",
    "freeze_robot",
    "kill_operator",
    "kill_robot",
    "measure",
    "measure_decisions",
    "measure_time_to_silence",
    "recording",
    "running_sides",
]
