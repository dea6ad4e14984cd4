"""Connections of a web server from strangers: accepted in bounded number, so that
silent ones keep nobody away.

asyncio's own server accepts until the process has no descriptors left, and logs a
traceback for each failure.
"""

import asyncio
import contextlib
import logging
import socket
import ssl
import time
from collections import Counter
from collections.abc import AsyncIterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.core.errors import ConfigError
from tactophone.core.processes import FileStamp, file_stamp

if TYPE_CHECKING:
    from aiohttp import WSMessage, web

MOST = 64
"""Open connections; a browser has a handful for each page."""

QUEUE = 1024
"""Connections that the system holds until they are accepted: a viewer waits behind a
crowd rather than 1 s for a repeated SYN."""

CONNECTION_TIMEOUT = 5.0
"""Seconds for a TLS handshake, and for the header of a request; a browser sends both at
once."""


def listen(address: str, what: str, *, example: str) -> socket.socket:
    """Listen at ``HOST:PORT``; raises `ConfigError`, which begins with ``what``, where
    that is not possible."""
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal():
        raise ConfigError(
            f"{what} cannot listen at {address!r}: write HOST:PORT, such as {example}"
        )
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, int(port)), family=family, backlog=QUEUE)
    except (OSError, OverflowError) as error:
        raise ConfigError(
            f"{what} cannot listen at {address} ({error}): choose another address"
        ) from None


KEPT_PLACES = 8
"""Connections that a known address keeps while they show no token: a browser opens six
at once."""

KNOWN_ADDRESSES = 32
"""Addresses that are remembered: of 16 viewers and 16 fingertips."""


TURNS_AT_ONCE = 0.1
"""Seconds of turns that are taken without waiting: a page that is opened needs some 20
files."""

FILE_COST = 0.01
"""Seconds that one request of a page elsewhere takes of `Turns`: 100 a second."""

REQUEST_COST = 0.01
"""Seconds of what a page elsewhere asks of a run: 100 a second of all pages together,
as a slider or a pointer asks 60 a second."""

MESSAGE_COST = 0.00025
"""Seconds of any other message: 4,000 a second, as 12 fingertips acknowledge 200 each
and 12 viewers 60."""


class Certificate:
    """Files of a certificate and its key, for https.

    They are read again when they change: a certificate that was renewed during a run is
    shown to whoever connects next. Until both files are there and fit each other, the
    one from before is.

    Raises `OSError`, of which `ssl.SSLError` is one, where they cannot be used at the
    start.
    """

    def __init__(self, certificate: Path, key: Path) -> None:
        self._files = certificate, key
        self._stamp = self._look()
        self._context = self._read()

    def context(self) -> ssl.SSLContext:
        """Return what the next connection uses."""
        with contextlib.suppress(OSError):
            stamp = self._look()
            if stamp != self._stamp:
                self._context = self._read()
                self._stamp = stamp
        return self._context

    def _look(self) -> list[FileStamp]:
        return [file_stamp(path) for path in self._files]

    def _read(self) -> ssl.SSLContext:
        # A new one each time: one that fails to load keeps half of what it read.
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.load_cert_chain(*self._files)
        return context


class _Guest:
    """A connection that was accepted.

    - ``address``: of its other end, without the port.
    - ``own``: whether that is on this machine.
    - ``spoke``: whether a byte has come.
    - ``handler``: the server's end of the connection, after the TLS handshake.
    """

    def __init__(self, address: str, *, own: bool) -> None:
        self.address = address
        self.own = own
        self.spoke = False
        self.handler: Any = None
        self.task: asyncio.Task[None] | None = None

    @property
    def lasts(self) -> bool:
        if self.handler is not None:
            return self.handler.transport is not None
        return self.task is not None and not self.task.done()

    def drop(self) -> None:
        if self.task is not None:
            self.task.cancel()
        if self.handler is not None and self.handler.transport is not None:
            self.handler.transport.abort()


