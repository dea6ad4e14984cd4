"""A search for a path while a relay does not answer."""

import asyncio
import gc
import socket

import pytest

pytest.importorskip("aioice")

from aioice import stun

from tactophone.net.call import ice
from tactophone.net.call.check import why_no_path
from tactophone.net.call.ice import IceAgent, Server
from tactophone.net.call.messages import Address, Offer


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


@pytest.mark.parametrize("controls", [True, False], ids=["calls", "answers"])
def test_a_relay_alone_that_does_not_answer_is_no_path_and_no_error_of_ours(
    monkeypatch: pytest.MonkeyPatch, controls: bool
) -> None:
    monkeypatch.setattr(ice, "GATHER_TIMEOUT", 0.05)
    theirs = Address("relay", "203.0.113.5", 40_000, 1, "f000")

    async def search(relay: socket.socket) -> None:
        agent = IceAgent(
            controls=controls,
            stun=None,
            turn=Server(f"user:password@127.0.0.1:{relay.getsockname()[1]}"),
            relay_only=True,
        )
        offer = await agent.gather("unknown")
        assert not offer.relay
        # As `process` takes it for a search to repeat, or to end in words.
        with pytest.raises(ConnectionError):
            await agent.connect(
                Offer("abcd", "p" * 22, [], [theirs], "unknown", True), "unknown"
            )
        await agent.close()

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as relay:
        relay.bind(("127.0.0.1", 0))
        asyncio.run(search(relay))
    said = why_no_path("keeps", "keeps", relay=True, lacks_relay=True)
    assert "the relay here gives no address" in said
