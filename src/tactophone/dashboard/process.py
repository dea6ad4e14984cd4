"""The page in a process of its own, so that whatever it does, the sound does not notice."""

import asyncio
import importlib.util
import multiprocessing
import os
import signal
import socket
from collections.abc import Callable
from functools import partial
from types import TracebackType
from typing import TYPE_CHECKING, Self

from tactophone.dashboard.security import AccessControl
from tactophone.errors import TactophoneError
from tactophone.game.rounds import Box

if TYPE_CHECKING:
    from aiohttp import web

ADDRESS = "127.0.0.1:0"
"""Where a page listens unless told otherwise: this machine alone, any free port."""

NICENESS = 5
"""Of the page's process: where a machine is short of time, the page is what waits."""


class Page:
    """A page, served by another process for as long as this stands: ``with Page(build) as page: print(page.url)``.

    Parameters
    ----------
    build
        Makes the application, in that process; must be picklable.
    address
        Host and port to listen at; port 0 is any free one.

    Raises
    ------
    TactophoneError
        When the address cannot be had, or the web server is not installed.
    """

    def __init__(self, build: "Callable[[], web.Application]", address: str = ADDRESS) -> None:
        if importlib.util.find_spec("aiohttp") is None:
            raise TactophoneError("the page needs a web server: pip install 'tactophone[dashboard]'")
        listening = _listen(address)
        self._guard = AccessControl(*listening.getsockname()[:2])
        # Spawned, not forked: a fork would carry audio threads' locks and files along.
        self._process = multiprocessing.get_context("spawn").Process(
            target=_serve, args=(build, self._guard, listening), name="tactophone-page", daemon=True
        )
        self._process.start()
        listening.close()

    @property
    def url(self) -> str:
        """The address to open, token and all."""
        return self._guard.url

    @property
    def private(self) -> bool:
        """Whether only this machine can reach it."""
        return self._guard.private

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._process.terminate()
        self._process.join()


def watch(name: str, address: str = ADDRESS) -> Page:
    """Serve the operator's page for the run of that name."""
    return Page(partial(_dashboard, name), address)


def _dashboard(name: str) -> "web.Application":
    from tactophone.dashboard.server import dashboard

    return dashboard(name)


def play(box: Box, address: str = ADDRESS) -> Page:
    """Serve the stone box's page."""
    return Page(partial(_stone_box, box), address)


def _stone_box(box: Box) -> "web.Application":
    from tactophone.game.server import stone_box

    return stone_box(box)


def _listen(address: str) -> socket.socket:
    host, _, port = address.rpartition(":")
    host = host.strip("[]")
    if not host or not port.isdecimal():
        raise TactophoneError(f"{address!r} is no address: wanted HOST:PORT, such as {ADDRESS}")
    try:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        return socket.create_server((host, int(port)), family=family)
    except (OSError, OverflowError) as error:
        raise TactophoneError(f"the page cannot listen at {address} ({error}): choose another address") from None


def _serve(build: "Callable[[], web.Application]", guard: AccessControl, listening: socket.socket) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run ends this process when it ends itself
    os.nice(NICENESS)
    asyncio.run(_run(build, guard, listening))


async def _run(build: "Callable[[], web.Application]", guard: AccessControl, listening: socket.socket) -> None:
    from aiohttp import web

    from tactophone.dashboard.server import guarded

    runner = web.AppRunner(guarded(build(), guard), access_log=None, shutdown_timeout=0.5)
    await runner.setup()
    await web.SockSite(runner, listening).start()
    parent = multiprocessing.parent_process()
    ended = asyncio.Event()
    if parent is not None:
        asyncio.get_running_loop().add_reader(parent.sentinel, ended.set)
    await ended.wait()
    await runner.cleanup()