class Acceptor:
    """Accepts the connections of a web server.

    When there are `MOST`, one goes that has shown no token. First go those that have
    sent nothing, then those from strange addresses, then those from addresses that have
    shown the token before; among equals the address with the most connections loses its
    oldest.

    When all have shown the token, a new one of this machine takes the place of one from
    elsewhere, and any other new one goes. This machine's newest `KEPT_PLACES` stay:
    whoever has the address on the network must not keep the operator from the button
    that stops.

    - ``accepted``: connections accepted until now.
    """

    def __init__(self, certificate: "Certificate | None" = None) -> None:
        self.accepted = 0
        self._certificate = certificate
        self._guests: list[_Guest] = []  # in order of age
        self._admitted: set[Any] = set()
        # In order of use, as a dictionary keeps it.
        self._addresses: dict[str, None] = {}

    def admit(self, handler: Any) -> None:
        """Note that a connection (``request.protocol``) has shown the token."""
        self._admitted.add(handler)
        for guest in self._guests:
            if guest.handler is handler:
                self._addresses.pop(guest.address, None)
                self._addresses[guest.address] = None
        while len(self._addresses) > KNOWN_ADDRESSES:
            del self._addresses[next(iter(self._addresses))]

    async def serve(self, runner: "web.AppRunner", listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        listener.setblocking(False)
        if hasattr(socket, "TCP_DEFER_ACCEPT"):
            # Linux then holds a connection until its first byte.
            listener.setsockopt(
                socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, round(CONNECTION_TIMEOUT)
            )
        while True:
            try:
                connection, origin = await loop.sock_accept(listener)
            except OSError:
                # No descriptor is left: something else in this process has taken them.
                self._drop_one(own=True)
                await asyncio.sleep(0.1)
                continue
            self.accepted += 1
            self._forget_ended()
            own = origin[0] == connection.getsockname()[0]
            if len(self._guests) >= MOST and not self._drop_one(own=own):
                connection.close()
            else:
                guest = _Guest(str(origin[0]), own=own)
                guest.task = asyncio.create_task(
                    self._connect(runner, connection, guest)
                )
                self._guests.append(guest)
            await asyncio.sleep(0)  # the others' turn, also while more are waiting

    def _forget_ended(self) -> None:
        if len(self._guests) >= MOST:
            self._guests = [guest for guest in self._guests if guest.lasts]
            self._admitted = {
                handler for handler in self._admitted if handler.transport is not None
            }

    def _drop_one(self, *, own: bool) -> bool:
        """Drop the connection that is missed least, for one of this machine (``own``)
        or from elsewhere; false if none may go."""
        strangers = [
            guest
            for guest in self._guests
            if guest.handler is None or guest.handler not in self._admitted
        ]
        newest_own = [guest for guest in strangers if guest.own][-KEPT_PLACES:]
        strangers = [guest for guest in strangers if guest not in newest_own]
        if own and not strangers:
            elsewhere = [guest for guest in self._guests if not guest.own]
            strangers = elsewhere or newest_own
        if not strangers:
            return False
        crowd = Counter(guest.address for guest in strangers)
        places: Counter[str] = Counter()

        def worth(guest: _Guest) -> tuple[bool, bool, int]:
            if guest.spoke:
                places[guest.address] += 1
            known = (
                guest.spoke
                and guest.address in self._addresses
                and places[guest.address] <= KEPT_PLACES
            )
            return guest.spoke, known, -crowd[guest.address]

        # `min` takes the first of equals, which is the oldest.
        missed_least = min(strangers, key=worth)
        missed_least.drop()
        self._guests.remove(missed_least)
        return True

    async def _connect(
        self, runner: "web.AppRunner", connection: socket.socket, guest: _Guest
    ) -> None:
        assert runner.server is not None
        loop = asyncio.get_running_loop()
        try:
            async with asyncio.timeout(CONNECTION_TIMEOUT):
                await _first_byte(connection)
            guest.spoke = True
            tls = self._certificate.context() if self._certificate else None
            _, guest.handler = await loop.connect_accepted_socket(
                runner.server,
                connection,
                ssl=tls,
                ssl_handshake_timeout=CONNECTION_TIMEOUT if tls else None,
            )
        except (OSError, TimeoutError):  # no TLS, or none in time
            connection.close()
        except asyncio.CancelledError:
            connection.close()
            raise


async def _first_byte(connection: socket.socket) -> None:
    """Wait until a byte has come, which is left where it is; `OSError` if none ever
    will."""
    loop = asyncio.get_running_loop()
    connection.setblocking(False)
    came = loop.create_future()

    def note() -> None:
        if not came.done():
            came.set_result(None)

    try:
        loop.add_reader(connection, note)
    except NotImplementedError:  # the event loop of Windows cannot wait for this
        return
    try:
        await came
    finally:
        loop.remove_reader(connection)
    if not connection.recv(1, socket.MSG_PEEK):
        raise ConnectionResetError("closed before it sent anything")


class FloodGate:
    """Counts what a page sends, as a bucket that empties at ``rate`` a second and holds
    one second of it.

    >>> gate = FloodGate(10.0)
    >>> [gate.overflows(4, now=time) for time in (0.0, 0.0, 0.0, 1.0)]
    [False, False, True, False]
    """

    def __init__(self, rate: float) -> None:
        self._rate = rate
        self._level = 0.0
        self._time = 0.0

    def overflows(self, amount: float = 1.0, *, now: float | None = None) -> bool:
        """Add an amount; true if that is too much."""
        now = time.monotonic() if now is None else now
        self._level = max(0.0, self._level - self._rate * (now - self._time)) + amount
        self._time = now
        return self._level > self._rate


class Turns:
    """Has what comes from other machines taken in turn, so that all of it together
    takes a bounded share of the process, and this machine's own pages find the rest.

    What waits is not read, so the network holds back whoever sends more.

    >>> turns = Turns()
    >>> [round(turns.wait(0.04, now=9.0), 2) for _ in range(4)]
    [0.0, 0.0, 0.02, 0.06]
    """

    def __init__(self) -> None:
        self._taken = 0.0

    def wait(self, cost: float, *, now: float | None = None) -> float:
        """Return for how many seconds something must wait that costs this many; what
        comes after `TURNS_AT_ONCE` s without anything does not wait."""
        now = time.monotonic() if now is None else now
        self._taken = max(self._taken, now - TURNS_AT_ONCE) + cost
        return max(0.0, self._taken - now)

    async def take(self, cost: float, transport: asyncio.Transport | None) -> None:
        """Wait for the turn of what came by a connection, which is not read
        meanwhile."""
        wait = self.wait(cost)
        if not wait or transport is None or transport.is_closing():
            return
        reads = transport.is_reading()  # unless the server itself has had enough
        if reads:
            transport.pause_reading()
        await asyncio.sleep(wait)
        if reads and not transport.is_closing():
            transport.resume_reading()


async def messages_of(
    view: "web.WebSocketResponse",
    *,
    rate: float,
    code: int,
    reason: str,
    turns: tuple[Turns, asyncio.Transport | None] | None = None,
) -> AsyncIterator["WSMessage"]:
    """Yield what a page sends until it leaves, or sends more than ``rate`` messages a
    second and is closed with a code and its reason; with ``turns`` and the page's
    connection, each message in its turn.

    The view is made with ``autoping=False``, or aiohttp would answer pings in any
    number by itself, and raise where their sender has left.
    """
    from aiohttp import WSMsgType

    gate = FloodGate(rate)
    async for message in view:
        if turns is not None:
            asks = message.type is WSMsgType.TEXT and message.data != "ok"
            shared, transport = turns
            await shared.take(REQUEST_COST if asks else MESSAGE_COST, transport)
        if gate.overflows():
            await view.close(code=code, message=reason.encode())
            return
        if message.type is WSMsgType.PING:
            try:
                await view.pong(message.data)
            except ConnectionError:
                return
        elif message.type is not WSMsgType.PONG:
            yield message


class _Counted(logging.Filter):
    """Passes the first of equal messages, then the 10th, the 100th and so on; bytes
    that are no HTTP not at all."""

    def __init__(self) -> None:
        super().__init__()
        self._counts: Counter[str] = Counter()

    def filter(self, record: logging.LogRecord) -> bool:
        from aiohttp.http_exceptions import HttpProcessingError

        error = record.exc_info[1] if record.exc_info else None
        if isinstance(error, HttpProcessingError):  # anybody's; answered with 400
            return False
        key = f"{record.msg} {type(error).__name__}"
        self._counts[key] += 1
        count = self._counts[key]
        if count > 1:
            record.msg = f"{record.msg} ({count} times until now)"
        return str(count).strip("0") == "1"


_LOG = logging.getLogger("tactophone.web")
_LOG.addFilter(_Counted())

RUNNER: dict[str, Any] = {
    "access_log": None,
    "logger": _LOG,
    "shutdown_timeout": 0.5,
    "keepalive_timeout": CONNECTION_TIMEOUT,
    "lingering_time": 0,
}
"""Options of the web server. Its keep-alive time begins with the connection, before any
request."""
