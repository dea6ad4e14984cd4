"""Time: threads, processes, clock and devices wired to the stages; start, watch over and stop them."""

from tactophone.runtime.guard import Guard
from tactophone.runtime.operator import Operator, run_operator
from tactophone.runtime.robot import Robot, run_robot
from tactophone.runtime.supervisor import Birth, Supervisor

__all__ = ["Birth", "Guard", "Operator", "Robot", "Supervisor", "run_operator", "run_robot"]
