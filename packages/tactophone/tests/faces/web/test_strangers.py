"""Strangers without the token: they keep no viewer away and fill no disk."""

import http.client
import itertools
import socket
import ssl
import subprocess
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from tactophone.faces.web.connections import MOST
from tactophone.faces.web.server import Page, watch
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

SECONDS = 2.0


class Crowd:
    """Opens silent connections to a port, and opens again what the server closes."""

    def __init__(self, port: int, number: int = 900, *, first: bytes = b"") -> None:
        self.opened = 0
        self._port, self._number, self._first = port, number, first
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
                sockets = []
                while len(sockets) < self._number and not self._ended.is_set():
                    with suppress(OSError):
                        sockets.append(
                            stack.enter_context(
                                socket.create_connection(("127.0.0.1", self._port))
                            )
                        )
                        sockets[-1].sendall(self._first)
                        self.opened += 1
                for each in sockets:
                    each.close()


def _first_answer(page: Page) -> int:
    """Return with which of its connections a viewer has the page."""
    address = urlsplit(page.url)
    for tries in itertools.count(1):
        with suppress(OSError, http.client.HTTPException):
            if page.access.scheme == "https":
                context = ssl._create_unverified_context()
                connection: http.client.HTTPConnection = http.client.HTTPSConnection(
                    "127.0.0.1", address.port, timeout=30, context=context
                )
            else:
                connection = http.client.HTTPConnection(
                    "127.0.0.1", address.port, timeout=30
                )
            connection.request("GET", address.path)
            assert connection.getresponse().status == 200
            return tries
    raise AssertionError


@pytest.fixture
def certificate(tmp_path: Path) -> tuple[Path, Path]:
    key, own = tmp_path / "key.pem", tmp_path / "own.pem"
    command = "openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=x"
    files = ["-keyout", str(key), "-out", str(own)]
    subprocess.run([*command.split(), *files], check=True, capture_output=True)
    return own, key


@pytest.mark.parametrize("secure", [False, True], ids=["http", "https"])
def test_a_viewer_gets_in_beside_a_crowd_of_silent_connections_and_nothing_is_printed(
    run: Run,
    certificate: tuple[Path, Path],
    capfd: pytest.CaptureFixture[str],
    secure: bool,
) -> None:
    with watch(run.telemetry.name, certificate=certificate if secure else None) as page:
        port = urlsplit(page.url).port
        assert port
        _first_answer(page)
        tries = []
        with Crowd(port) as crowd:
            end = time.monotonic() + SECONDS
            while time.monotonic() < end:
                time.sleep(0.1)
                tries.append(_first_answer(page))
        assert crowd.opened > 5 * MOST
        # No connection of a viewer was dropped for one of the crowd.
        assert max(tries) == 1
    assert len(capfd.readouterr().err) < 1000


MALFORMED = {
    "two hosts": b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
    "connect": b"CONNECT a:443 HTTP/1.1\r\nHost: a\r\n\r\n",
    "a header of 100 kB": b"GET / HTTP/1.1\r\nHost: a\r\nX: "
    + bytes(100_000).replace(b"\0", b"x")
    + b"\r\n\r\n",
    "two lengths": b"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\n"
    b"Transfer-Encoding: chunked\r\n\r\n0\r\n\r\n",
}


@pytest.mark.parametrize("request_", MALFORMED.values(), ids=MALFORMED)
def test_malformed_requests_are_refused_without_a_traceback(
    page: Page, capfd: pytest.CaptureFixture[str], request_: bytes
) -> None:
    with socket.create_connection(
        ("127.0.0.1", urlsplit(page.url).port or 0), timeout=5
    ) as connection:
        connection.sendall(request_)
        with suppress(ConnectionResetError):
            assert connection.recv(100).split()[1] in (b"400", b"403")
    assert "Traceback" not in capfd.readouterr().err
