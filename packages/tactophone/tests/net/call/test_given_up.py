"""A search for a path that is given up while a relay does not answer."""

import asyncio
import gc
import socket

import pytest

pytest.importorskip("aioice")

from aioice import stun

from tactophone.net.call.ice import IceAgent, Server


def test_a_relay_that_never_answers_a_search_given_up_is_no_error_on_the_terminal(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(stun, "RETRY_RTO", 0.01)
    monkeypatch.setattr(stun, "RETRY_MAX", 3)

    async def search(relay: socket.socket) -> None:
        agent = IceAgent(
            controls=True,
            stun=None,
            turn=Server(f"user:password@127.0.0.1:{relay.getsockname()[1]}"),
            relay_only=True,
        )
        searching = asyncio.ensure_future(agent.gather("unknown"))
        await asyncio.get_running_loop().sock_recv(relay, 1 << 10)
        searching.cancel()
        with pytest.raises(asyncio.CancelledError):
            await searching
        await asyncio.sleep(0.5)  # aioice asks four times in 0.15 s
        gc.collect()
        await agent.close()

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as relay:
        relay.setblocking(False)
        relay.bind(("127.0.0.1", 0))
        asyncio.run(search(relay))
        gc.collect()
    assert caplog.messages == []
