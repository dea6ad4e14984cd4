"""What a viewer may ask of the run, read from the page's JSON; whether it is granted, the run alone decides."""

import json
import math
from typing import Any

from tactophone.telemetry import Request, State

_LEVELS = ("ceiling", "output_level")
_WORDLESS = ("stop", "mute", "arm")

LONGEST_NAME = 64
"""Bytes of a profile's name: what the mailbox holds."""


def wish(text: str, state: State) -> Request | str:
    """Read one request; a text says why it is none that could be granted.

    Parameters
    ----------
    state
        How the run is set now: a page may lower its ceiling and never raises it, not even to where it was. The run
        refuses what is over the local machine's ceiling; this is the nearer of two fences.

    Examples
    --------
    >>> wish('{"action": "mute"}', State()).action
    'mute'
    >>> wish('{"action": "ceiling", "value": 0.9}', State(ceiling=0.5))
    'a page can lower the ceiling (0.5 now), never raise it: raise it at the machine'
    """
    try:
        asked = json.loads(text)
        action, value, name = asked["action"], asked.get("value", 0.0), asked.get("text", "")
    except (ValueError, TypeError, KeyError, AttributeError):
        return "not a request: wanted JSON with an action"
    if action in _WORDLESS:
        return Request(action)
    if action in (*_LEVELS, "threshold_dbfs"):
        return _number(action, value, state)
    if action == "profile":
        return _profile(name, state)
    return f"there is no action {str(action)[:20]!r}"


def _number(action: Any, value: Any, state: State) -> Request | str:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        return f"{action} wants a number"
    low, high = (0.0, 1.0) if action in _LEVELS else (-120.0, 0.0)
    if not low <= value <= high:
        return f"{action} is {low:g} to {high:g}"
    if action == "ceiling" and value > state.ceiling:
        return f"a page can lower the ceiling ({state.ceiling:g} now), never raise it: raise it at the machine"
    return Request(action, float(value))


def _profile(name: Any, state: State) -> Request | str:
    if name not in state.profiles or len(name.encode()) > LONGEST_NAME:
        return f"profiles are {', '.join(state.profiles)}"
    return Request("profile", text=name)
