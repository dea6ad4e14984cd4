"""``--dashboard``, ``--lan`` and ``--https``: the page of a run, and its record button."""

import argparse
import socket
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from tactophone.app import runs
from tactophone.cli import options, output
from tactophone.core.errors import ConfigError, TactophoneError
from tactophone.core.settings import Settings
from tactophone.core.types import ignore

if TYPE_CHECKING:  # what only --dashboard needs: a web server's libraries, and processes
    from tactophone.faces.bridges.process import BridgeProcess
    from tactophone.faces.web.server import Page


def add_dashboard(parser: argparse.ArgumentParser, verb: str = "") -> None:
    """Add ``--dashboard``, and for a verb without other settings ``--lan`` and ``--https``."""
    words = "serve a page that shows the run, and print its address"
    parser.add_argument("--dashboard", action="store_true", help=words)
    for name in options.flags_of(verb):
        if name.startswith("page."):
            options.add_flag(parser, name)


def wanted(args: argparse.Namespace, settings: Settings) -> bool:
    """Return whether a page is asked for, by ``--dashboard`` or by any setting of a page."""
    return bool(args.dashboard or settings.page != Settings().page)


@contextmanager
def shown(
    settings: Settings, name: str, *, page: bool = True, microphone: Connection | None = None, live: bool = True
) -> Iterator[None]:
    """Serve the page of a run by its name within the context, if ``page``.

    A page on this machine may record a ``live`` run, to a file in the current folder.
    """
    if not page:
        yield
        return
    from tactophone.faces.web.server import watch

    recorder = PageRecorder(name, Path(), report=output.note)
    record = recorder.page if live else None
    with recorder, watch(name, microphone=microphone, recorder=record, **place(settings)) as served:
        announce(served, browser=settings.page.open)
        yield


def place(settings: Settings) -> dict[str, Any]:
    """Return where and how the page is served, as arguments of `tactophone.faces.web.server.Page`.

    Raises `TactophoneError` if there is no network, or no certificate.
    """
    page = settings.page
    if not page.lan:
        return {"address": page.address or None, "certificate": _certificate(settings)}
    if page.address:
        raise ConfigError("--lan and page.address both choose the address: give one of them")
    from tactophone.faces.web.server import network_address

    name = socket.gethostname().lower()
    names = (name, name if name.endswith(".local") else f"{name}.local")  # the second by multicast DNS
    return {"address": f"{network_address()}:0", "certificate": _certificate(settings), "names": names}


def announce(page: "Page", path: str = "", *, browser: bool = False) -> None:
    """Print the page's address, and open it here in a ``browser``.

    If other machines can reach it, also print a QR code and who can see it.
    """
    address = f"{page.url}{path}"
    output.note(f"page: {address}")
    if browser and not webbrowser.open(address):
        output.note("no browser could be opened here: open the address in one")
    if page.access.private:
        return
    # Black on white in any terminal: not every camera reads an inverted code.
    output.log().print(qr_code(address), style="black on white", end="", soft_wrap=True)
    output.note(
        "A phone in the same network scans the code, or opens the address above. Whoever has the address sees this "
        "run, feels it, and can stop, mute and weaken it; only a page on this machine arms it."
    )
    if page.access.scheme == "http":
        output.note(
            "The page's traffic, its token too, can be read on the network: use a trusted one, or --https. "
            "Without --https a phone has neither sound nor microphone there, only vibration."
        )


def qr_code(text: str) -> str:
    """Return a QR code in half blocks, two rows a line; a line of words where the library is missing."""
    try:
        import segno
    except ModuleNotFoundError:
        return "no QR code: pip install 'tactophone[dashboard]'\n"
    matrix = [[bool(module) for module in row] for row in segno.make(text, error="l").matrix_iter(border=2)]
    rows = [*matrix, *([[False] * len(matrix[0])] if len(matrix) % 2 else [])]
    blocks = {(False, False): " ", (False, True): "▄", (True, False): "▀", (True, True): "█"}
    lines = zip(rows[::2], rows[1::2], strict=True)
    return "".join("".join(blocks[pair] for pair in zip(*line, strict=True)) + "\n" for line in lines)


def _certificate(settings: Settings) -> tuple[Path, Path] | None:
    """Return the files of certificate and key, and print the fingerprint to compare; none without ``--https``."""
    if not settings.page.https:
        return None
    from tactophone.net.link.identity import CERTIFICATE_FILE, IDENTITY_FOLDER, KEY_FILE, Identity

    folder = Path(settings.link.identity or IDENTITY_FOLDER).expanduser()
    fingerprint = Identity.load(folder).fingerprint
    output.note(f"certificate (SHA-256): {fingerprint}")
    output.note("Your browser will call this certificate untrusted. Check that the fingerprint matches, then continue.")
    return folder / CERTIFICATE_FILE, folder / KEY_FILE


class PageRecorder:
    """Obeys the page's process, and answers it; a context manager that ends a log that is still open.

    ``report`` is called with a line when a log begins, ends, or fails, from another thread.

    - ``page``: the page's end: it sends true to begin and false to end, and receives what a page shows.
    """

    def __init__(self, name: str, folder: Path, *, report: Callable[[str], None] = ignore) -> None:
        self._name, self._folder, self._report = name, folder, report
        self._orders, self.page = Pipe()
        self._log: BridgeProcess | None = None
        self._path = folder
        self._thread = threading.Thread(target=self._follow, name="page-recorder", daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.page.close()
        self._thread.join()
        self._end()

    def _follow(self) -> None:
        while (order := _receive(self._orders)) is not None:
            try:
                if order and self._log is None:
                    self._begin()
                elif not order:
                    self._end()
                self._answer({"recording": str(self._path) if self._log else ""})
            except TactophoneError as error:
                self._answer({"refused": str(error)})

    def _begin(self) -> None:
        from tactophone.faces.bridges.process import BridgeProcess

        self._path = (self._folder / f"{self._name}-{time.strftime('%Y%m%d-%H%M%S')}.mcap").absolute()
        log = BridgeProcess(runs.log_of(self._name, self._path), report=self._fail)
        log.__enter__()
        self._log = log
        self._report(f"recording to {self._path}")

    def _end(self) -> None:
        log, self._log = self._log, None
        if log is not None:
            log.__exit__()
            self._report(f"recorded: {self._path}")

    def _fail(self, line: str) -> None:
        """Pass on why the log ended by itself, from its thread: a full disk."""
        self._report(line)
        self._answer({"recording": "", "refused": line})

    def _answer(self, words: dict[str, Any]) -> None:
        try:
            self._orders.send(words)
        except OSError:  # the page has ended; the run goes on
            return


def _receive(orders: Connection) -> bool | None:
    try:
        return bool(orders.recv())
    except (EOFError, OSError):
        return None
