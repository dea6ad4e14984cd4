"""What all pages share: their files behind access control, who is admitted to a
WebSocket, and answers to every page.

Sent away are pages too many, of another version, or flooding. A page cannot read the
answer to a refused WebSocket, so it is accepted and closed at once, with a reason that
it shows.
"""

import asyncio
import io
import json
import shlex
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Sized
from contextlib import suppress
from functools import lru_cache, partial
from importlib.resources import files
from importlib.resources.abc import Traversable
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary, WeakSet

from aiohttp import WSCloseCode, WSMessage, web

from tactophone.faces.web import connections
from tactophone.faces.web.connections import FILE_COST, Acceptor, Turns
from tactophone.faces.web.security import AccessControl, headers_for

PAGE_VERSION = "1"
"""Version of the messages between page and server; `feed.js` sends its own. Change both
when a message changes."""

TAKEN = 4001
"""WebSocket close code, of the range for applications: another window took the
place."""

OTHER_VERSION = 4002
"""Close code: the page comes from another version of this package."""

TOO_MANY = 4003
"""Close code: too many pages are open."""

FLOOD = 4008
"""Close code: the page sends too much."""

FLOODS = "this page sends too much: reload it"
"""What such a page shows."""

MAX_MESSAGE_BYTES = 4_096
"""Bytes of a message from a page."""

FLOOD_RATE = 500.0
"""Messages a second, twice what a page sends that acknowledges 125 a second and follows
a fast pointer."""

PAGE_VIEWERS = 16
"""Greatest number of viewers, so that forgotten tabs cannot load the machine."""

OWN_PLACES = 4
"""Places that only pages on the run's own machine may take: whoever has the address on
the network must not keep the operator from the button that stops."""

CREDIT = 3
"""Unacknowledged messages to a viewer: 50 ms of them, more than a local page needs."""

QR_PAGES = ("", "try")
"""Pages whose address a QR code may show; any other leads to the first."""

STATIC = files("tactophone.faces.web") / "static"

PALETTE = files("tactophone.core") / "palette.css"
"""The colours of all pages."""

RUNS_WASM = web.AppKey("runs_wasm", bool)
"""Whether a page compiles WebAssembly, which its content security policy then allows;
that lets no text become a script."""

PROOF = web.AppKey("proof", str)
"""`AccessControl.proof` of a page's server."""

OPEN = web.AppKey("open", WeakSet[web.WebSocketResponse])
"""The WebSockets of a page's server."""

ENDED = b"the run has ended"
"""Said to open pages before the server goes (`static/statebar.js`): one that hears
nothing has lost a run that may go on."""

TURNS = web.AppKey("turns", Turns)
"""When messages of pages on other machines are taken."""

_ELSEWHERE = WeakKeyDictionary[
    web.WebSocketResponse, tuple[Turns, asyncio.Transport | None]
]()
"""Of the WebSockets of pages on other machines: whose turns they take, and their
connections."""

Handler = Callable[[web.Request], Awaitable[web.StreamResponse]]


def protect(
    inner: web.Application, access: AccessControl, acceptor: Acceptor
) -> web.Application:
    """Serve a page, and the files that all pages load, under the token and behind
    access control."""

    @web.middleware
    async def check_access(
        request: web.Request, handler: Handler
    ) -> web.StreamResponse:
        if not is_local(request):
            await turns.take(FILE_COST, request.transport)
        reason = access.refusal(
            token=request.path.partition("/")[2].partition("/")[0],
            host=request.headers.get("Host"),
            origin=request.headers.get("Origin"),
            websocket="Upgrade" in request.headers,
        )
        if reason:
            return web.Response(status=403, text=f"Refused: {reason}.\n")
        acceptor.admit(request.protocol)
        return await handler(request)

    turns = Turns()
    inner[TURNS] = Turns()
    headers = headers_for(wasm=inner.get(RUNS_WASM, False))

    async def add_headers(request: web.Request, response: web.StreamResponse) -> None:
        response.headers.update(headers)

    inner.router.add_get(
        "/static/palette.css",
        page(PALETTE, "text/css"),
    )
    inner[PROOF] = access.proof
    inner[OPEN] = WeakSet()
    inner.on_shutdown.append(_take_leave)
    inner.router.add_get("/static/proof.js", _proof)
    inner.router.add_get("/qr.svg", partial(_qr_code, access))
    add_files(inner, "/static", STATIC)
    outer = web.Application(
        middlewares=[check_access], client_max_size=MAX_MESSAGE_BYTES
    )
    outer.add_subapp(f"/{access.token}", inner)
    outer.on_response_prepare.append(add_headers)
    return outer


