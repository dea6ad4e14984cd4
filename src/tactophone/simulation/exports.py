"""The names that `tactophone.simulation` exports. Import them from there: this module loads numba and scipy."""

from tactophone.simulation.content.catalogue import PAPER, SimulatedObject, catalogue, find
from tactophone.simulation.content.competition import DAYS, CompetitionRun, run_recording, write_finals, write_run
from tactophone.simulation.content.demonstration import demonstrate_hand, demonstration, write_demonstration
from tactophone.simulation.content.generate import RenderOptions, plan_dataset, render_dataset, write_manifest
from tactophone.simulation.content.measured_surfaces import measured_objects
from tactophone.simulation.content.movement import Script, take_moves
from tactophone.simulation.content.render_store import read_render_metadata
from tactophone.simulation.content.stone_order import shuffled
from tactophone.simulation.content.takes import TAKES, Take
from tactophone.simulation.participants.offline_pipeline import OfflinePipeline
from tactophone.simulation.participants.operator import (
    SoundToVibration,
    perceive_visits,
    play_rounds,
    render_visits,
    summarize_rounds,
)
from tactophone.simulation.participants.participant import SimulatedParticipant
from tactophone.simulation.participants.stroking_finger import StrokingFinger
from tactophone.simulation.participants.stroking_hand import StrokingHand
from tactophone.simulation.physics.finger import Electronics, Finger
from tactophone.simulation.physics.hand import STRUCTURE_DB, SimulatedHand
from tactophone.simulation.physics.motion import LIFT
from tactophone.simulation.physics.scene import Scene, five_stones, row, single
from tactophone.simulation.physics.sensor_faults import CODES, FaultSpan, FaultySource
from tactophone.simulation.physics.session_variation import SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger

__all__ = [
    "CODES", "DAYS", "LIFT", "PAPER", "STRUCTURE_DB", "TAKES", "CompetitionRun", "Electronics", "FaultSpan",
    "FaultySource",
    "Finger", "OfflinePipeline", "RenderOptions", "Scene", "Script", "SessionVariation",
    "SimulatedFinger", "SimulatedHand", "SimulatedObject", "SimulatedParticipant", "SoundToVibration",
    "StrokingFinger", "StrokingHand",
    "Take", "catalogue", "demonstrate_hand", "demonstration", "find", "five_stones", "measured_objects",
    "perceive_visits", "plan_dataset",
    "play_rounds", "read_render_metadata", "render_dataset", "render_visits", "row", "run_recording",
    "shuffled", "single", "summarize_rounds", "take_moves", "write_demonstration", "write_finals",
    "write_manifest", "write_run",
]  # fmt: skip
