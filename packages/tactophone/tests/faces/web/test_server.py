"""The server by its socket: access, messages, and that nothing queues up."""

import asyncio
import contextlib
import http.client
import socket
import time
from urllib.parse import urlsplit

import aiohttp
import pytest
from aiohttp import web
from aiohttp.test_utils import make_mocked_request

from tactophone.faces.web.connections import CONNECTION_TIMEOUT
from tactophone.faces.web.security import HEADERS
from tactophone.faces.web.server import Page
from tactophone.faces.web.views import CREDIT, admit
from tests.faces.web.running import Run
from tests.faces.web.test_message import parse

pytestmark = pytest.mark.realtime


def get(page: Page, path: str, **headers: str) -> tuple[int, dict[str, str], str]:
    """Ask like a browser; ``path`` stands below the token unless it is absolute."""
    address = urlsplit(page.url)
    connection = http.client.HTTPConnection("127.0.0.1", address.port, timeout=10)
    connection.request(
        "GET", path if path.startswith("/") else address.path + path, headers=headers
    )
    response = connection.getresponse()
    return response.status, dict(response.headers), response.read().decode()


@pytest.mark.parametrize(
    "path",
    ["", "static/dashboard.js", "static/style.css", "static/vendor/uPlot.esm.js"],
)
def test_a_token_holder_gets_the_page_under_every_precaution(
    page: Page, path: str
) -> None:
    status, headers, text = get(page, path)
    assert status == 200
    assert text
    assert headers.items() >= HEADERS.items()


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/live",
        "/static/style.css",
        "/wrong/",
        "/wrong/static/style.css",
        "//",
        "/favicon.ico",
    ],
)
def test_a_wrong_token_gets_nothing(page: Page, path: str) -> None:
    status, headers, text = get(page, path)
    assert (status, text) == (403, "Refused: the token is wrong.\n")
    assert headers.items() >= HEADERS.items()


def test_a_rebound_name_gets_nothing_even_with_the_token(page: Page) -> None:
    port = urlsplit(page.url).port
    assert get(page, "", Host=f"rebound.example:{port}")[0] == 403
    assert get(page, "", Host=f"localhost:{port}")[0] == 200


@pytest.mark.parametrize(
    "path", ["static/../server.py", "static/%2e%2e/server.py", "static/", "nonesuch"]
)
def test_there_is_nothing_beside_the_page(page: Page, path: str) -> None:
    assert get(page, path)[0] in (403, 404)


@pytest.mark.parametrize(
    "name",
    ["A" * 3000, "A/" * 3000, "%00", "%ff", "style.css/x", "%2fetc%2fpasswd"],
    ids=["long", "deep", "nul", "no-text", "file-as-folder", "absolute"],
)
def test_names_that_no_file_can_have_are_not_found(
    page: Page, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    assert get(page, f"static/{name}")[0] == 404
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.parametrize("origin", [None, "http://evil.example", "null"])
def test_a_websocket_from_elsewhere_is_refused(page: Page, origin: str | None) -> None:
    async def attempt() -> int:
        async with aiohttp.ClientSession() as session:
            try:
                await session.ws_connect(page.url + "live", origin=origin)
            except aiohttp.WSServerHandshakeError as error:
                return error.status
        return 101

    assert asyncio.run(attempt()) == 403


def test_a_viewer_who_does_not_answer_gets_no_more_and_then_misses_nothing(
    page: Page,
) -> None:
    async def look() -> tuple[int, float]:
        async with aiohttp.ClientSession() as session:
            view = await session.ws_connect(
                page.url + "live", origin=page.url[: page.url.rindex("/", 0, -1)]
            )
            # A viewer on this machine is told what to type next.
            assert "command" in await view.receive_json(timeout=2)
            begin, messages = time.monotonic(), []
            while time.monotonic() - begin < 1.0:
                try:
                    messages.append(await view.receive_bytes(timeout=0.2))
                except TimeoutError:
                    break
            await asyncio.sleep(0.5)
            await view.send_str("ok")
            last = parse(await view.receive_bytes(timeout=2))[1]
            return len(messages), len(last["steps"]) * 0.01

    unanswered, seconds_at_once = asyncio.run(look())
    assert unanswered == CREDIT
    assert seconds_at_once >= 0.5


def test_a_request_out_of_range_is_answered_with_a_reason_and_not_passed_on(
    page: Page, run: Run
) -> None:
    async def ask() -> str:
        async with aiohttp.ClientSession() as session:
            view = await session.ws_connect(
                page.url + "live", origin=page.url[: page.url.rindex("/", 0, -1)]
            )
            await view.receive()
            await view.send_str('{"action": "ceiling", "value": 0.9}')
            async for message in view:
                if message.type is aiohttp.WSMsgType.TEXT:
                    return message.data
                await view.send_str("ok")
        return ""

    assert "never raise it" in asyncio.run(ask())
    assert run.finger.ceiling == 0.5


def test_a_header_that_never_ends_is_cut_off(page: Page) -> None:
    address = urlsplit(page.url)
    assert address.port
    with socket.create_connection(("127.0.0.1", address.port)) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nHost: x\r\n")
        connection.settimeout(2 * CONNECTION_TIMEOUT)
        with contextlib.suppress(ConnectionResetError):
            assert connection.recv(100) == b""


def test_a_request_for_no_path_is_refused_like_any_other(page: Page) -> None:
    address = urlsplit(page.url)
    assert address.port
    with socket.create_connection(("127.0.0.1", address.port)) as connection:
        connection.sendall(
            b"OPTIONS * HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"
        )
        assert connection.recv(100).split()[1] in (b"400", b"403", b"404")


def test_a_page_that_leaves_while_it_connects_leaves_no_traceback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def leave(*_: object) -> None:
        raise aiohttp.ClientConnectionResetError("Cannot write to closing transport")

    monkeypatch.setattr(web.WebSocketResponse, "prepare", leave)
    assert asyncio.run(admit(make_mocked_request("GET", "/live"), (), 1)) is None
