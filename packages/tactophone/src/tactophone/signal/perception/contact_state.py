"""The states of contact: what the level says, whether it is trusted alone, and whether
contact is old enough to count.

All that decides is in this file, as three machines. Each has its states, the events
that it takes, and a table that gives the next state for each of them. `ContactGate`
measures, tells the machines what happened, and asks `contact_of` what that means.

Machines take steps of 0.25 ms, which they also count, since some events depend on how
long something has lasted.
"""

import enum
from collections.abc import Mapping
from typing import Any, NamedTuple

from tactophone.signal.perception.state_table import Table, describe_table


class Durations(NamedTuple):
    """How long what must last, in steps."""

    shortest: int
    """The shortest touch: what opens stays open for so long."""
    hold: int
    """The longest silence over which contact is held."""
    early: int
    """From an opening of the level on, how long it is trusted alone."""
    distrust: int
    """After an opening that no band confirmed, how long another counts for nothing."""
    jerk: int
    """From a start or stop of the robot on, how long new contact has to persist."""
    persistent: int
    """How long such contact has to persist."""


class Thresholds(NamedTuple):
    """Powers of steps that the levels are compared with."""

    open_from: float
    """From here on the long level opens the gate."""
    clear_from: float
    """From here on the short level opens the gate by itself."""
    close_under: float
    """Under this the long level closes the gate."""


class Level(enum.Enum):
    """What the level says."""

    CLOSED = "There is no contact."
    OPEN = "There is contact."
    HELD = "It is silent, but the finger may only turn, so contact is held."


class LevelEvent(enum.Enum):
    """What the levels of a step mean for the state that they meet."""

    LOUD = "the long level is over the threshold, or the short one clearly"
    LINGERING = (
        "the level lies under the threshold, but has not fallen far, or it has "
        "just opened"
    )
    QUIET = "it is silent, but for no longer than a finger that turns"
    SILENT = "it is silent for longer than that"


LEVELS: Table[Level, LevelEvent] = {
    Level.CLOSED: {
        LevelEvent.LOUD: Level.OPEN,
        LevelEvent.QUIET: Level.CLOSED,
        LevelEvent.SILENT: Level.CLOSED,
    },
    Level.OPEN: {
        LevelEvent.LOUD: Level.OPEN,
        LevelEvent.LINGERING: Level.OPEN,
        LevelEvent.QUIET: Level.HELD,
        LevelEvent.SILENT: Level.CLOSED,
    },
    Level.HELD: {
        LevelEvent.LOUD: Level.OPEN,
        LevelEvent.QUIET: Level.HELD,
        LevelEvent.SILENT: Level.CLOSED,
    },
}
"""The next state of the level. Only an open gate lingers: what is held has fallen, and
must be loud to open again."""


class LevelMachine:
    """What the level says, step by step.

    ``open_for`` is the number of steps since it last opened.
    """

    def __init__(self, durations: Durations) -> None:
        self.state = Level.CLOSED
        self.open_for = 0
        self._silent_for = 0
        self._durations = durations

    def step(self, slow: float, fast: float, thresholds: Thresholds) -> bool:
        """Take the long and the short level of a step; return whether it opens."""
        before = self.state
        self.open_for += 1
        event = self._event(slow, fast, thresholds)
        self.state = LEVELS[before][event]
        opens = before is Level.CLOSED and self.state is Level.OPEN
        if opens:
            self.open_for = 0
        return opens

    def _event(self, slow: float, fast: float, thresholds: Thresholds) -> LevelEvent:
        if slow >= thresholds.open_from or fast >= thresholds.clear_from:
            self._silent_for = 0
            return LevelEvent.LOUD
        if self.state is Level.OPEN and (
            slow >= thresholds.close_under or self.open_for < self._durations.shortest
        ):
            self._silent_for = 0
            return LevelEvent.LINGERING
        self._silent_for += 1
        if self._silent_for <= self._durations.hold:
            return LevelEvent.QUIET
        return LevelEvent.SILENT

    def stays(
        self, slow: list[float], fast: list[float], thresholds: Thresholds
    ) -> bool:
        """Whether steps of these levels plainly leave the state as it is, so that none
        needs a look of its own."""
        if self.state is Level.HELD:
            return False
        if not slow:
            return True
        if self.state is Level.OPEN:
            return min(slow) >= thresholds.close_under
        return max(slow) < thresholds.open_from and max(fast) < thresholds.clear_from

    def pass_over(self, steps: int) -> None:
        """Take so many steps of which `stays` is true."""
        self.open_for += steps
        is_open = self.state is Level.OPEN
        self._silent_for = 0 if is_open else self._silent_for + steps


