"""A simulated person who follows the instructions of guided commands, so that they run
without hardware.

It is a source like any other: iterating it yields the sound; its methods start a
movement.
"""

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

import numpy as np

from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock
from tactophone_lab.simulation.catalogue import SimulatedObject
from tactophone_lab.simulation.faults import FaultSpan, FaultySource
from tactophone_lab.simulation.finger import Electronics, tip_named
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.modes import Mounting
from tactophone_lab.simulation.motion import LIFT, single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import Script, take_moves
from tactophone_lab.simulation.takes import TAKES, Take

if TYPE_CHECKING:
    from tactophone.app.sources import SimulatedAct

PRESS = 1.5
"""Newtons of a stroke of medium pressure."""

STROKE = 0.5
"""Seconds of a stroke from end to end."""

TAP = 2.0
"""Newtons of a tap."""


class SimulatedParticipant(AlwaysOpen):
    """A simulated finger on an object, moved on request; a
    :class:`~tactophone.core.types.Source`.

    ``gain_db`` and ``air_gain_db`` are extra gains of the two preamplifiers;
    ``electronics`` replaces the tip's own. ``mounting`` is the catalogue's by default;
    ``seed`` draws the set-up, the movement and the noise.

    >>> from tactophone_lab.simulation.catalogue import find
    >>> participant = SimulatedParticipant(find("lava stone"))
    >>> participant.stroke(1.0)
    >>> next(iter(participant)).size
    480
    """

    sample_rate = LIVE_SAMPLE_RATE
    channels = 2

    def __init__(
        self,
        obj: SimulatedObject,
        mounting: Mounting | None = None,
        *,
        gain_db: float = 0.0,
        air_gain_db: float = 0.0,
        seed: int = 0,
        tip: str = DEFAULT_TIP,
        electronics: Electronics | None = None,
    ) -> None:
        scene = single(obj, mounting)
        self._placed = scene.placed[0]
        self._rng = np.random.default_rng([0x701, seed])
        wired = (electronics or tip_named(tip).electronics).amplified(
            gain_db, air_gain_db
        )
        session = SessionVariation.draw(seed, wired, tip=tip)
        self._finger = SimulatedFinger(
            scene, session=session, seed=seed, place=self._placed.centre
        )
        self._now = 0.0

    def __iter__(self) -> Iterator[AudioBlock]:
        for block in self._finger:
            self._now = block.end / block.sample_rate
            yield block

    def rest(self) -> None:
        """Lift off and touch nothing."""
        x, y = self._placed.centre
        self._finger.move(x, y, LIFT, self._now)

    def stroke(self, duration: float) -> None:
        """Stroke to and fro without a pause for ``duration`` s."""
        script = self._script()
        script.land(PRESS)
        left = self._placed.left + 0.01
        right = self._placed.left + self._placed.width - 0.01
        while script.time < self._now + duration:
            script.stroke(
                left if script.x > self._placed.centre[0] else right, STROKE, PRESS
            )
        self._perform(script)

    def tap(self, duration: float) -> None:
        """Tap about twice a second for ``duration`` s."""
        script = self._script()
        while script.time < self._now + duration - 0.3:
            script.hover(0.2)
            script.tap(TAP)
        self._perform(script)

    def move(self, duration: float) -> None:
        """Move in the air for ``duration`` s, with three starts and stops, and touch
        nothing."""
        script = self._script()
        reach = 0.4 * self._placed.width
        for part in range(1, 4):
            while script.time < self._now + part * duration / 3 - STROKE:
                script.hover(STROKE, x=self._placed.centre[0] + (reach := -reach))
            script.hover(STROKE / 2)
        self._perform(script)

    def take(self, take: Take, duration: float) -> None:
        """Perform a take of the paper's protocol for ``duration`` s."""
        for move in take_moves(take, self._placed, duration=duration, rng=self._rng):
            self._finger.move(move.x, move.y, move.force, self._now + move.time)

    def _script(self) -> Script:
        x, y = self._placed.centre
        return Script(self._rng, x=x, y=y, start=self._now)

    def _perform(self, script: Script) -> None:
        script.hover(0.2)
        for move in script.moves:
            self._finger.move(move.x, move.y, move.force, move.time)


class InstructedFinger(FaultySource):
    """A simulated person who does as told, through microphones with faults."""

    def __init__(
        self, person: SimulatedParticipant, faults: Iterable[FaultSpan]
    ) -> None:
        super().__init__(person, faults)
        self._person = person

    def ask(self, act: "SimulatedAct") -> None:
        """Begin ``rest``, ``stroke``, ``tap``, ``move``, or the take that ``act``
        names."""
        if act.take:
            take = next(take for take in TAKES if take.name == act.take)
            self._person.take(take, act.duration)
        elif act.verb == "rest":
            self._person.rest()
        else:
            perform = {
                "stroke": self._person.stroke,
                "tap": self._person.tap,
                "move": self._person.move,
            }[act.verb]
            perform(act.duration)
