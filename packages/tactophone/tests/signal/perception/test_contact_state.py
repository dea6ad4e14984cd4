"""The machines of contact run from their tables, and meet nothing that these lack."""

import enum
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from tactophone.signal.perception import contact_state
from tactophone.signal.perception.contact_state import (
    Durations,
    Level,
    LevelMachine,
    Persistence,
    PersistenceMachine,
    Thresholds,
    Trust,
    TrustMachine,
    contact_of,
)

DURATIONS = Durations(shortest=4, hold=6, early=5, distrust=30, jerk=20, persistent=8)
THRESHOLDS = Thresholds(open_from=2.0, clear_from=6.0, close_under=1.5)


class Walked(dict[Any, Any]):
    """A table that notes which of its changes were made."""

    def __init__(self, table: Mapping[enum.Enum, Mapping[enum.Enum, enum.Enum]]):
        super().__init__({state: Walked.Row(table[state], self) for state in table})
        self.made: set[tuple[enum.Enum, enum.Enum]] = set()
        for state, row in self.items():
            row.state = state

    class Row(dict[Any, Any]):
        def __init__(self, changes: Mapping[enum.Enum, enum.Enum], table: "Walked"):
            super().__init__(changes)
            self.table = table
            self.state: Any = None

        def __getitem__(self, event: enum.Enum) -> Any:
            self.table.made.add((self.state, event))
            return super().__getitem__(event)

    def all(self) -> set[tuple[enum.Enum, enum.Enum]]:
        return {(state, event) for state in self for event in self[state]}


def levels(count: int) -> Iterator[tuple[float, float]]:
    """Powers that rise, fall and pause at random."""
    random = np.random.default_rng(0)
    while count:
        length = min(count, int(random.integers(1, 20)))
        slow, fast = random.choice([0.0, 1.7, 3.0]), random.choice([0.0, 0.0, 8.0])
        for _ in range(length):
            yield float(slow), float(fast)
        count -= length


def walk(durations: Durations) -> None:
    """Let all machines run on random levels, bands and motions."""
    random = np.random.default_rng(1)
    level = LevelMachine(durations)
    trust = TrustMachine(durations)
    persistence = PersistenceMachine(durations)
    for now, (slow, fast) in enumerate(levels(20_000)):
        if level.step(slow, fast, THRESHOLDS):
            trust.open(now, by_air=bool(random.random() < 0.3))
        loud = bool(random.random() < 0.3)
        # The noise becomes known, and unknown again with another microphone.
        by_bands = now // 1_000 % 2 == 1
        if by_bands:
            trust.check(level, now, confirmed=loud)
        elif level.state is Level.OPEN:
            trust.compare_with_air(by_air=bool(random.random() < 0.6), steps=2)
        touching, held = contact_of(
            level.state,
            trust.state,
            by_bands=by_bands,
            bands_loud=loud,
            bands_recent=loud,
        )
        if random.random() < 0.05:
            persistence.jerk(now, starts=bool(random.random() < 0.5))
        persistence.update(now, touching=touching, held=held)


def test_every_change_that_a_table_allows_is_made_and_no_other_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names = "LEVELS", "TRUST", "PERSISTENCE"
    tables = {name: Walked(getattr(contact_state, name)) for name in names}
    for name, table in tables.items():
        monkeypatch.setattr(contact_state, name, table)
    # A gate that holds nothing closes at once.
    for durations in (DURATIONS, DURATIONS._replace(hold=0)):
        walk(durations)
    for table in tables.values():
        assert table.made == table.all()


def test_steps_that_are_passed_over_leave_the_level_as_if_each_had_been_taken() -> None:
    one, other = LevelMachine(DURATIONS), LevelMachine(DURATIONS)
    for slow, fast in levels(5000):
        one.step(slow, fast, THRESHOLDS)
        if other.stays([slow], [fast], THRESHOLDS):
            other.pass_over(1)
        else:
            other.step(slow, fast, THRESHOLDS)
        assert (one.state, one.open_for) == (other.state, other.open_for)


def test_contact_that_a_start_of_the_robot_may_have_made_has_to_persist() -> None:
    persistence = PersistenceMachine(DURATIONS)
    persistence.jerk(0, starts=True)
    states = []
    for now in range(1, 12):
        persistence.update(now, touching=True, held=False)
        states.append(persistence.state)
    assert states[:8] == [Persistence.PENDING] * 8
    assert states[8:] == [Persistence.COUNTED] * 3


def test_an_opening_that_no_band_confirms_is_not_trusted_again_soon() -> None:
    level, trust = LevelMachine(DURATIONS), TrustMachine(DURATIONS)
    for now in range(10):
        if level.step(3.0, 0.0, THRESHOLDS):
            trust.open(now)
        trust.check(level, now, confirmed=False)
    assert level.state is Level.OPEN
    assert trust.state is Trust.DISTRUSTED
    trust.open(20)
    assert trust.state is Trust.DISTRUSTED
    trust.open(40)
    assert trust.state is Trust.EARLY


@pytest.mark.parametrize(
    ("level", "bands_loud", "held"),
    [
        (Level.OPEN, False, False),
        (Level.HELD, True, False),
        (Level.CLOSED, True, False),
        (Level.HELD, False, True),
        (Level.CLOSED, False, True),
    ],
)
def test_contact_is_only_held_where_neither_the_level_nor_the_bands_hear_it(
    level: Level, bands_loud: bool, held: bool
) -> None:
    touching, is_held = contact_of(
        level, Trust.SETTLED, by_bands=True, bands_loud=bands_loud, bands_recent=True
    )
    assert touching
    assert is_held is held
