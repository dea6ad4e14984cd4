"""Requests of a viewer, parsed from the page's JSON; the run alone decides whether to grant them."""

import json
from dataclasses import dataclass
from typing import Any

from tactophone.telemetry import FingerState, Request, State

_LEVELS = ("ceiling", "output_level")
_WITHOUT_VALUE = ("stop", "mute", "arm")

MAX_NAME_BYTES = 64
"""Of a profile's name: the size of the mailbox."""


@dataclass(frozen=True, slots=True)
class RecordRequest:
    """Begin a log of the run, or end it: for whoever keeps logs, not for the run."""

    begin: bool


def parse_request(text: str, state: State, *, finger: int = 0, local: bool = True) -> Request | RecordRequest | str:
    """Parse a request; returns a text with the reason when it must be refused.

    Parameters
    ----------
    state
        Settings of the run now: a page may lower the ceiling and never raises it, not even to an earlier value. The run
        itself refuses any ceiling above the local machine's; this check is the stricter.
    finger
        Whose settings the request is for.
    local
        Whether the page is open on the machine of the run. A page on another machine may stop, mute and weaken the
        vibration; it never arms, strengthens or changes what is detected.

    Examples
    --------
    >>> parse_request('{"action": "mute"}', State()).action
    'mute'
    >>> parse_request('{"action": "ceiling", "value": 0.9}', State(fingers=(FingerState(ceiling=0.5),)))
    'a page can lower the ceiling (0.5 now), never raise it: raise it at the machine'
    """
    own = (state.fingers[finger:] or state.fingers)[0]
    try:
        entries = json.loads(text)
        action, value, name = entries["action"], entries.get("value", 0.0), entries.get("text", "")
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return "not a request: write JSON with an action"
    if not local and (reason := _refusal_of_remote(action, value, own)):
        return reason
    if action in _WITHOUT_VALUE:
        return Request(action)
    if action == "record":
        return RecordRequest(value is True)
    if action in (*_LEVELS, "threshold_dbfs"):
        return _number(action, value, own)
    if action == "profile":
        return _profile(name, state)
    return f"there is no action {str(action)[:20]!r}"


def _refusal_of_remote(action: Any, value: Any, own: FingerState) -> str:
    weaker = isinstance(value, int | float) and value <= own.output_level
    if action in ("stop", "mute", "ceiling") or (action == "output_level" and weaker):
        return ""
    return f"only a page on the run's own machine may do that ({str(action)[:20]}): this one may stop, mute and weaken"


def _number(action: Any, value: Any, own: FingerState) -> Request | str:
    # An integer of hundreds of digits is no float, so it is bounded before anything converts it.
    if isinstance(value, bool) or not isinstance(value, int | float) or not -1e6 <= value <= 1e6:
        return f"{action} needs a number"
    low, high = (0.0, 1.0) if action in _LEVELS else (-120.0, 0.0)
    if not low <= value <= high:
        return f"{action} must be from {low:g} to {high:g}"
    if action == "ceiling" and value > own.ceiling:
        return f"a page can lower the ceiling ({own.ceiling:g} now), never raise it: raise it at the machine"
    return Request(action, float(value))


def _profile(name: Any, state: State) -> Request | str:
    if name not in state.profiles or len(name.encode()) > MAX_NAME_BYTES:
        return f"profiles are {', '.join(state.profiles)}"
    return Request("profile", text=name)
