"""What may be watched: recent sound, ticks, counters and state; nothing ever waits for a watcher.

The running process writes into one piece of shared memory (`Telemetry`); any number of others look (`Watcher`) or
ask for something (`Watcher.ask`). The writer never takes a lock and never learns who watches, so a stalled page
costs the sound nothing. What is asked for lies in a mailbox that the runtime empties and judges: a request is a
wish, and the runtime owns the truth.
"""

from tactophone.telemetry.memory import TICK
from tactophone.telemetry.registry import COUNTERS, GAUGES, MARKS, STAGES, Action, Fault, Request, State
from tactophone.telemetry.watcher import Pulse, Snapshot, Watcher, running
from tactophone.telemetry.writer import Telemetry

__all__ = [
    "COUNTERS",
    "GAUGES",
    "MARKS",
    "STAGES",
    "TICK",
    "Action",
    "Fault",
    "Pulse",
    "Request",
    "Snapshot",
    "State",
    "Telemetry",
    "Watcher",
    "running",
]