async def _take_leave(app: web.Application) -> None:
    opened = app[OPEN]
    for view in list(opened):
        await view.close(code=WSCloseCode.GOING_AWAY, message=ENDED)


def add_files(app: web.Application, prefix: str, folder: Traversable) -> None:
    """Serve the files that a folder holds now; ``prefix`` stands before their names.

    The file system is asked for these names alone. What a request names may be too long
    for it, or hold characters that no file name can have.
    """
    root = Path(str(folder))
    for path in sorted(root.rglob("*")):
        if path.is_file():
            name = path.relative_to(root).as_posix()
            app.router.add_get(f"{prefix}/{name}", partial(_send_file, path))


async def _send_file(path: Path, request: web.Request) -> web.StreamResponse:
    return web.FileResponse(path)


async def _proof(request: web.Request) -> web.Response:
    """Return the module from which `feed.js` has the secret of this server."""
    text = f"export const PROOF = {json.dumps(request.app[PROOF])};\n"
    return web.Response(text=text, content_type="text/javascript")


async def _qr_code(access: AccessControl, request: web.Request) -> web.Response:
    """Return the page's address as a QR code; 204 where no other machine can open it,
    and 501 without the library."""
    if access.private:
        return web.Response(status=204)
    shown = request.query.get("page", "")
    try:
        picture = _drawn(access.url + (shown if shown in QR_PAGES else ""))
    except ModuleNotFoundError:
        return web.Response(status=501)
    return web.Response(body=picture, content_type="image/svg+xml")


@lru_cache(maxsize=len(QR_PAGES))
def _drawn(address: str) -> bytes:
    """Return an address as a QR code; each is drawn once."""
    import segno

    picture = io.BytesIO()
    segno.make(address, error="l").save(
        picture, kind="svg", scale=4, border=2, dark="black", light="white"
    )
    return picture.getvalue()


def page(path: Traversable, kind: str = "text/html") -> Handler:
    async def handler(request: web.Request) -> web.StreamResponse:
        return web.Response(text=path.read_text(encoding="utf-8"), content_type=kind)

    return handler


def is_local(request: web.Request) -> bool:
    """Return whether a page is open on this machine: both ends of its connection then
    have the same address."""
    if request.transport is None:
        return False
    peer, own = (
        request.transport.get_extra_info(end) for end in ("peername", "sockname")
    )
    return bool(peer and own and peer[0] == own[0])


async def say_command(view: web.WebSocketResponse, request: web.Request) -> None:
    """Tell a page on this machine the command line of the run, which it shows when the
    run has ended."""
    if is_local(request):
        with suppress(ConnectionError):
            await view.send_str(
                json.dumps({"command": shlex.join(["tactophone", *sys.argv[1:]])})
            )


async def admit(
    request: web.Request, views: Sized, most: int
) -> web.WebSocketResponse | None:
    """Open a page's WebSocket; ``None`` if the page has left already, ``views`` are too
    many, or it is too old. The last `OWN_PLACES` are for pages on this machine; a page
    anywhere may be the only one."""
    view = web.WebSocketResponse(
        heartbeat=20, autoping=False, max_msg_size=MAX_MESSAGE_BYTES, compress=False
    )
    try:
        await view.prepare(request)
    except ConnectionError:
        return None
    if request.query.get("v", PAGE_VERSION) != PAGE_VERSION:
        await view.close(
            code=OTHER_VERSION,
            message=b"this page comes from another version: reload it; if that does "
            b"not help, tactophone was updated: restart the run",
        )
    elif len(views) >= most - (0 if is_local(request) else min(OWN_PLACES, most - 1)):
        await view.close(
            code=TOO_MANY, message=f"{most} pages are open already: close one".encode()
        )
    else:
        if "prove" in request.query:
            with suppress(ConnectionError):
                await view.send_str(request.app[PROOF])
        if OPEN in request.app:
            request.app[OPEN].add(view)
        if not is_local(request):
            _ELSEWHERE[view] = request.app[TURNS], request.transport
        return view
    return None


