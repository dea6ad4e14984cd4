"""Who keeps a place when more strangers connect than a server holds: counted in
connections, not in seconds."""

import asyncio
import errno
import socket
import ssl
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from aiohttp import web

from tactophone.faces.web.connections import (
    KEPT_PLACES,
    MOST,
    RUNNER,
    Acceptor,
    Certificate,
    listen,
)
from tests.faces.web.test_strangers import certificate

__all__ = ["certificate"]

CROWD = 3 * MOST


class Server:
    """A server that admits whoever asks for ``/token``."""

    def __init__(self, acceptor: Acceptor, port: int) -> None:
        self.acceptor, self.port = acceptor, port

    async def stranger(self, first: bytes = b"", *, host: str = "127.0.0.1"):
        """Connect, and return when the server has accepted."""
        before = self.acceptor.accepted
        reader, writer = await asyncio.open_connection(
            "127.0.0.1", self.port, local_addr=(host, 0)
        )
        writer.write(first)
        while self.acceptor.accepted == before:
            await asyncio.sleep(0)
        # The server's turn to see the first byte.
        for _ in range(20):
            await asyncio.sleep(0)
        return reader, writer


@asynccontextmanager
async def serving(certificate: Certificate | None = None) -> AsyncIterator[Server]:
    acceptor = Acceptor(certificate)

    async def answer(request: web.Request) -> web.Response:
        if request.path == "/token":
            acceptor.admit(request.protocol)
        return web.Response(text="welcome")

    app = web.Application()
    app.router.add_get("/{path:.*}", answer)
    runner = web.AppRunner(app)
    await runner.setup()
    listener = listen("127.0.0.1:0", "the test", example="")
    task = asyncio.create_task(acceptor.serve(runner, listener))
    try:
        yield Server(acceptor, listener.getsockname()[1])
    finally:
        task.cancel()
        with suppress(asyncio.CancelledError):
            await task
        listener.close()
        await runner.cleanup()


def run(work: Callable[[], Awaitable[None]]) -> None:
    async def bounded() -> None:
        async with asyncio.timeout(60):
            await work()

    asyncio.run(bounded())


