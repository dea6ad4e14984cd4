"""How long a viewer of a run's page waits while strangers crowd its port.

``python benchmarks/strangers.py [--seconds 10] [--connections 900] [--https]`` serves
the page of a run on loopback, opens silent connections to it as fast as it can, and
prints the median and the worst time from a request to its answer.
"""

import argparse
import http.client
import os
import socket
import ssl
import statistics
import subprocess
import tempfile
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import urlsplit

from tactophone.faces.web.server import Page, watch
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.writer import Telemetry

ANSWER_TIMEOUT = 3.0
"""Seconds after which a viewer gives up and asks anew."""

PAUSE = 0.1
"""Seconds between two visits of a viewer."""


class Crowd:
    """Opens silent connections to a port, and opens again what the server closes."""

    def __init__(self, port: int, number: int = 900, *, first: bytes = b"") -> None:
        self.opened = 0
        self._port = port
        self._number = number
        self._first = first
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._press)

    def __enter__(self) -> "Crowd":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _press(self) -> None:
        with ExitStack() as stack:
            while not self._ended.is_set():
                sockets: list[socket.socket] = []
                while len(sockets) < self._number and not self._ended.is_set():
                    with suppress(OSError):
                        opened = socket.create_connection(("127.0.0.1", self._port))
                        sockets.append(stack.enter_context(opened))
                        opened.sendall(self._first)
                        self.opened += 1
                for each in sockets:
                    each.close()


def visit(page: Page, *, attempts: int = 100) -> float:
    """Fetch the page, again and again until it comes; returns the seconds that took.

    Raises `TimeoutError` after ``attempts``, which wait for `ANSWER_TIMEOUT` each.
    """
    begin = time.monotonic()
    address = urlsplit(page.url)
    for _ in range(attempts):
        with suppress(OSError, http.client.HTTPException):
            connection = _connection(page, address.port)
            connection.request("GET", address.path)
            if connection.getresponse().status == http.client.OK:
                return time.monotonic() - begin
    raise TimeoutError(f"no answer to {attempts} requests")


def _connection(page: Page, port: int | None) -> http.client.HTTPConnection:
    if page.access.scheme != "https":
        return http.client.HTTPConnection("127.0.0.1", port, timeout=ANSWER_TIMEOUT)
    context = ssl._create_unverified_context()
    return http.client.HTTPSConnection(
        "127.0.0.1", port, timeout=ANSWER_TIMEOUT, context=context
    )


def make_certificate(folder: Path) -> tuple[Path, Path]:
    """Make a certificate that nobody trusts; returns it and its key."""
    key = folder / "key.pem"
    own = folder / "own.pem"
    command = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=x",
    ]
    subprocess.run(
        [*command, "-keyout", key, "-out", own], check=True, capture_output=True
    )
    return own, key


def main() -> None:
    """Serve a page, crowd it, visit it, and print how long the visits took."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--seconds", type=float, default=10.0, help="of visiting (default: 10)"
    )
    parser.add_argument(
        "--connections", type=int, default=900, help="of strangers (default: 900)"
    )
    parser.add_argument("--https", action="store_true", help="serve the page encrypted")
    args = parser.parse_args()
    name = f"strangers-{os.getpid()}"
    with tempfile.TemporaryDirectory() as folder, Telemetry(name) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        certificate = make_certificate(Path(folder)) if args.https else None
        with watch(name, certificate=certificate) as page:
            port = urlsplit(page.url).port
            assert port
            alone = visit(page)
            delays = []
            with Crowd(port, args.connections) as crowd:
                end = time.monotonic() + args.seconds
                while time.monotonic() < end:
                    time.sleep(PAUSE)
                    delays.append(visit(page))
    print("| viewer | until the page has come |")
    print("|---|--:|")
    print(f"| alone | {1000 * alone:.0f} ms |")
    print(f"| median beside the crowd | {1000 * statistics.median(delays):.0f} ms |")
    print(f"| worst of {len(delays)} visits | {1000 * max(delays):.0f} ms |")
    print(f"\nThe crowd opened {crowd.opened} connections.")


if __name__ == "__main__":
    main()
