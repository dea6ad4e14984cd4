"""``--dashboard``, ``--lan`` and ``--https``: the page of a run, and its record
button."""

import argparse
import atexit
import html
import itertools
import os
import signal
import socket
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.app.runs import PageRecorder
from tactophone.cli import options, output
from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings

# Only --dashboard needs these, with a web server's libraries and processes.
if TYPE_CHECKING:
    from tactophone.app.playback import PlayableRecording
    from tactophone.faces.web.server import Page


def add_dashboard(parser: argparse.ArgumentParser, verb: str = "") -> None:
    """Add ``--dashboard``, and for a verb without other settings ``--lan`` and
    ``--https``."""
    words = "serve a page that shows the run, and print its address"
    parser.add_argument("--dashboard", action="store_true", help=words)
    for name in options.flags_of(verb):
        if name.startswith("page."):
            options.add_flag(parser, name)


def wanted(args: argparse.Namespace, settings: Settings) -> bool:
    """Return whether a page is asked for, by ``--dashboard`` or by any setting of a
    page but `open`, which is for the verbs that are pages."""
    usual = Settings().page
    return bool(args.dashboard or replace(settings.page, open=usual.open) != usual)


@contextmanager
def shown(
    settings: Settings,
    name: str,
    *,
    page: bool = True,
    microphone: Connection | None = None,
    live: bool = True,
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
    with (
        recorder,
        watch(
            name, microphone=microphone, recorder=record, **place(settings)
        ) as served,
    ):
        announce(served)
        yield


def play_on_page(
    settings: Settings, takes: "Sequence[PlayableRecording]", *, name: str
) -> None:
    """Play takes on the page over and over until interrupted."""
    from tactophone.app.playback import play
    from tactophone.live.telemetry.writer import Telemetry

    name = settings.process.name or name
    # The process ends in order, so that the shared memory is removed.
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    # As to any run that vibrates, `tactophone stop` sends a signal with its request.
    if hasattr(signal, "SIGUSR1"):
        signal.signal(signal.SIGUSR1, lambda *_: _ask_to_stop(name))
    with (
        Telemetry(name, fingers=len(takes[0].paths)) as telemetry,
        shown(settings, name, live=False),
    ):
        output.log().print("playing back on the page until Ctrl-C")
        for take in itertools.cycle(takes):
            position: float | None = 0.0
            while position is not None:
                position = play(take, telemetry, position)


def _ask_to_stop(name: str) -> None:
    from tactophone.live.telemetry.watcher import Watcher

    if watcher := Watcher.find(name):
        watcher.ask("stop")


def place(settings: Settings) -> dict[str, Any]:
    """Return where and how the page is served, as arguments of
    `tactophone.faces.web.server.Page`.

    Raises `TactophoneError` if there is no network, or no certificate.
    """
    page = settings.page
    if not page.lan:
        return {"address": page.address or None, "certificate": _certificate(settings)}
    if page.address:
        raise ConfigError(
            "--lan and page.address both choose the address: give one of them"
        )
    from tactophone.faces.web.server import network_address

    name = socket.gethostname().lower()
    # The second name is found by multicast DNS.
    names = (name, name if name.endswith(".local") else f"{name}.local")
    return {
        "address": f"{network_address()}:0",
        "certificate": _certificate(settings),
        "names": names,
    }


WHO_HAS_THE_ADDRESS = (
    "Whoever has the address sees this run, feels it, and can stop, mute and weaken "
    "it; only a page on this machine arms it."
)
"""What an address of a run's page is worth."""

NO_PAGE = (
    "the page's process has died: a run goes on, and the space bar here and "
    "`tactophone stop` stop it; start again for a page"
)

NOTHING_IS_SENT = "The page listens on the device that opens it, and sends nothing."
"""The same for the page that listens."""


def _has_screen() -> bool:
    """Return whether a person sits at this machine's screen.

    Over SSH a browser would open far from the person, or, where it is one for text,
    take the terminal; a service has no screen at all.
    """
    if any(name in os.environ for name in ("SSH_CONNECTION", "SSH_TTY")):
        return False
    if sys.platform in ("win32", "darwin"):
        return True
    return any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))


def _open(address: str) -> bool:
    """Open an address in a browser; return false if there is none.

    The address holds the page's token, and every user of this machine sees with which
    words a program was started. So the browser is given a file that only this user may
    read, which leads to the address. It lies in the home folder, as a browser in a
    sandbox sees no other, and is removed when this process ends.
    """
    handle, name = tempfile.mkstemp(".html", "tactophone-", _folder_of_browsers())
    atexit.register(Path(name).unlink, missing_ok=True)
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        file.write(_REDIRECT.format(address=html.escape(address)))
    return webbrowser.open(Path(name).as_uri())


