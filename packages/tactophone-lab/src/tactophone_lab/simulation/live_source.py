"""The simulated finger as a source of live sound: what `--source finger` opens."""

from typing import TYPE_CHECKING

from tactophone.core import extras
from tactophone.core.errors import ConfigError
from tactophone.core.hand import each_finger
from tactophone.core.settings import Settings
from tactophone.core.types import Source

if TYPE_CHECKING:  # they bring numba and scipy, which are an extra
    from tactophone.app.sources import InstructedSource


def open_finger(settings: Settings) -> Source:
    """Open the simulated finger, or hand, of ``settings.capture``; it strokes five
    stones without end.

    Raises `ConfigError` if ``capture.device`` is not a seed.
    """
    extras.require_extras("sim")
    from tactophone_lab.simulation.demonstration import StrokingFinger, StrokingHand

    capture = settings.capture
    if not (capture.device or "0").isdecimal():
        raise ConfigError(
            f"capture.device = {capture.device!r}, but for the simulated finger it is "
            "a seed, a whole number from 0"
        )
    seed = int(capture.device or 0)
    if settings.is_hand:
        return StrokingHand(
            len(each_finger(settings)), capture.block_size, seed=seed, tip=capture.tip
        )
    return StrokingFinger(capture.block_size, seed=seed, tip=capture.tip)


def open_instructed(settings: Settings, object_name: str) -> "InstructedSource":
    """Open a simulated person who touches an object of the catalogue as told, with the
    gains and microphone faults of ``settings.simulation``.

    Raises `DatasetError` if the catalogue has no such object.
    """
    extras.require_extras("sim")
    from tactophone_lab.simulation.catalogue import find
    from tactophone_lab.simulation.faults import FaultSpan
    from tactophone_lab.simulation.participant import (
        InstructedFinger,
        SimulatedParticipant,
    )

    simulated = settings.simulation
    participant = SimulatedParticipant(
        find(object_name),
        gain_db=simulated.gain_db,
        air_gain_db=simulated.air_gain_db,
        seed=simulated.seed,
        tip=settings.capture.tip,
    )
    spans = [text.strip() for text in simulated.faults.split(",")]
    faults = [FaultSpan.parse(span) for span in spans if span]
    return InstructedFinger(participant, faults)
