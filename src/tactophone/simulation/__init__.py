"""Surface, finger, room, network and operator: stand-ins that pass the real contracts."""

from tactophone.simulation.content.catalogue import TestObject, catalogue, find
from tactophone.simulation.content.movement import TAKES, Script, Take, take_moves
from tactophone.simulation.physics.finger import Electronics, Finger
from tactophone.simulation.physics.motion import Move
from tactophone.simulation.physics.scene import Scene, five_stones, row, shuffled, single
from tactophone.simulation.physics.session_variation import SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger, Truth

__all__ = [
    "TAKES",
    "Electronics",
    "Finger",
    "Move",
    "Scene",
    "Script",
    "SessionVariation",
    "SimulatedFinger",
    "Take",
    "TestObject",
    "Truth",
    "catalogue",
    "find",
    "five_stones",
    "row",
    "shuffled",
    "single",
    "take_moves",
]
