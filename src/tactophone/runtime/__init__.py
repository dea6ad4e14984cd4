"""Time: threads, processes, clock and devices wired to the stages; start, watch over and stop them."""

from tactophone.runtime.operator import Operator, run_operator
from tactophone.runtime.output_gate import OutputGate
from tactophone.runtime.robot import Robot, run_robot
from tactophone.runtime.supervisor import ProcessInfo, Supervisor

__all__ = ["Operator", "OutputGate", "ProcessInfo", "Robot", "Supervisor", "run_operator", "run_robot"]
