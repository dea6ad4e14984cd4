"""The states of a touch: what is said at each update, and why.

All that decides is in this file. At every update, which is a window or a change of
contact, `TouchDetector` fills in a `Moment`. `next_state` goes through `RULES` from the
top and takes the first that holds. `answer` says what the state means for the finger.

A touch begins as soon as the contact gate opens, and always smooth: a false bump is
worse than one that is missed. It turns rough once a window that is full enough of
contact says so. It ends as soon as the gate closes.
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
    PAUSED = "Contact is held over a short silence, and the last decision stands."
    HELD = "Contact is held over a longer silence and may be over, so it is smooth."
    LANDING = "There is contact, but nothing can be told of it yet, so it is smooth."
    STANDING = "The window is too quiet to classify, and the last decision stands."
    ROUGH = "The windows say rough, or are not yet evidence enough against it."
    SMOOTH = "The windows say smooth."


class Moment(NamedTuple):
    """What is known at an update: all that the next state depends on."""

    touching: bool
    """Whether the contact gate says contact."""
    faulty: bool
    """Whether the window held invalid numbers."""
    paused: bool
    """Whether the gate only holds contact, and only since a moment ago."""
    held: bool
    """Whether the gate only holds contact."""
    usable: bool
    """Whether the window is full enough of contact to be classified."""
    landed: bool
    """Whether the touch is old enough to be rough."""
    sounds_like_touch: bool
    """Whether the sound of late is touch, and not speech or rain."""
    window: Touch
    """What the window says."""


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
        TouchState.PAUSED,
        "silence has begun a moment ago",
        lambda moment: moment.paused,
    ),
    Rule(
        TouchState.HELD,
        "silence lasts, and the gate still holds contact",
        lambda moment: moment.held,
    ),
    Rule(
        TouchState.LANDING,
        "the window still holds more of what was before the touch",
        lambda moment: not moment.usable,
    ),
    Rule(
        TouchState.STANDING,
        "the window is quieter than contact",
        lambda moment: moment.window is Touch.NONE,
    ),
    Rule(
        TouchState.LANDING,
        "the window says rough, but the finger has just landed",
        lambda moment: moment.window is Touch.ROUGH and not moment.landed,
    ),
    Rule(
        TouchState.ROUGH,
        "the window says rough, and it sounds like touch",
        lambda moment: moment.window is Touch.ROUGH and moment.sounds_like_touch,
    ),
    Rule(TouchState.SMOOTH, "otherwise", lambda moment: True),
)
"""The machine: the first rule that holds gives the state, whatever the state was."""


class Answer(enum.Enum):
    """What is felt in a state."""

    NOTHING = "nothing"
    SMOOTH = "smooth"
    LAST_DECISION = "the last decision of this touch"
    WINDOW = "what the window says"


ANSWERS = {
    TouchState.ABSENT: Answer.NOTHING,
    TouchState.FAULTY: Answer.NOTHING,
    TouchState.PAUSED: Answer.LAST_DECISION,
    TouchState.HELD: Answer.SMOOTH,
    TouchState.LANDING: Answer.SMOOTH,
    TouchState.STANDING: Answer.LAST_DECISION,
    TouchState.ROUGH: Answer.WINDOW,
    TouchState.SMOOTH: Answer.WINDOW,
}
"""What is felt in each state; only what a window says is a decision to remember."""


def next_state(moment: Moment) -> TouchState:
    """Return the state of the first rule that holds.

    >>> moment = Moment(True, False, False, False, True, True, True, Touch.ROUGH)
    >>> next_state(moment).name, next_state(moment._replace(landed=False)).name
    ('ROUGH', 'LANDING')
    """
    return next(rule.state for rule in RULES if rule.holds(moment))


def describe() -> str:
    """Return the rules and the states as the tables of the documentation."""
    rules = [
        "| first of these that holds | state | what is felt |",
        "|---|---|---|",
        *(
            f"| {rule.when} | {name_of(rule.state)} | {ANSWERS[rule.state].value} |"
            for rule in RULES
        ),
    ]
    return "\n".join([*rules, "", describe_states(TouchState)])