@pytest.fixture(autouse=True)
def accepted_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the server see silent connections too, which Linux would hold back."""
    monkeypatch.delattr(socket, "TCP_DEFER_ACCEPT", raising=False)


def test_those_who_have_sent_nothing_go_before_a_viewer_in_its_first_request() -> None:
    async def work() -> None:
        async with serving() as server:
            reader, writer = await server.stranger(b"GET / HTTP/1.1\r\n")
            crowd = [await server.stranger() for _ in range(CROWD)]
            writer.write(b"Host: a\r\n\r\n")
            assert (await reader.readline()).split()[1] == b"200"
            for _, other in crowd:
                other.close()

    run(work)


def test_those_who_have_sent_nothing_go_before_a_viewer_in_its_tls_handshake(
    certificate: tuple[Path, Path],
) -> None:
    client_side = ssl._create_unverified_context()

    async def work() -> None:
        async with serving(Certificate(*certificate)) as server:
            incoming, outgoing = ssl.MemoryBIO(), ssl.MemoryBIO()
            tls = client_side.wrap_bio(incoming, outgoing)
            with suppress(ssl.SSLWantReadError):
                tls.do_handshake()
            reader, writer = await server.stranger(outgoing.read())
            crowd = [await server.stranger() for _ in range(CROWD)]
            answer = b""
            requested = False
            while not answer:
                incoming.write(await reader.read(65_536))
                assert incoming.pending, "the server dropped the viewer"
                with suppress(ssl.SSLWantReadError):
                    if not requested:
                        tls.do_handshake()
                        tls.write(b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
                        requested = True
                    answer = tls.read(100)
                writer.write(outgoing.read())
            assert answer.split()[1] == b"200"
            for _, other in crowd:
                other.close()

    run(work)


@pytest.mark.skipif(
    not hasattr(socket, "SO_PEERCRED"), reason="only Linux has the host 127.0.0.2"
)
def test_an_address_that_showed_the_token_keeps_places_among_strangers() -> None:
    async def work() -> None:
        async with serving() as server:
            for path, answered in (("token", True), ("", True)):
                request = f"GET /{path} HTTP/1.1\r\n".encode()
                reader, writer = await server.stranger(request, host="127.0.0.2")
                crowd = (
                    []
                    if path
                    else [await server.stranger(b"GET") for _ in range(CROWD)]
                )
                writer.write(b"Host: a\r\n\r\n")
                line = await reader.readline()
                assert (line.split()[1:2] == [b"200"]) == answered
                for _, other in crowd:
                    other.close()

    run(work)


@pytest.mark.skipif(
    not hasattr(socket, "SO_PEERCRED"), reason="only Linux has the host 127.0.0.2"
)
def test_a_crowd_from_one_address_takes_no_place_of_another() -> None:
    async def work() -> None:
        async with serving() as server:
            reader, writer = await server.stranger(
                b"GET / HTTP/1.1\r\n", host="127.0.0.2"
            )
            crowd = [await server.stranger(b"GET") for _ in range(CROWD)]
            writer.write(b"Host: a\r\n\r\n")
            assert (await reader.readline()).split()[1] == b"200"
            for _, other in crowd:
                other.close()

    run(work)


@pytest.mark.skipif(
    not hasattr(socket, "SO_PEERCRED"), reason="only Linux has the host 127.0.0.2"
)
def test_a_known_address_keeps_its_places_among_strangers_of_one_place_each() -> None:
    """Whoever has many addresses crowds nobody out by having one place at each."""

    async def work() -> None:
        async with serving() as server:
            viewer = "127.0.0.2"
            reader, writer = await server.stranger(
                b"GET /token HTTP/1.1\r\nHost: a\r\nConnection: close\r\n\r\n",
                host=viewer,
            )
            assert (await reader.readline()).split()[1] == b"200"
            own = [
                await server.stranger(b"GET / HTTP/1.1\r\n", host=viewer)
                for _ in range(KEPT_PLACES)
            ]
            crowd = [
                await server.stranger(b"GET", host=f"127.0.1.{place + 1}")
                for place in range(CROWD)
            ]
            for reader, writer in own:
                writer.write(b"Host: a\r\n\r\n")
                assert (await reader.readline()).split()[1:2] == [b"200"]
            for _, other in crowd:
                other.close()

    run(work)


@pytest.mark.skipif(
    not hasattr(socket, "SO_PEERCRED"), reason="only Linux has the host 127.0.0.2"
)
def test_viewers_of_the_network_keep_no_page_of_this_machine_away() -> None:
    """They all have the address, and hold every place."""

    async def work() -> None:
        request = b"GET /token HTTP/1.1\r\nHost: a\r\n\r\n"
        async with serving() as server:
            held = []
            for _ in range(MOST):
                held.append(await server.stranger(request, host="127.0.0.2"))
                assert (await held[-1][0].readline()).split()[1] == b"200"
            own = [await server.stranger() for _ in range(KEPT_PLACES)]
            # They come again, and more of them, before the page has said anything.
            held += [
                await server.stranger(request, host=f"127.0.0.{place % 200 + 2}")
                for place in range(CROWD)
            ]
            for reader, writer in own:
                writer.write(request)
                assert (await reader.readline()).split()[1:2] == [b"200"]
            for _, other in (*own, *held):
                other.close()

    run(work)


def test_without_descriptors_a_stranger_goes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Something else in the process has taken them all."""

    async def work() -> None:
        async with serving() as server:
            loop = asyncio.get_running_loop()
            accept = loop.sock_accept
            failures = [OSError(errno.EMFILE, "no descriptor is left")]

            async def fail_once(listener: socket.socket) -> Any:
                if failures and server.acceptor.accepted == 2:
                    raise failures.pop()
                return await accept(listener)

            monkeypatch.setattr(loop, "sock_accept", fail_once)
            strangers = [await server.stranger(b"GET") for _ in range(2)]
            ends = [asyncio.ensure_future(reader.read()) for reader, _ in strangers]
            ended, waiting = await asyncio.wait(ends, return_when="FIRST_COMPLETED")
            assert (len(ended), len(waiting)) == (1, 1)
            assert not failures
            for each in (*ended, *waiting):
                each.cancel()

    run(work)


def test_a_fault_that_repeats_is_logged_at_each_power_of_ten_with_its_count(
    caplog: pytest.LogCaptureFixture,
) -> None:
    for _ in range(100):
        RUNNER["logger"].warning("a fault of ours")
    assert caplog.messages == [
        "a fault of ours",
        "a fault of ours (10 times until now)",
        "a fault of ours (100 times until now)",
    ]
