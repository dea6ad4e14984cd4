"""Strangers without the token: they keep no viewer away and fill no disk."""

import socket
from contextlib import suppress
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from benchmarks.strangers import Crowd, make_certificate, visit
from tactophone.faces.web.connections import MOST
from tactophone.faces.web.server import Page, watch
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

VISITS = 5
"""Times that the viewer comes; how long each takes, `benchmarks/strangers.py`
measures."""


@pytest.fixture
def certificate(tmp_path: Path) -> tuple[Path, Path]:
    return make_certificate(tmp_path)


@pytest.mark.timed
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
        visit(page)
        with Crowd(port) as crowd:
            visits = 0
            while visits < VISITS or crowd.opened <= 5 * MOST:
                visit(page)
                visits += 1
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


def test_malformed_requests_are_refused_without_a_traceback(
    page: Page, capfd: pytest.CaptureFixture[str]
) -> None:
    visit(page)  # until the page's process serves
    for name, request in MALFORMED.items():
        with socket.create_connection(
            ("127.0.0.1", urlsplit(page.url).port or 0), timeout=5
        ) as connection:
            connection.sendall(request)
            with suppress(ConnectionResetError):
                assert connection.recv(100).split()[1] in (b"400", b"403"), name
    assert "Traceback" not in capfd.readouterr().err
