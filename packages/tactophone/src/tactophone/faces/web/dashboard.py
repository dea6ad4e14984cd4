"""The operator's page: a live feed for each viewer, and requests from the viewers; the
run alone decides on these.

A viewer acknowledges each message, and receives none while `CREDIT` of them are
unacknowledged. So nothing queues up for a stalled browser; when it resumes, it receives
what it missed in a single message.
"""

import asyncio
import json
import time
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.connection import Connection
from typing import Any

from aiohttp import WSMsgType, web

from tactophone.faces.web import views
from tactophone.faces.web.devices import Fingertips, PageMicrophone
from tactophone.faces.web.feed import Feed, WatchedRun
from tactophone.live.telemetry.layout import FingerState, Request, RunState

DASHBOARD_PERIOD = 1 / 60
"""Seconds between messages: the refresh interval of a screen."""

_LEVELS = ("ceiling", "output_level")
_WITHOUT_VALUE = ("stop", "mute", "arm")

MAX_NAME_BYTES = 64
"""Longest name of a profile: the mailbox holds no more."""


@dataclass(frozen=True, slots=True)
class RecordRequest:
    """Begin a log of the run, or end it: for whoever keeps logs, not for the run."""

    begin: bool


SILENCED_SINCE = (
    "somebody has stopped or muted the run since that was pressed: press again"
)
"""Why an arming is refused that was asked for before."""


def parse_request(
    text: str,
    state: RunState,
    *,
    finger: int = 0,
    local: bool = True,
    silenced: int | None = None,
) -> Request | RecordRequest | str:
    """Parse a request; returns a text with the reason when it must be refused.

    - ``state``: settings of the run now: a page may lower the ceiling and never raises
      it, not even to an earlier value. The run itself refuses any ceiling above the
      local machine's; this check is the stricter.
    - ``finger``: whose settings the request is for.
    - ``local``: whether the page is open on the machine of the run. A page on another
      machine may stop, mute and weaken the vibration; it never arms, strengthens or
      changes what is detected.
    - ``silenced``: `Watcher.silenced` now. A request to arm says what its page has
      seen: however late it comes, it releases nothing that was stopped after it.

    >>> parse_request('{"action": "mute"}', RunState()).action
    'mute'
    >>> state = RunState(fingers=(FingerState(ceiling=0.5),))
    >>> parse_request('{"action": "ceiling", "value": 0.9}', state)
    'a page can lower the ceiling (0.5 now), never raise it: raise it at the machine'
    """
    own = (state.fingers[finger:] or state.fingers)[0]
    try:
        entries = json.loads(text)
        action = entries["action"]
        value = entries.get("value", 0.0)
        name = entries.get("text", "")
        seen = entries.get("silenced")
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return "not a request: write JSON with an action"
    weaker = (
        action == "output_level"
        and isinstance(value, int | float)
        and value <= own.output_level
    )
    if not local and not weaker and action not in ("stop", "mute", "ceiling"):
        name = str(action)[:20]
        return (
            f"only a page on the run's own machine may do that ({name}): this one may "
            "stop, mute and weaken"
        )
    if action == "arm" and silenced is not None and seen != silenced:
        return SILENCED_SINCE
    if action in _WITHOUT_VALUE:
        return Request(action)
    if action == "buzz":
        return _buzz(own)
    if action == "record":
        return RecordRequest(value is True)
    if action in ("pause", "seek") and state.role == "replay":
        longest = state.duration if action == "seek" else 1.0
        known = isinstance(value, int | float) and 0 <= value <= longest
        return (
            Request(action, float(value))
            if known
            else f"{action} must be from 0 to {longest:g}"
        )
    if action in (*_LEVELS, "threshold_dbfs"):
        # What the run shows now may change before it reads the request: who may only
        # weaken asks for the lower of the two.
        lowers = action == "ceiling" or (action == "output_level" and not local)
        return _number(action, value, own, lowers=lowers)
    if action == "profile":
        if name not in state.profiles or len(name.encode()) > MAX_NAME_BYTES:
            return f"profiles are {', '.join(state.profiles)}"
        return Request("profile", text=name)
    return f"there is no action {str(action)[:20]!r}"