class Trust(enum.Enum):
    """Whether the level is trusted before the bands, whose windows are longer, can
    agree."""

    SETTLED = "The bands have had time to answer, and they decide."
    EARLY = "The level has just opened, and it is trusted alone."
    DISTRUSTED = (
        "The bands did not agree, or the air microphone was far louder, so the level "
        "begins no contact for a while."
    )


class TrustEvent(enum.Enum):
    """What happens to the trust in the level."""

    OPENS = "the level opens"
    OPENS_BY_AIR = "the level opens, but the air microphone is far louder"
    OPENS_SOON = (
        "the level opens again within a second of an opening that nobody confirmed"
    )
    CONFIRMED = "the bands have had time, and are loud or were a moment ago"
    UNCONFIRMED = "the bands have had time, and are not loud"
    EXCEEDS_AIR = (
        "no noise is known yet, and the level is louder than what may have come "
        "through the air"
    )
    BY_AIR = (
        "no noise is known yet, and the air microphone has been far louder for longer "
        "than a finger turns"
    )


TRUST: Table[Trust, TrustEvent] = {
    Trust.SETTLED: {
        TrustEvent.OPENS: Trust.EARLY,
        TrustEvent.OPENS_BY_AIR: Trust.DISTRUSTED,
        TrustEvent.EXCEEDS_AIR: Trust.SETTLED,
        TrustEvent.BY_AIR: Trust.DISTRUSTED,
    },
    Trust.EARLY: {
        TrustEvent.OPENS: Trust.EARLY,
        TrustEvent.OPENS_BY_AIR: Trust.DISTRUSTED,
        TrustEvent.CONFIRMED: Trust.SETTLED,
        TrustEvent.UNCONFIRMED: Trust.DISTRUSTED,
        TrustEvent.EXCEEDS_AIR: Trust.EARLY,
        TrustEvent.BY_AIR: Trust.DISTRUSTED,
    },
    Trust.DISTRUSTED: {
        TrustEvent.OPENS: Trust.EARLY,
        TrustEvent.OPENS_BY_AIR: Trust.DISTRUSTED,
        TrustEvent.OPENS_SOON: Trust.DISTRUSTED,
        TrustEvent.EXCEEDS_AIR: Trust.EARLY,
        TrustEvent.BY_AIR: Trust.DISTRUSTED,
    },
}
"""Whether the level is trusted next."""


class TrustMachine:
    """Whether the level is trusted before the bands can agree."""

    def __init__(self, durations: Durations) -> None:
        self.state = Trust.SETTLED
        self._distrusted_until = 0
        # For how many steps the level has been no louder than the air's.
        self._by_air_for = 0
        self._durations = durations

    def open(self, now: int, *, by_air: bool = False) -> None:
        """Take that the level opens at a step, and whether that may have come through
        the air."""
        self._by_air_for = 0
        self.state = TRUST[self.state][self._opening(now, by_air)]

    def _opening(self, now: int, by_air: bool) -> TrustEvent:
        if by_air:
            return TrustEvent.OPENS_BY_AIR
        if now < self._distrusted_until:
            return TrustEvent.OPENS_SOON
        return TrustEvent.OPENS

    def check(self, level: LevelMachine, now: int, *, confirmed: bool) -> None:
        """Take at a step whether the bands confirm the level."""
        waits = self.state is Trust.EARLY and level.state is not Level.CLOSED
        if not waits or level.open_for < self._durations.early:
            return
        event = TrustEvent.CONFIRMED if confirmed else TrustEvent.UNCONFIRMED
        self.state = TRUST[self.state][event]
        if self.state is Trust.DISTRUSTED:
            self._distrusted_until = now + self._durations.distrust

    def compare_with_air(self, *, by_air: bool, steps: int) -> None:
        """Take, of a loud level that no band can confirm yet, whether it may have come
        through the air, so many steps after the last time."""
        self._by_air_for = self._by_air_for + steps if by_air else 0
        if not by_air:
            self.state = TRUST[self.state][TrustEvent.EXCEEDS_AIR]
            self._distrusted_until = 0
        elif self._by_air_for > self._durations.hold:
            self.state = TRUST[self.state][TrustEvent.BY_AIR]


