"""Surface, finger, room, network and operator: stand-ins that pass the real contracts."""

from tactophone.simulation.catalogue import Thing, catalogue, find
from tactophone.simulation.finger import Electronics, Finger
from tactophone.simulation.motion import Move
from tactophone.simulation.movement import TAKES, Script, Take, take_moves
from tactophone.simulation.scene import Scene, five_stones, row, shuffled, single
from tactophone.simulation.setup import Setup
from tactophone.simulation.source import SimulatedFinger, Truth

__all__ = [
    "TAKES",
    "Electronics",
    "Finger",
    "Move",
    "Scene",
    "Script",
    "Setup",
    "SimulatedFinger",
    "Take",
    "Thing",
    "Truth",
    "catalogue",
    "find",
    "five_stones",
    "row",
    "shuffled",
    "single",
    "take_moves",
]
