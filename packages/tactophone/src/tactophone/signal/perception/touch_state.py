"""The states of a touch: what is said at each update, and why.

All that decides is in this file. At every update, which is a window or a change of
contact, `TouchDetector` fills in a `Moment`. `next_state` goes through `RULES` from the
top and takes the first that holds. `ANSWERS` says what is felt in it.

A touch begins as soon as the contact gate opens. Whether it is rough is said by the
evidence of all its windows (`evidence`), which begins as smooth: a false bump is worse
than one that is missed. A touch ends as soon as the gate closes, which is after a
silence longer than a turn (`signal.silences`).
"""

import enum
from collections.abc import Callable
from typing import NamedTuple

from tactophone.core.types import Touch
from tactophone.signal.perception.state_table import describe_states, name_of


class TouchState(enum.Enum):
    """What a touch detector with a gate says at an update, and why."""

    ABSENT = "There is no contact, so nothing is felt."
    FAULTY = "The sound or the model's output is invalid, so nothing is felt."
    HELD = "Contact is held over a silence and may be over, so it is smooth."
    ROUGH = "The evidence says rough."
    SMOOTH = "The evidence says smooth, or not enough yet."


class Moment(NamedTuple):
    """What is known at an update: all that the next state depends on."""

    touching: bool
    """Whether the contact gate says contact."""
    faulty: bool
    """Whether the window held invalid numbers."""
    silent: bool
    """Whether the gate only holds contact, and for longer than a finger turns."""
    sounds_like_touch: bool
    """Whether the sound of late is touch, and not speech or rain."""
    rough: bool
    """Whether the evidence says rough."""


class Rule(NamedTuple):
    """A state, and when it is entered if no rule above it holds."""

    state: TouchState
    when: str
    holds: Callable[[Moment], bool]


RULES = (
    Rule(
        TouchState.ABSENT,
        "the gate says no contact",
        lambda moment: not moment.touching,
    ),
    Rule(
        TouchState.FAULTY,
        "the window holds invalid numbers",
        lambda moment: moment.faulty,
    ),
    Rule(
        TouchState.HELD,
        "silence lasts, and the gate still holds contact",
        lambda moment: moment.silent,
    ),
    Rule(
        TouchState.ROUGH,
        "the evidence says rough, and it sounds like touch",
        lambda moment: moment.rough and moment.sounds_like_touch,
    ),
    Rule(TouchState.SMOOTH, "otherwise", lambda moment: True),
)
"""The machine: the first rule that holds gives the state, whatever the state was."""


ANSWERS = {
    TouchState.ABSENT: Touch.NONE,
    TouchState.FAULTY: Touch.NONE,
    TouchState.HELD: Touch.SMOOTH,
    TouchState.ROUGH: Touch.ROUGH,
    TouchState.SMOOTH: Touch.SMOOTH,
}
"""What is felt in each state."""


def next_state(moment: Moment) -> TouchState:
    """Return the state of the first rule that holds.

    >>> moment = Moment(
    ...     touching=True,
    ...     faulty=False,
    ...     silent=False,
    ...     sounds_like_touch=True,
    ...     rough=True,
    ... )
    >>> next_state(moment).name, next_state(moment._replace(silent=True)).name
    ('ROUGH', 'HELD')
    """
    return next(rule.state for rule in RULES if rule.holds(moment))


_WORDS = {Touch.NONE: "nothing", Touch.SMOOTH: "smooth", Touch.ROUGH: "rough"}


def describe() -> str:
    """Return the rules and the states as the tables of the documentation."""
    rules = [
        "| first of these that holds | state | what is felt |",
        "|---|---|---|",
        *(
            f"| {rule.when} | {name_of(rule.state)} | {_WORDS[ANSWERS[rule.state]]} |"
            for rule in RULES
        ),
    ]
    return "\n".join([*rules, "", describe_states(TouchState)])
