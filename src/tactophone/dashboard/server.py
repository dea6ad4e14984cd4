"""The page's server: files, one live feed for each viewer, and a viewer's wishes back.

A viewer acknowledges each message, and gets no further one while `CREDIT` of them are outstanding. A stalled browser
therefore costs nothing but its connection: nothing queues up, and what it missed comes in one piece when it wakes.
"""

import asyncio
import json
from collections.abc import Awaitable, Callable
from contextlib import suppress
from importlib.resources import files

from aiohttp import WSMsgType, web
from aiohttp.typedefs import Middleware

from tactophone.dashboard.feed import Feed, Run
from tactophone.dashboard.requests import wish
from tactophone.dashboard.security import HEADERS, AccessControl
from tactophone.telemetry import State

PERIOD = 1 / 60
"""Seconds between messages: a screen's."""

CREDIT = 3
"""Messages under way to a viewer at most: 50 ms, more than a local page ever needs."""

VIEWERS = 8
"""At the same time at most, so that forgotten tabs cannot take the machine."""

LARGEST_WISH = 4_096
"""Bytes of a message from a page."""

STATIC = files("tactophone.dashboard") / "static"

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]
RUN = web.AppKey("run", Run)
VIEWS: web.AppKey[set[web.WebSocketResponse]] = web.AppKey("views", set)


def dashboard(name: str) -> web.Application:
    """Build the operator's page for the run of that name."""
    app = web.Application()
    app[RUN], app[VIEWS] = Run(name), set()
    app.router.add_get("/", page("index.html"))
    app.router.add_get("/live", _live)
    return app


def guarded(inner: web.Application, guard: AccessControl) -> web.Application:
    """Put a page, and the files that all pages load, under the token and behind the guard."""
    inner.router.add_static("/static", str(STATIC))
    outer = web.Application(middlewares=[_keep_out(guard)], client_max_size=LARGEST_WISH)
    outer.add_subapp(f"/{guard.token}", inner)
    outer.on_response_prepare.append(_add_headers)
    return outer


def page(name: str) -> Handler:
    """Make the handler that gives one HTML file."""

    async def handler(request: web.Request) -> web.StreamResponse:
        return web.Response(text=(STATIC / name).read_text(encoding="utf-8"), content_type="text/html")

    return handler


def _keep_out(guard: AccessControl) -> Middleware:
    @web.middleware
    async def middleware(request: web.Request, handler: Handler) -> web.StreamResponse:
        reason = guard.refusal(
            token=request.path.split("/")[1],
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
    if len(views) >= VIEWERS:
        return web.Response(status=503, text=f"{VIEWERS} pages are open already: close one.\n")
    view = web.WebSocketResponse(heartbeat=20, max_msg_size=LARGEST_WISH, compress=False)
    await view.prepare(request)
    views.add(view)
    credit = asyncio.Semaphore(CREDIT)
    try:
        async with asyncio.TaskGroup() as tasks:
            sending = tasks.create_task(_send(view, Feed(run), credit))
            await _receive(view, run, credit)
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


async def _receive(view: web.WebSocketResponse, run: Run, credit: asyncio.Semaphore) -> None:
    async for message in view:
        if message.type is not WSMsgType.TEXT:
            continue
        if message.data == "ok":
            credit.release()
            continue
        snapshot = run.snapshot()
        asked = wish(message.data, snapshot.state if snapshot else State())
        if isinstance(asked, str):
            await view.send_str(json.dumps({"refused": asked}))
        else:
            run.ask(asked)
