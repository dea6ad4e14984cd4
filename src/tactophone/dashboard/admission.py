"""Which pages are admitted to a WebSocket, and which are sent away: too many, of another version, or flooding.

A page cannot read the answer to a refused WebSocket, so it is accepted and closed at once, with a reason that it shows.
"""

import time
from collections.abc import Sized

from aiohttp import web

VERSION = "1"
"""Of the messages between page and server; `live.js` sends its own. Change both when a message changes."""

TAKEN = 4001
"""WebSocket close code, of the range for applications: another window took the place."""

OTHER_VERSION, TOO_MANY, FLOOD = 4002, 4003, 4008
"""Close codes: the page is of another version, too many pages are open, the page sends too much."""

MAX_MESSAGE_BYTES = 4_096
"""Bytes of a message from a page."""

FLOOD_RATE = 500.0
"""Messages a second, twice what a page sends that acknowledges 125 a second and follows a fast pointer."""


async def admit(request: web.Request, views: Sized, most: int) -> web.WebSocketResponse | None:
    """Open a page's WebSocket; ``None`` if the page has left already, ``views`` are too many, or it is too old."""
    view = web.WebSocketResponse(heartbeat=20, max_msg_size=MAX_MESSAGE_BYTES, compress=False)
    try:
        await view.prepare(request)
    except ConnectionError:
        return None
    if request.query.get("v", VERSION) != VERSION:
        await view.close(code=OTHER_VERSION, message=b"this page is of another version: reload it")
    elif len(views) >= most:
        await view.close(code=TOO_MANY, message=f"{most} pages are open already: close one".encode())
    else:
        return view
    return None


def finger_of(request: web.Request) -> int:
    """Return which finger of a hand a page shows and controls, counted from 0."""
    text = request.query.get("finger", "")
    return int(text) if len(text) == 1 and text.isascii() and text.isdecimal() else 0


class FloodGate:
    """Counts what a page sends, as a bucket that empties at ``rate`` a second and holds one second of it.

    Examples
    --------
    >>> gate = FloodGate(10.0)
    >>> [gate.overflows(4, now=0.0), gate.overflows(4, now=0.0), gate.overflows(4, now=0.0), gate.overflows(4, now=1.0)]
    [False, False, True, False]
    """

    def __init__(self, rate: float) -> None:
        self._rate, self._level, self._time = rate, 0.0, 0.0

    def overflows(self, amount: float = 1.0, *, now: float | None = None) -> bool:
        """Add an amount; true if that is too much."""
        now = time.monotonic() if now is None else now
        self._level = max(0.0, self._level - self._rate * (now - self._time)) + amount
        self._time = now
        return self._level > self._rate


async def end_flood(view: web.WebSocketResponse) -> None:
    """Close a page that floods; the run never notices."""
    await view.close(code=FLOOD, message=b"this page sends too much: reload it")