_REDIRECT = (
    '<!doctype html><meta charset="utf-8"><title>Tactophone</title>'
    '<meta http-equiv="refresh" content="0; url={address}">'
    '<a href="{address}">Open the page</a>\n'
)


def _folder_of_browsers() -> Path | None:
    """Return the home folder if a file can be written there; else ``None``, which
    stands for the system's temporary folder."""
    try:
        home = Path.home()
    except RuntimeError:  # a user without a home
        return None
    return home if os.access(home, os.W_OK) else None


def announce(
    page: "Page",
    path: str = "",
    *,
    browser: bool = False,
    words: str = WHO_HAS_THE_ADDRESS,
) -> None:
    """Print the page's address, and open it in a ``browser`` if it is for this machine
    alone, which has a screen.

    If other machines can reach it, also print a QR code and, in ``words``, who can do
    what with it.
    """
    address = f"{page.url}{path}"
    output.note(f"page: {address}")
    threading.Thread(target=_warn_if_dead, args=(page,), daemon=True).start()
    if page.access.private:
        if browser and _has_screen() and not _open(address):
            output.note("no browser could be opened here: open the address in one")
        return
    # Black on white in any terminal: not every camera reads an inverted code.
    output.log().print(qr_code(address), style="black on white", end="", soft_wrap=True)
    output.note(
        "A phone in the same network scans the code, or opens the address above. "
        + words
    )
    if page.access.scheme == "http":
        output.note(
            "The page's traffic, its token too, can be read on the network: use a "
            "trusted one, or --https. Without --https a phone has neither sound nor "
            "microphone there, only vibration."
        )


def _warn_if_dead(page: "Page") -> None:
    if page.wait_for_death():
        output.warn(NO_PAGE)


def qr_code(text: str) -> str:
    """Return a QR code in half blocks, two rows a line; a line of words where the
    library is missing."""
    try:
        import segno
    except ModuleNotFoundError:
        return "no QR code: pip install 'tactophone[dashboard]'\n"
    matrix = [
        [bool(module) for module in row]
        for row in segno.make(text, error="l").matrix_iter(border=2)
    ]
    rows = [*matrix, *([[False] * len(matrix[0])] if len(matrix) % 2 else [])]
    blocks = {
        (False, False): " ",
        (False, True): "▄",
        (True, False): "▀",
        (True, True): "█",
    }
    lines = zip(rows[::2], rows[1::2], strict=True)
    return "".join(
        "".join(blocks[pair] for pair in zip(*line, strict=True)) + "\n"
        for line in lines
    )


ENDS_SOON = timedelta(days=30)
"""Time before the end of a page's certificate from which it is named: longer than a
run."""

PAGE_FOLDER = "page"
"""Folder, beside a machine's identity, of the certificate that is for pages alone."""


def _make_certificate(folder: Path) -> None:
    """Make a certificate for the pages of this machine, which says its name."""
    from tactophone.net.link.identity import Identity

    try:
        Identity.create(socket.gethostname()[:64]).save(folder)
    except OSError as error:
        raise ConfigError(
            f"cannot write a certificate to {folder} ({error.strerror}): leave --https "
            "out, or name a folder with --set link.identity=FOLDER"
        ) from error
    output.note(f"made a certificate for this machine's pages: {folder}")


def _certificate(settings: Settings) -> tuple[Path, Path] | None:
    """Return the files of certificate and key, and print the fingerprint to compare;
    none without ``--https``.

    A machine without an identity gets a certificate for its pages alone: no peer ever
    pins it.
    """
    if not settings.page.https:
        return None
    from tactophone.net.link.identity import (
        CERTIFICATE_FILE,
        KEY_FILE,
        Identity,
        identity_folder,
    )

    folder = identity_folder(settings.link.identity)
    if not settings.link.identity and not (folder / KEY_FILE).exists():
        folder = folder / PAGE_FOLDER
        if not (folder / KEY_FILE).exists():
            _make_certificate(folder)
    identity = Identity.load(folder)
    output.note(f"certificate (SHA-256): {identity.fingerprint}")
    left = identity.certificate.not_valid_after_utc - datetime.now(UTC)
    if left < ENDS_SOON:
        when = identity.certificate.not_valid_after_utc.date()
        output.note(
            f"That certificate ends on {when}, and browsers refuse it from then on: "
            f"put another and its key in {folder}; a page that is open takes it up"
        )
    output.note(
        "Your browser will call this certificate untrusted. Check that the fingerprint "
        "matches, then continue."
    )
    return folder / CERTIFICATE_FILE, folder / KEY_FILE
