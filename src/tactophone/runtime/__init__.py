"""Threads, processes, clocks and devices of the live system: the only room that reads the time."""

from tactophone.runtime.gate import OutputGate
from tactophone.runtime.operator import Operator, run_operator
from tactophone.runtime.pairing import pair_on_one_machine, temporary_keys, with_operator
from tactophone.runtime.priority import prioritize_thread
from tactophone.runtime.recorder import SessionRecorder
from tactophone.runtime.robot import Robot, run_robot
from tactophone.runtime.supervisor import ProcessInfo, Supervisor, supervised
from tactophone.runtime.wiring import OpenSource, open_actuator, open_device, open_pipeline_for

__all__ = [
    "OpenSource",
    "Operator",
    "OutputGate",
    "ProcessInfo",
    "Robot",
    "SessionRecorder",
    "Supervisor",
    "open_actuator",
    "open_device",
    "open_pipeline_for",
    "pair_on_one_machine",
    "prioritize_thread",
    "run_operator",
    "run_robot",
    "supervised",
    "temporary_keys",
    "with_operator",
]
