"""A page in its own process, so that it cannot disturb the sound."""

import asyncio
import importlib.util
import socket
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.core.errors import TactophoneError
from tactophone.core.processes import Child, Parent
from tactophone.faces.web.connections import RUNNER, Acceptor, Certificate, listen
from tactophone.faces.web.security import AccessControl

if TYPE_CHECKING:
    from aiohttp import web

PAGE_ADDRESS = "127.0.0.1:0"
"""Default address of a page: only this machine, any free port."""

PAGE_NICENESS = 5
"""Niceness of the page's process: on a busy machine, the page waits, not the sound."""

LAST_WORDS = 0.5
"""Seconds that the page's process gets to take leave of open pages."""


class Page(AbstractContextManager["Page", None]):
    """A page served by another process while the context lasts: ``with Page(build) as
    page: print(page.url)``.

    - ``build``: makes the application in that process; must be picklable.
    - ``address``: host and port to listen at, port 0 for any free one; `PAGE_ADDRESS`
      if ``None``. An address of the local network is served at this machine's loopback
      address too, where browsers allow a page its microphone.
    - ``certificate``: files of a certificate and its private key, for https; plain http
      if ``None``.
    - ``names``: further names of this machine under which the page may be opened.

    Raises `TactophoneError` when the address is not available, or the web server is not
    installed.
    """

    def __init__(
        self,
        build: "Callable[[], web.Application]",
        address: str | None = None,
        *,
        certificate: tuple[Path, Path] | None = None,
        names: tuple[str, ...] = (),
    ) -> None:
        if importlib.util.find_spec("aiohttp") is None:
            raise TactophoneError(
                "the page needs a web server: pip install 'tactophone[dashboard]'"
            )
        listening = _listen_everywhere(PAGE_ADDRESS if address is None else address)
        host, port = listening[0].getsockname()[:2]
        self.access = AccessControl(
            host, port, scheme="https" if certificate else "http", names=names
        )
        self.url = self.access.url  # to open, with the token
        self._ended = False
        self._child = Child(
            _serve,
            build,
            self.access,
            listening,
            certificate,
            name="tactophone-page",
            niceness=PAGE_NICENESS,
        )
        for listener in listening:
            listener.close()

    def __exit__(self, *_: object) -> None:
        self._ended = True
        # Its open pages are told, so that none takes a page that is lost for an end.
        self._child.ask_to_end()
        self._child.end(LAST_WORDS)

    def wait_for_death(self) -> bool:
        """Wait until the page's process has ended, and return whether it did so by
        itself, while the page was wanted."""
        self._child.how_ended()
        return not self._ended


def watch(
    name: str,
    address: str | None = None,
    *,
    microphone: Connection | None = None,
    recorder: Connection | None = None,
    **place: Any,
) -> Page:
    """Serve the operator's page for the run of that name; ``place`` as in `Page`.

    ``microphone`` takes the sound of a page that listens
    (`live.audio.sources.browser_source` has the other end), and ``recorder`` keeps logs
    when a page on this machine asks for one; without them, no page can.
    """
    return Page(partial(_dashboard, name, microphone, recorder), address, **place)


def serve_guide(orders: Connection) -> Page:
    """Serve the page of a guided command to this machine alone; the command has the
    other end of the pipe."""
    return Page(partial(_guide, orders))


def network_address() -> str:
    """Return this machine's address in its network; raises `TactophoneError` if it has
    none."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            # Connecting a datagram socket sends nothing; it only chooses the interface
            # (RFC 5737: a test address).
            probe.connect(("192.0.2.1", 9))
            address = str(probe.getsockname()[0])
        except OSError:
            address = ""
    if not address or address.startswith("127."):
        raise TactophoneError(
            "--lan: this machine is in no network: join one, or leave --lan out"
        )
    return address


def _dashboard(
    name: str, microphone: Connection | None, recorder: Connection | None
) -> "web.Application":
    from tactophone.faces.web.dashboard import dashboard

    return dashboard(name, microphone, recorder)


def _guide(orders: Connection) -> "web.Application":
    from tactophone.faces.web.guide import guide_page

    return guide_page(orders)


def _listen_everywhere(address: str) -> list[socket.socket]:
    """Listen at an address, and at 127.0.0.1 too if another machine can reach the
    address but this one cannot."""
    sockets = [listen(address, "the page", example=PAGE_ADDRESS)]
    host, port = sockets[0].getsockname()[:2]
    if (
        sockets[0].family == socket.AF_INET
        and host != "0.0.0.0"
        and not host.startswith("127.")
    ):
        # If the port is in use there, the page is not served at 127.0.0.1.
        with suppress(TactophoneError):
            sockets.append(
                listen(f"127.0.0.1:{port}", "the page", example=PAGE_ADDRESS)
            )
    return sockets


def _serve(
    parent: Parent,
    build: "Callable[[], web.Application]",
    access: AccessControl,
    listening: list[socket.socket],
    certificate: tuple[Path, Path] | None,
) -> None:
    shown = Certificate(*certificate) if certificate else None
    asyncio.run(_run(parent, build, access, listening, shown))


async def _run(
    parent: Parent,
    build: "Callable[[], web.Application]",
    access: AccessControl,
    listening: list[socket.socket],
    certificate: Certificate | None,
) -> None:
    from aiohttp import web

    from tactophone.faces.web.views import protect

    acceptor = Acceptor(certificate)
    runner = web.AppRunner(protect(build(), access, acceptor), **RUNNER)
    await runner.setup()
    accepting = [
        asyncio.create_task(acceptor.serve(runner, listener)) for listener in listening
    ]
    ended = asyncio.Event()
    asyncio.get_running_loop().add_reader(parent, ended.set)
    await ended.wait()
    for task in accepting:
        task.cancel()
    await runner.cleanup()