def finger_of(request: web.Request) -> int:
    """Return which finger of a hand a page shows and controls, counted from 0."""
    text = request.query.get("finger", "")
    return int(text) if len(text) == 1 and text.isascii() and text.isdecimal() else 0


async def messages_of(view: web.WebSocketResponse) -> AsyncIterator[WSMessage]:
    """Yield what a page sends until it leaves, or floods and is closed."""
    async for message in connections.messages_of(
        view, rate=FLOOD_RATE, code=FLOOD, reason=FLOODS, turns=_ELSEWHERE.get(view)
    ):
        yield message


async def exchange(
    view: web.WebSocketResponse,
    message: Callable[[], bytes],
    receiving: Awaitable[None],
    *,
    credit: asyncio.Semaphore,
    interval: float,
) -> None:
    """Send a page what ``message`` returns, if anything, every ``interval`` s as its
    credit allows, while receiving."""

    async def send() -> None:
        with suppress(ConnectionError):
            while not view.closed:
                await credit.acquire()
                if content := message():
                    await view.send_bytes(content)
                else:
                    credit.release()
                await asyncio.sleep(interval)

    async with asyncio.TaskGroup() as tasks:
        sending = tasks.create_task(send())
        await receiving
        sending.cancel()


async def end_flood(view: web.WebSocketResponse) -> None:
    """Close a page that floods; the run never notices."""
    await view.close(code=FLOOD, message=FLOODS.encode())


class Answers:
    """A page's end of a pipe to the command that serves it: what pages ask goes in, and
    its answers go to every page.

    The caller adds and removes the ``views``, the pages that are open now. ``status``
    is what a page that is opened later has to show: the newest entry of each kind
    ``kept``, of every kind if that is ``None``.
    """

    def __init__(
        self,
        orders: Connection,
        views: set[web.WebSocketResponse],
        *,
        kept: dict[str, Any] | None = None,
    ) -> None:
        self.views = views
        self.status = kept or {}
        self._orders = orders
        self._every = kept is None
        self._sending: set[asyncio.Task[None]] = set()
        self._waiting: dict[web.WebSocketResponse, dict[str, Any]] = {}
        """What came for a page while its last answer was on the way."""

    def send(self, order: Any) -> None:
        with suppress(OSError):  # the command has ended, and soon ends this process too
            self._orders.send(order)

    async def follow(self, app: web.Application) -> None:
        """Take answers as they come, once the server runs."""
        asyncio.get_running_loop().add_reader(self._orders.fileno(), self._take)

    def _take(self) -> None:
        try:
            answer = self._orders.recv()
        except (EOFError, OSError):
            asyncio.get_running_loop().remove_reader(self._orders.fileno())
            return
        self.status |= {
            kind: entry
            for kind, entry in answer.items()
            if self._every or kind in self.status
        }
        for view in self.views:
            if (waiting := self._waiting.get(view)) is not None:
                waiting |= answer
                continue
            self._waiting[view] = dict(answer)
            task = asyncio.ensure_future(self._pass_on(view))
            self._sending.add(task)
            task.add_done_callback(self._sending.discard)

    async def _pass_on(self, view: web.WebSocketResponse) -> None:
        """Send a page what waits for it; for one that does not read, only the newest of
        each kind does."""
        with suppress(ConnectionError):
            while answer := self._waiting[view]:
                self._waiting[view] = {}
                await view.send_str(json.dumps(answer))
        del self._waiting[view]