def _buzz(own: FingerState) -> Request | str:
    if not own.can_buzz:
        return "nothing here drives an actuator that can buzz"
    if not own.armed:
        return "no buzz while muted: press Resume first"
    return Request("buzz")


def _number(
    action: Any, value: Any, own: FingerState, *, lowers: bool
) -> Request | str:
    # An integer of hundreds of digits is no float, so it is bounded before anything
    # converts it.
    if (
        isinstance(value, bool)
        or not isinstance(value, int | float)
        or not -1e6 <= value <= 1e6
    ):
        return f"{action} needs a number"
    low, high = (0.0, 1.0) if action in _LEVELS else (-120.0, 0.0)
    if not low <= value <= high:
        return f"{action} must be from {low:g} to {high:g}"
    if action == "ceiling" and value > own.ceiling:
        return (
            f"a page can lower the ceiling ({own.ceiling:g} now), never raise it: "
            "raise it at the machine"
        )
    if lowers:
        action = f"lower_{action}"
    return Request(action, float(value))


def dashboard(
    name: str, microphone: Connection | None = None, recorder: Connection | None = None
) -> web.Application:
    """Build the operator's page for the run of that name.

    ``microphone`` takes the sound of a page that listens. ``recorder`` keeps logs: true
    begins one, false ends it, and each answer says how far it is
    (`tactophone.app.runs.PageRecorder`); this process writes no file.
    """
    app = web.Application()
    run = WatchedRun(name)
    watching = set[web.WebSocketResponse]()
    logs = (
        views.Answers(recorder, watching, kept={"recording": {"phase": "off"}})
        if recorder is not None
        else None
    )
    app.router.add_get("/", views.page(views.STATIC / "index.html"))
    app.router.add_get("/try", views.page(views.STATIC / "try.html"))
    app.router.add_get("/live", partial(_live, run, watching, logs))
    app.router.add_get("/feel", Fingertips(run).connect)
    if microphone is not None:
        app.router.add_get("/listen", PageMicrophone(microphone).connect)
    if logs is not None:
        app.on_startup.append(logs.follow)
    return app


async def _live(
    run: WatchedRun,
    watching: set[web.WebSocketResponse],
    logs: views.Answers | None,
    request: web.Request,
) -> web.StreamResponse:
    view = await views.admit(request, watching, views.PAGE_VIEWERS)
    if view is None:
        return web.Response()
    watching.add(view)
    credit = asyncio.Semaphore(views.CREDIT)
    try:
        await views.say_command(view, request)
        if logs is not None:
            # What a page needs for a clock of its own, whose time of day may differ.
            now = {"now": time.monotonic()}
            await view.send_str(json.dumps({**logs.status, **now}))
        finger = views.finger_of(request)
        receiving = _receive(
            view, run, logs, credit, local=views.is_local(request), finger=finger
        )
        await views.exchange(
            view,
            Feed(run, finger=finger).message,
            receiving,
            credit=credit,
            interval=DASHBOARD_PERIOD,
        )
    finally:
        watching.discard(view)
    return view


async def _receive(
    view: web.WebSocketResponse,
    run: WatchedRun,
    logs: views.Answers | None,
    credit: asyncio.Semaphore,
    *,
    local: bool,
    finger: int,
) -> None:
    snapshot = None
    async for message in views.messages_of(view):
        if message.type is not WSMsgType.TEXT:
            continue
        if message.data == "ok":
            credit.release()
            continue
        # Only what is new is read, as a flood of requests must stay cheap.
        snapshot = run.snapshot(snapshot, finger=finger)
        request = parse_request(
            message.data,
            snapshot.state if snapshot else RunState(),
            finger=finger,
            local=local,
            silenced=run.silenced,
        )
        if isinstance(request, str):
            await view.send_str(json.dumps({"refused": request}))
        elif isinstance(request, RecordRequest):
            if logs is not None:
                logs.send(request.begin)
        elif request.action == "stop":
            run.ask(request)  # an emergency stop is for all fingers
        else:
            run.ask(replace(request, finger=finger))
