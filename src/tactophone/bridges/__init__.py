"""Bridges from a run to other systems: logs, live viewers, robot middleware, haptic formats.

Each runs in a process of its own, reads telemetry, and sees nothing else of the live system. What a bridge can ask for
is what any watcher may: to stop and to mute.
"""

from tactophone.bridges.mcap import LogEnd, LogEntry, LoggedPrediction, McapLog, is_mcap, read_log
from tactophone.bridges.process import Bridge, BridgeProcess

__all__ = [
    "Bridge",
    "BridgeProcess",
    "LogEnd",
    "LogEntry",
    "LoggedPrediction",
    "McapLog",
    "is_mcap",
    "read_log",
]
