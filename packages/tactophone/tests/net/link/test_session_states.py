"""Sessions move as the table at the head of `net/link/session.py` says, and every row
of it is walked."""

import random
from itertools import chain, repeat

from tactophone.net.link.session import Session, SessionState

from .session_pair import SessionPair, calling

Move = tuple[SessionState, SessionState]

MOVES: set[Move] = {
    ("idle", "handshaking"),
    ("handshaking", "connected"),
    ("handshaking", "idle"),
    ("connected", "rehandshaking"),
    ("connected", "idle"),
    ("rehandshaking", "connected"),
    ("rehandshaking", "handshaking"),
}
"""The rows of the table, as state and next state."""


def followed(session: Session, moves: set[Move]) -> Session:
    """Note each change of state that one call of a session makes."""
    for name in ("receive", "poll", "hang_up"):

        def call(
            *args: object, work: object = getattr(session, name), **names: object
        ) -> object:
            before = session.state
            result = work(*args, **names)  # type: ignore[operator]
            if session.state != before:
                moves.add((before, session.state))
            return result

        setattr(session, name, call)
    return session


def walk(seed: int, moves: set[Move]) -> None:
    dice, pair = random.Random(seed), SessionPair()
    followed(pair.robot, moves)
    followed(pair.operator, moves)
    for _ in range(25):
        match dice.choice(("wait", "wait", "silence", "hang up", "restart")):
            case "wait":
                pair.wait(dice.choice((0.05, 0.1, 1.0)))
            case "silence":
                pair.lose(chain(repeat(False, dice.randrange(4)), repeat(True)))
                pair.wait(dice.choice((0.5, 3.0, 40.0)), step=0.2)
                pair.lose(())
            case "hang up":
                dice.choice((pair.robot, pair.operator)).hang_up()
            case "restart":
                pair.robot = followed(calling(), moves)


def test_every_row_of_the_table_is_walked_and_no_other() -> None:
    moves: set[Move] = set()
    for seed in range(6):
        walk(seed, moves)
    assert moves == MOVES
