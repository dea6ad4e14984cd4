"""``--dashboard``, ``--lan`` and ``--https``: the page of every verb with a run to show."""

import argparse
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli._support import terminal
from tactophone.errors import ConfigError

if TYPE_CHECKING:
    from tactophone.pages import Page


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add ``--dashboard`` and its address."""
    group = parser.add_argument_group("page")
    group.add_argument(
        "--dashboard",
        action="store_true",
        help="serve a page that shows the run, and print its address; the options below imply it",
    )
    add_address(group)


def add_address(group: "argparse._ActionsContainer") -> None:
    """Add the address of a page."""
    group.add_argument(
        "--dashboard-address",
        metavar="HOST:PORT",
        help="address of the page; port 0 is any free port (default: 127.0.0.1:0, this machine only)",
    )
    group.add_argument(
        "--lan", action="store_true", help="serve the page to the local network too, and print a QR code for a phone"
    )
    group.add_argument(
        "--https",
        action="store_true",
        help="serve the page encrypted, with the certificate of `tactophone pair init`; "
        "a phone needs it for sound and microphone",
    )


def wanted(args: argparse.Namespace) -> bool:
    """Return whether a page is asked for, by ``--dashboard`` or by any option of a page."""
    return bool(args.dashboard or args.lan or args.https or args.dashboard_address)


@contextmanager
def shown(
    args: argparse.Namespace, name: str, *, microphone: Connection | None = None, live: bool = True
) -> Iterator[None]:
    """Serve the page of a run by its name within the context, if one is `wanted`.

    A page on this machine may record a ``live`` run, to a file in the current folder.
    """
    if not wanted(args):
        yield
        return
    # For this option alone: they import a web server's libraries, and processes.
    from tactophone.cli._support.page_recorder import PageRecorder
    from tactophone.pages import watch

    recorder = PageRecorder(name, Path(), report=terminal.note)
    with recorder, watch(name, microphone=microphone, recorder=recorder.page if live else None, **place(args)) as page:
        announce(page)
        yield


def place(args: argparse.Namespace) -> dict[str, Any]:
    """Return where and how the page is served, as arguments of `tactophone.pages.Page`.

    Raises `TactophoneError` if there is no network, or no certificate.
    """
    if not args.lan:
        return {"address": args.dashboard_address, "certificate": _certificate(args)}
    if args.dashboard_address:
        raise ConfigError("--lan and --dashboard-address both choose the address: give one of them")
    from tactophone.pages import network_address

    name = socket.gethostname().lower()
    names = (name, name if name.endswith(".local") else f"{name}.local")  # the second by multicast DNS
    return {"address": f"{network_address()}:0", "certificate": _certificate(args), "names": names}


def announce(page: "Page", path: str = "") -> None:
    """Print the page's address; if other machines can reach it, also a QR code and who can see it."""
    address = f"{page.url}{path}"
    terminal.note(f"page: {address}")
    if page.private:
        return
    # Black on white in any terminal: not every camera reads an inverted code.
    terminal.log().print(qr_code(address), style="black on white", end="", soft_wrap=True)
    terminal.note(
        "A phone in the same network scans the code, or opens the address above. Whoever has the address sees this "
        "run, feels it, and can stop, mute and weaken it; only a page on this machine arms it."
    )
    if not page.secure:
        terminal.note(
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


def _certificate(args: argparse.Namespace) -> tuple[Path, Path] | None:
    """Return the files of certificate and key, and print the fingerprint to compare; none without ``--https``."""
    if not args.https:
        return None
    from tactophone.link import CERTIFICATE_FILE, IDENTITY_FOLDER, KEY_FILE, Identity

    folder = Path(vars(args).get("link.identity") or IDENTITY_FOLDER).expanduser()
    fingerprint = Identity.load(folder).fingerprint
    terminal.note(f"certificate (SHA-256): {fingerprint}")
    terminal.note("The browser warns that nobody vouches for this certificate: compare its fingerprint, then go on.")
    return folder / CERTIFICATE_FILE, folder / KEY_FILE
