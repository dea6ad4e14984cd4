"""Codes at which nobody waits, and a mailbox that dies: each ends in words."""

import asyncio
import multiprocessing
from typing import Any

import pytest

from tactophone.core.errors import DeviceError
from tactophone.net.call.exchange import (
    GONE_TIMEOUT,
    MEET_TIMEOUT,
    PING_INTERVAL,
    PING_TIMEOUT,
    WELCOME_TIMEOUT,
    code_of,
)

from .calls_apart import results_of

pytest.importorskip("wormhole_mailbox_server")

NOBODY = "nobody waits at this code"
LONGEST = 30.0
"""Seconds within which a person is to hear what is wrong."""


def test_words_come_within_half_a_minute() -> None:
    assert WELCOME_TIMEOUT < LONGEST
    assert MEET_TIMEOUT < LONGEST
    # The library tries to reach a mailbox again within two seconds.
    assert PING_INTERVAL + PING_TIMEOUT + 2.0 + GONE_TIMEOUT < LONGEST


def test_ends_of_different_versions_derive_one_code_from_their_secret() -> None:
    words = "a86f8bd4ee7b8094883f75cb9a52cc27f5b49a377fa42f3966bce6f657d09829"
    assert code_of(bytes(range(32))) == f"543460792566-{words}"


def lonely_calls(results: "multiprocessing.Queue[dict[str, str]]") -> None:
    """Run a mailbox and those who use it; in a process of its own, as Twisted starts
    once."""
    from tactophone.net.call import exchange

    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    exchange.install(loop)
    exchange.GONE_TIMEOUT = 1.0

    from twisted.internet import reactor
    from wormhole_mailbox_server.database import create_channel_db
    from wormhole_mailbox_server.server import make_server
    from wormhole_mailbox_server.server_websocket import WebSocketServer
    from wormhole_mailbox_server.web import make_web_server

    connections: list[Any] = []

    opened = WebSocketServer.onConnect

    def note(self: Any, request: Any) -> Any:
        connections.append(self)
        return opened(self, request)

    WebSocketServer.onConnect = note
    listening: Any = reactor
    site = make_web_server(
        make_server(create_channel_db(":memory:")), log_requests=False
    )
    port = listening.listenTCP(0, site, interface="127.0.0.1")
    url = f"ws://127.0.0.1:{port.getHost().port}/v1"

    async def answer(code: str, timeout: float) -> str:
        try:
            async with exchange.Exchange(url) as own:
                await own.open(code)
                await own.meet(timeout=timeout)
                return "met"
        except DeviceError as error:
            return str(error)

    async def every() -> dict[str, str]:
        found = {"nobody": await answer("7-escapade-peachy", 1.0)}
        async with exchange.Exchange(url) as caller, exchange.Exchange(url) as first:
            code = await caller.open()
            await first.open(code)
            await asyncio.gather(caller.meet(), first.meet(timeout=20.0))
            found["second"] = await answer(code, 2.0)
        found["used up"] = await answer(code, 1.0)
        async with exchange.Exchange(url) as caller:
            await caller.open()
            meeting = asyncio.ensure_future(caller.meet())
            await port.stopListening().asFuture(loop)
            for each in connections:
                each.transport.abortConnection()
            try:
                await asyncio.wait_for(meeting, 20.0)
            except DeviceError as error:
                found["dies"] = str(error)
        return found

    results.put(loop.run_until_complete(every()))
    exchange.uninstall()


@pytest.mark.slow
def test_a_code_where_nobody_waits_and_a_dead_mailbox_end_a_call_in_words() -> None:
    found = results_of(lonely_calls)
    assert NOBODY in found["nobody"]
    assert NOBODY in found["used up"]
    assert NOBODY in found["second"] or "does not serve this call" in found["second"]
    assert "is gone: check the network" in found["dies"]