class Persistence(enum.Enum):
    """Whether contact counts. A robot that starts or stops shakes the microphones,
    which sounds like contact."""

    NONE = "There is no contact."
    PENDING = "There is contact, but the robot starts or stops, so it has to persist."
    COUNTED = "There is contact, and it counts."


class PersistenceEvent(enum.Enum):
    """What happens to contact."""

    BEGINS = "contact begins"
    BEGINS_IN_JERK = "contact begins within half a second of a start or stop"
    JERK = "the robot starts, and contact is younger than 0.15 s"
    PERSISTS = "contact has lasted for 0.15 s"
    ENDS = "contact ends"


PERSISTENCE: Table[Persistence, PersistenceEvent] = {
    Persistence.NONE: {
        PersistenceEvent.BEGINS: Persistence.COUNTED,
        PersistenceEvent.BEGINS_IN_JERK: Persistence.PENDING,
        PersistenceEvent.ENDS: Persistence.NONE,
    },
    Persistence.PENDING: {
        PersistenceEvent.JERK: Persistence.PENDING,
        PersistenceEvent.PERSISTS: Persistence.COUNTED,
        PersistenceEvent.ENDS: Persistence.NONE,
    },
    Persistence.COUNTED: {
        PersistenceEvent.JERK: Persistence.PENDING,
        PersistenceEvent.ENDS: Persistence.NONE,
    },
}
"""Whether contact counts next."""


class PersistenceMachine:
    """Whether contact counts, beside a robot that says when it moves."""

    def __init__(self, durations: Durations) -> None:
        self.state = Persistence.NONE
        self._began = 0
        self._jerk_until = 0
        self._durations = durations

    def jerk(self, now: int, *, starts: bool) -> None:
        """Take that the robot starts or stops at a step.

        Contact that is as young as the start may be the start itself. A landing that
        stops the robot is none.
        """
        self._jerk_until = now + self._durations.jerk
        if starts and self.state is not Persistence.NONE and self._is_young(now):
            self.state = PERSISTENCE[self.state][PersistenceEvent.JERK]

    def update(self, now: int, *, touching: bool, held: bool) -> None:
        """Take at a step whether there is contact, and whether it is only held."""
        if not touching:
            self.state = PERSISTENCE[self.state][PersistenceEvent.ENDS]
        elif self.state is Persistence.NONE:
            self._began = now
            in_jerk = now < self._jerk_until
            event = (
                PersistenceEvent.BEGINS_IN_JERK if in_jerk else PersistenceEvent.BEGINS
            )
            self.state = PERSISTENCE[self.state][event]
        elif self.state is Persistence.PENDING and not held and not self._is_young(now):
            # A silence over which contact is held is no evidence that it persists.
            self.state = PERSISTENCE[self.state][PersistenceEvent.PERSISTS]

    def _is_young(self, now: int) -> bool:
        return now - self._began < self._durations.persistent


def contact_of(
    level: Level,
    trust: Trust,
    *,
    by_bands: bool,
    bands_loud: bool,
    bands_recent: bool,
    needs_trust: bool = False,
) -> tuple[bool, bool]:
    """Return whether there is contact, and whether it is only held over a silence.

    - ``by_bands``: whether the bands decide, or the level alone.
    - ``bands_loud``: whether the bands are loud now.
    - ``bands_recent``: whether they were a moment ago, within the hold.
    - ``needs_trust``: whether a level that decides alone counts only if it is trusted:
      until the noise is known, where an air microphone is heard too.

    >>> contact_of(
    ...     Level.OPEN,
    ...     Trust.DISTRUSTED,
    ...     by_bands=True,
    ...     bands_loud=False,
    ...     bands_recent=False,
    ... )
    (False, False)
    """
    if not by_bands:
        if needs_trust and trust is Trust.DISTRUSTED:
            return False, False
        return level is not Level.CLOSED, level is Level.HELD
    early = level is not Level.CLOSED and trust is Trust.EARLY
    touching = early or bands_recent
    # What either of them hears is no silence.
    silent = level is not Level.OPEN and not bands_loud
    return touching, touching and silent


MACHINES: Mapping[str, Table[Any, Any]] = {
    "What the level says": LEVELS,
    "Whether the level is trusted": TRUST,
    "Whether contact counts": PERSISTENCE,
}
"""The tables, by what they decide, for the documentation."""


def describe() -> str:
    """Return the machines as the tables and drawings of the documentation."""
    return "\n".join(
        f"### {title}\n\n{describe_table(table)}" for title, table in MACHINES.items()
    )
