"""The page's server: files, a live feed for each viewer, and requests from the viewers.

A viewer acknowledges each message, and receives none while `CREDIT` of them are unacknowledged. So nothing queues up
for a stalled browser; when it resumes, it receives what it missed in a single message.
"""

import asyncio
import json
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import replace
from importlib.resources import files
from importlib.resources.abc import Traversable
from multiprocessing.connection import Connection

from aiohttp import WSMsgType, web
from aiohttp.typedefs import Middleware

from tactophone.dashboard.admission import FLOOD_RATE, MAX_MESSAGE_BYTES, FloodGate, admit, end_flood, finger_of
from tactophone.dashboard.feed import Feed, WatchedRun
from tactophone.dashboard.fingertip import Fingertips
from tactophone.dashboard.listen import PageMicrophone
from tactophone.dashboard.recorder import Recorder
from tactophone.dashboard.requests import RecordRequest, parse_request
from tactophone.dashboard.security import HEADERS, AccessControl
from tactophone.telemetry import State

PERIOD = 1 / 60
"""Seconds between messages: the refresh interval of a screen."""

CREDIT = 3
"""Unacknowledged messages to a viewer: 50 ms of them, more than a local page needs."""

VIEWERS = 16
"""Greatest number of viewers, so that forgotten tabs cannot load the machine."""

HEADER_TIMEOUT = 10.0
"""Seconds that a connection may take to send a request; a browser sends one at once."""

STATIC = files("tactophone.dashboard") / "static"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
RUN = web.AppKey("run", WatchedRun)
VIEWS: web.AppKey[set[web.WebSocketResponse]] = web.AppKey("views", set)
RECORDER = web.AppKey("recorder", Recorder)


def dashboard(name: str, microphone: Connection | None = None, recorder: Connection | None = None) -> web.Application:
    """Build the operator's page for the run of that name.

    ``microphone`` takes the sound of a page that listens; ``recorder`` keeps logs, as `Recorder` asks for them.
    """
    app = web.Application()
    app[RUN], app[VIEWS] = WatchedRun(name), set()
    app.router.add_get("/", page(STATIC / "index.html"))
    app.router.add_get("/try", page(STATIC / "try.html"))
    app.router.add_get("/live", _live)
    app.router.add_get("/feel", Fingertips(app[RUN]).connect)
    if microphone is not None:
        app.router.add_get("/listen", PageMicrophone(microphone).connect)
    if recorder is not None:
        app[RECORDER] = Recorder(recorder, app[VIEWS])
        app.on_startup.append(app[RECORDER].follow)
    return app


def protect(inner: web.Application, access: AccessControl) -> web.Application:
    """Serve a page, and the files that all pages load, under the token and behind access control."""
    inner.router.add_static("/static", str(STATIC))
    outer = web.Application(middlewares=[_check_access(access)], client_max_size=MAX_MESSAGE_BYTES)
    outer.add_subapp(f"/{access.token}", inner)
    outer.on_response_prepare.append(_add_headers)
    return outer


def page(path: Traversable) -> Handler:
    """Return a handler that serves an HTML file."""

    async def handler(request: web.Request) -> web.StreamResponse:
        return web.Response(text=path.read_text(encoding="utf-8"), content_type="text/html")

    return handler


async def close_idle_connections(runner: web.AppRunner, *, timeout: float = HEADER_TIMEOUT) -> None:
    """Close connections that have had no request for a while: the web server waits for a request's header for ever.

    A page's live connection is one request that goes on, and stays.
    """
    waiting: dict[int, float] = {}
    while runner.server is not None:
        now = time.monotonic()
        handlers = {id(handler): handler for handler in runner.server.connections}
        idle = {key: handler for key, handler in handlers.items() if handler._current_request is None}
        waiting = {key: waiting.get(key, now) for key in idle}
        for key, since in waiting.items():
            if now - since > timeout:
                idle[key].force_close()
                if transport := idle[key].transport:
                    transport.abort()
        await asyncio.sleep(timeout / 5)


def _check_access(access: AccessControl) -> Middleware:
    @web.middleware
    async def middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
        reason = access.refusal(
            token=request.path.partition("/")[2].partition("/")[0],
            host=request.headers.get("Host"),
            origin=request.headers.get("Origin"),
            websocket="Upgrade" in request.headers,
        )
        return web.Response(status=403, text=f"Refused: {reason}.\n") if reason else await handler(request)

    return middleware


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    response.headers.update(HEADERS)


async def _live(request: web.Request) -> web.StreamResponse:
    views, run = request.app[VIEWS], request.app[RUN]
    view = await admit(request, views, VIEWERS)
    if view is None:
        return web.Response()
    views.add(view)
    credit = asyncio.Semaphore(CREDIT)
    recorder = request.app.get(RECORDER)
    try:
        if recorder is not None:
            await view.send_str(json.dumps(recorder.status))
        async with asyncio.TaskGroup() as tasks:
            finger = finger_of(request)
            sending = tasks.create_task(_send(view, Feed(run, finger=finger), credit))
            await _receive(view, run, recorder, credit, local=is_local(request), finger=finger)
            sending.cancel()
    finally:
        views.discard(view)
    return view


async def _send(view: web.WebSocketResponse, feed: Feed, credit: asyncio.Semaphore) -> None:
    with suppress(ConnectionError):
        while not view.closed:
            await credit.acquire()
            await view.send_bytes(feed.message())
            await asyncio.sleep(PERIOD)


def is_local(request: web.Request) -> bool:
    """Return whether a page is open on this machine: both ends of its connection then have the same address."""
    if request.transport is None:
        return False
    peer, own = (request.transport.get_extra_info(end) for end in ("peername", "sockname"))
    return bool(peer and own and peer[0] == own[0])


async def _receive(
    view: web.WebSocketResponse, run: WatchedRun, recorder: Recorder | None, credit: asyncio.Semaphore, *, local: bool,
    finger: int,
) -> None:  # fmt: skip
    gate, snapshot = FloodGate(FLOOD_RATE), None
    async for message in view:
        if gate.overflows():
            await end_flood(view)
            return
        if message.type is not WSMsgType.TEXT:
            continue
        if message.data == "ok":
            credit.release()
            continue
        snapshot = run.snapshot(snapshot, finger=finger)  # only what is new: a flood of requests must stay cheap
        request = parse_request(message.data, snapshot.state if snapshot else State(), finger=finger, local=local)
        if isinstance(request, str):
            await view.send_str(json.dumps({"refused": request}))
        elif isinstance(request, RecordRequest):
            if recorder is not None:
                recorder.ask(request.begin)
        elif request.action == "stop":
            run.ask(request)  # an emergency stop is for all fingers
        else:
            run.ask(replace(request, finger=finger))
