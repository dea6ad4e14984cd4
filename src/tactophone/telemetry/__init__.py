"""Telemetry of a run: recent sound, pipeline steps, predictions, counters and state, and the log of predictions.

The running process writes into one block of shared memory (`Telemetry`); any number of other processes read it
(`Watcher`) or send requests (`Watcher.ask`). The writer takes no lock and does not know its readers, so a stalled page
cannot delay the sound. Requests lie in a mailbox that the runtime empties; the runtime decides what is granted.
"""

from tactophone.telemetry.follower import PredictionLog, RunFollower
from tactophone.telemetry.layout import (
    COUNTERS,
    GAUGES,
    LARGEST_RECORD,
    MARK,
    MARKS,
    PREDICTION,
    STAGES,
    STEP,
    STEP_FIELDS,
    Action,
    Fault,
    FingerState,
    Request,
    State,
)
from tactophone.telemetry.memory import is_alive, remove_leftovers, remove_memory
from tactophone.telemetry.records import (
    ARRIVAL_DIGITS,
    Controls,
    EventBatch,
    Record,
    RunStart,
    TimelineWriter,
    read_records,
    read_timeline,
    write_record,
)
from tactophone.telemetry.watcher import Pulse, Snapshot, Watcher, running
from tactophone.telemetry.writer import Telemetry

__all__ = [
    "ARRIVAL_DIGITS",
    "COUNTERS",
    "GAUGES",
    "LARGEST_RECORD",
    "MARK",
    "MARKS",
    "PREDICTION",
    "STAGES",
    "STEP",
    "STEP_FIELDS",
    "Action",
    "Controls",
    "EventBatch",
    "Fault",
    "FingerState",
    "PredictionLog",
    "Pulse",
    "Record",
    "Request",
    "RunFollower",
    "RunStart",
    "Snapshot",
    "State",
    "Telemetry",
    "TimelineWriter",
    "Watcher",
    "is_alive",
    "read_records",
    "read_timeline",
    "remove_leftovers",
    "remove_memory",
    "running",
    "write_record",
]
