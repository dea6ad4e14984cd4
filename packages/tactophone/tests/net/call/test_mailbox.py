"""A mailbox that lies: it passes messages on, and changes one."""

import asyncio
import json
import multiprocessing
from typing import Any

import pytest

from .calls_apart import results_of

pytest.importorskip("wormhole")
server = pytest.importorskip("wormhole_mailbox_server")


PHASES = ("", "pake", "version", "0")


def lying_calls(results: "multiprocessing.Queue[dict[str, list[str]]]") -> None:
    """Run two ends and a mailbox that swaps the messages of one of `PHASES` in each
    call; in a process of its own."""
    from tactophone.net.call import exchange
    from tactophone.net.call.messages import Refused

    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    exchange.install(loop)

    from spake2 import SPAKE2_Symmetric
    from twisted.internet import reactor
    from wormhole_mailbox_server.database import create_channel_db
    from wormhole_mailbox_server.server import make_server
    from wormhole_mailbox_server.server_websocket import WebSocketServer
    from wormhole_mailbox_server.web import make_web_server

    honest, swapped = WebSocketServer.onMessage, ""

    def lie(self: Any, payload: bytes, is_binary: bool) -> None:
        message = json.loads(payload)
        if message["type"] == "add" and message["phase"] == swapped:
            body = bytearray.fromhex(message["body"])
            body[-1] ^= 1
            # The mailbox as the man in the middle, which guesses at the code.
            guess = SPAKE2_Symmetric(
                b"1-escapade-peachy", idSymmetric=exchange.APPLICATION.encode()
            ).start()
            message["body"] = (
                json.dumps({"pake_v1": guess.hex()}).encode()
                if swapped == "pake"
                else body
            ).hex()
        honest(self, json.dumps(message).encode(), is_binary)

    WebSocketServer.onMessage = lie
    listening: Any = reactor
    site = make_web_server(
        make_server(create_channel_db(":memory:")), log_requests=False
    )
    port = listening.listenTCP(0, site, interface="127.0.0.1").getHost().port

    async def end(code: "asyncio.Future[str]", *, opens: bool) -> str:
        async with exchange.Exchange(f"ws://127.0.0.1:{port}/v1") as own:
            try:
                if opens:
                    code.set_result(await own.open())
                else:
                    await own.open(await code)
                await own.meet()
                own.send(Refused("nothing more"))
                return repr(await own.receive())
            except Exception as error:
                return f"{type(error).__name__}: {error}"

    async def every() -> dict[str, list[str]]:
        nonlocal swapped
        found = {}
        for swapped in PHASES:
            code: asyncio.Future[str] = loop.create_future()
            ends = asyncio.gather(end(code, opens=True), end(code, opens=False))
            found[swapped] = list(await asyncio.wait_for(ends, 20))
        return found

    results.put(loop.run_until_complete(every()))
    exchange.uninstall()


@pytest.mark.slow
def test_a_mailbox_that_changes_a_message_ends_the_call_at_both_ends() -> None:
    found = results_of(lying_calls)
    assert found.pop("") == 2 * ["Refused(reason='nothing more')"]
    for swapped, said in found.items():
        assert all("the code is wrong" in each for each in said), (swapped, said)
