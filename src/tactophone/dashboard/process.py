"""The page in its own process, so that it cannot disturb the sound."""

import asyncio
import importlib.util
import multiprocessing
import os
import signal
import socket
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Self

from tactophone.dashboard.security import AccessControl
from tactophone.errors import TactophoneError

if TYPE_CHECKING:
    from aiohttp import web

ADDRESS = "127.0.0.1:0"
"""Default address of a page: only this machine, any free port."""

NICENESS = 5
"""Of the page's process: on a busy machine, the page waits, not the sound."""


class Page:
    """A page served by another process while the context lasts: ``with Page(build) as page: print(page.url)``.

    Parameters
    ----------
    build
        Makes the application in that process; must be picklable.
    address
        Host and port to listen at, port 0 for any free one; `ADDRESS` if ``None``.

    Raises
    ------
    TactophoneError
        When the address is not available, or the web server is not installed.
    """

    def __init__(self, build: "Callable[[], web.Application]", address: str | None = None) -> None:
        if importlib.util.find_spec("aiohttp") is None:
            raise TactophoneError("the page needs a web server: pip install 'tactophone[dashboard]'")
        listening = _listen(ADDRESS if address is None else address)
        self._access = AccessControl(*listening.getsockname()[:2])
        # Spawned, not forked: a fork would carry audio threads' locks and files along.
        self._process = multiprocessing.get_context("spawn").Process(
            target=_serve, args=(build, self._access, listening), name="tactophone-page", daemon=True
        )
        self._process.start()
        listening.close()

    @property
    def url(self) -> str:
        """The address to open, with the token."""
        return self._access.url

    @property
    def private(self) -> bool:
        """Whether only this machine can reach the page."""
        return self._access.private

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.join()


def watch(name: str, address: str | None = None) -> Page:
    """Serve the operator's page for the run of that name."""
    return Page(partial(_dashboard, name), address)


def _dashboard(name: str) -> "web.Application":
    from tactophone.dashboard.server import dashboard

    return dashboard(name)


def _listen(address: str) -> socket.socket:
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal():
        raise TactophoneError(f"{address!r} is not an address: write HOST:PORT, such as {ADDRESS}")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, int(port)), family=family)
    except (OSError, OverflowError) as error:
        raise TactophoneError(f"the page cannot listen at {address} ({error}): choose another address") from None


def _serve(build: "Callable[[], web.Application]", access: AccessControl, listening: socket.socket) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    os.nice(NICENESS)
    asyncio.run(_run(build, access, listening))


async def _run(build: "Callable[[], web.Application]", access: AccessControl, listening: socket.socket) -> None:
    from aiohttp import web

    from tactophone.dashboard.server import protect

    runner = web.AppRunner(protect(build(), access), access_log=None, shutdown_timeout=0.5)
    await runner.setup()
    await web.SockSite(runner, listening).start()
    parent = multiprocessing.parent_process()
    ended = asyncio.Event()
    if parent is not None:
        asyncio.get_running_loop().add_reader(parent.sentinel, ended.set)
    await ended.wait()
    await runner.cleanup()
