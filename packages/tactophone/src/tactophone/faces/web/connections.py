"""Connections of a web server from strangers: accepted in bounded number, so that
silent ones keep nobody away.

asyncio's own server accepts until the process has no descriptors left, and logs a
traceback for each failure.
"""

import asyncio
import logging
import socket
import ssl
import time
from collections import Counter
from typing import TYPE_CHECKING, Any

from tactophone.core.errors import ConfigError

if TYPE_CHECKING:
    from aiohttp import web

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


class Acceptor:
    """Accepts the connections of a web server.

    When there are `MOST`, the oldest goes that has shown no token; when all have, the
    new one.

    - ``known``: of the server's connections (``request.protocol``) those that have shown the token; the server adds
      them.
    """

    def __init__(self, tls: ssl.SSLContext | None = None) -> None:
        self.known: set[Any] = set()
        self._tls = tls
        # In order of age. Each task makes the TLS handshake; its result is the server's
        # end of the connection.
        self._open: list[asyncio.Task[Any]] = []

    async def serve(self, runner: "web.AppRunner", listener: socket.socket) -> None:
        loop = asyncio.get_running_loop()
        listener.setblocking(False)
        if hasattr(
            socket, "TCP_DEFER_ACCEPT"
        ):  # Linux then holds a connection until its first byte
            listener.setsockopt(
                socket.IPPROTO_TCP, socket.TCP_DEFER_ACCEPT, round(CONNECTION_TIMEOUT)
            )
        while True:
            try:
                connection, _ = await loop.sock_accept(listener)
            except (
                OSError
            ):  # no descriptor is left: something else in this process has taken them
                self._drop_oldest()
                await asyncio.sleep(0.1)
                continue
            if len(self._open) >= MOST:
                self._open = [task for task in self._open if _lasts(task)]
                self.known = {
                    handler for handler in self.known if handler.transport is not None
                }
            if len(self._open) >= MOST and not self._drop_oldest():
                connection.close()
            else:
                self._open.append(
                    asyncio.create_task(self._connect(runner, connection))
                )
            await asyncio.sleep(0)  # the others' turn, also while more are waiting

    def _drop_oldest(self) -> bool:
        for task in self._open:
            handler = task.result() if task.done() and not task.cancelled() else None
            if handler is None or handler not in self.known:
                task.cancel()
                if handler is not None and handler.transport is not None:
                    handler.transport.abort()
                self._open.remove(task)
                return True
        return False

    async def _connect(self, runner: "web.AppRunner", connection: socket.socket) -> Any:
        assert runner.server is not None
        try:
            _, handler = await asyncio.get_running_loop().connect_accepted_socket(
                runner.server,
                connection,
                ssl=self._tls,
                ssl_handshake_timeout=CONNECTION_TIMEOUT if self._tls else None,
            )
        except OSError:  # no TLS, or none in time
            return None
        return handler


def _lasts(task: "asyncio.Task[Any]") -> bool:
    if not task.done():
        return True
    handler = None if task.cancelled() else task.result()
    return handler is not None and handler.transport is not None


class FloodGate:
    """Counts what a page sends, as a bucket that empties at ``rate`` a second and holds
    one second of it.

    >>> gate = FloodGate(10.0)
    >>> [gate.overflows(4, now=0.0), gate.overflows(4, now=0.0), gate.overflows(4, now=0.0), gate.overflows(4, now=1.0)]
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
