"""Where the other end of a call may make this machine send."""

import asyncio
import math

import pytest

pytest.importorskip("aioice")

import aioice

from tactophone.net.call.guard import CALL_WORD, GuardedLoop
from tactophone.net.call.ice import (
    CHOOSE,
    MOST_ADDRESSES,
    MOST_OF_A_HOST,
    PING,
    IceAgent,
    allowed,
    has_integrity,
)
from tactophone.net.call.messages import Address, Offer
from tactophone.net.link.udp import END_OF_STUN


def address(host: str, port: int = 40_000, priority: int = 1) -> Address:
    return Address("host", host, port, priority, "f000")


@pytest.mark.parametrize(
    "host",
    [
        "224.0.0.251",
        "239.255.255.250",
        "169.254.169.254",
        "127.0.0.1",
        "0.0.0.0",
        "240.0.0.1",
        "255.255.255.255",
        "::1",
        "::",
        "ff02::fb",
        "fe80::1",
        "::ffff:169.254.169.254",
    ],
)
def test_no_group_no_cable_and_no_reserved_address_is_sent_to(host: str) -> None:
    assert allowed([address(host)]) == []


def test_few_addresses_are_tried_fewer_of_one_machine_and_no_service() -> None:
    # As the threat model says.
    assert MOST_ADDRESSES == 16
    assert MOST_OF_A_HOST == 4
    scan = [address("203.0.113.5", port) for port in range(2_000, 2_064)]
    assert len(allowed(scan)) == MOST_OF_A_HOST
    spellings = ["2001:db8::7", "2001:DB8:0::7", "2001:db8::0007", "2001:db8::7%1"]
    spelled = [address(host, port) for host in spellings for port in (4_000, 4_001)]
    assert len(allowed(spelled)) == MOST_OF_A_HOST
    many = [address(f"10.2.0.{number}", priority=number) for number in range(1, 61)]
    found = allowed(many)
    assert [each.priority for each in found] == list(range(60, 60 - MOST_ADDRESSES, -1))
    assert allowed([address("10.2.0.1", 53)]) == []


def test_an_end_that_wants_the_relay_alone_names_no_other_address() -> None:
    async def offered(*, relay_only: bool) -> int:
        agent = IceAgent(controls=True, stun=None, turn=None, relay_only=relay_only)
        try:
            offer = await agent.gather("unknown")
            return len(offer.addresses) + len(offer.relayed)
        finally:
            await agent.close()

    assert asyncio.run(offered(relay_only=False)) > 0
    assert asyncio.run(offered(relay_only=True)) == 0


def test_only_allowed_addresses_of_an_offer_are_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    tried: list[str] = []

    async def note(_: aioice.Connection, candidate: aioice.Candidate | None) -> None:
        if candidate:
            tried.append(candidate.host)

    async def fail(_: aioice.Connection) -> None:
        raise ConnectionError

    monkeypatch.setattr(aioice.Connection, "add_remote_candidate", note)
    monkeypatch.setattr(aioice.Connection, "connect", fail)

    async def connect() -> None:
        agent = IceAgent(controls=True, stun=None, turn=None, relay_only=False)
        await agent.gather("open")
        addresses = [address("10.2.0.1"), address("224.0.0.251")]
        offer = Offer("abcd", "p" * 22, addresses, addresses, "open", True)
        with pytest.raises(ConnectionError):
            await agent.connect(offer, "open")
        await agent.close()

    asyncio.run(connect())
    # For a direct path, and for one over the other end's relay.
    assert tried == ["10.2.0.1"] * 2


def test_a_message_is_known_by_the_key_that_aioice_has_authenticated_it_with() -> None:
    for kind in aioice.stun.Class.REQUEST, aioice.stun.Class.RESPONSE:
        message = aioice.stun.Message(aioice.stun.Method.BINDING, kind)
        message.attributes["USERNAME"] = "abcd:efgh"
        assert not has_integrity(bytes(message), b"key")
        message.add_message_integrity(b"key")
        made = bytes(message)
        assert has_integrity(made, b"key")
        assert not has_integrity(made, b"other")
        for place in range(len(made) - 8):
            changed = bytearray(made)
            changed[place] ^= 1
            # The length in the header is no part of what is authenticated.
            assert has_integrity(bytes(changed), b"key") == (place in (2, 3))
        assert not any(has_integrity(made[:size], b"key") for size in range(len(made)))


def test_a_message_too_short_for_its_integrity_is_nobodys() -> None:
    head = b"\0\x08\0\x14"
    for size in range(4, 60):
        for place in range(size - 3):
            message = bytes(place) + head + bytes(size - 4 - place)
            assert not has_integrity(message, b"key")


def test_two_ends_of_a_call_authenticate_what_they_say_to_each_other() -> None:
    passed: list[bytes] = []
    refused: list[bytes] = []

    class Noting(GuardedLoop):
        def is_authentic(self, message: bytes) -> bool:
            found = super().is_authentic(message)
            if message and message[0] < END_OF_STUN:
                (passed if found else refused).append(message)
            return found

    async def connect() -> None:
        ends = [
            IceAgent(controls=controls, stun=None, turn=None, relay_only=False)
            for controls in (True, False)
        ]
        offers = [await end.gather("open") for end in ends]
        await asyncio.gather(
            ends[0].connect(offers[1], "open"), ends[1].connect(offers[0], "open")
        )
        await ends[0].round_trip()
        for end in ends:
            await end.close()

    loop = Noting()
    try:
        loop.run_until_complete(asyncio.wait_for(connect(), 30))
    finally:
        loop.close()
    assert refused == []
    assert any(message.startswith(CALL_WORD) for message in passed)
    assert any(not message.startswith(CALL_WORD) for message in passed)


class Mirror(aioice.Connection):
    """A path on which somebody sends back to an end what it says."""

    def __init__(self) -> None:
        self.sent: list[bytes] = []
        self.end: IceAgent | None = None

    async def send(self, data: bytes) -> None:
        self.sent.append(data)
        assert self.end
        asyncio.get_running_loop().create_task(self.end._heed(self, data))


@pytest.mark.parametrize("controls", [True, False], ids=["calls", "answers"])
@pytest.mark.parametrize("kind", [CHOOSE, PING], ids=["choose", "ping"])
def test_an_end_heeds_none_of_its_own_words_sent_back(
    controls: bool, kind: bytes
) -> None:
    async def ask() -> None:
        mirror = Mirror()
        end = IceAgent(controls=controls, stun=None, turn=None, relay_only=False)
        end._key = b"known to both ends"
        mirror.end = end
        assert math.isnan(await end._ask(mirror, kind, 0.2))
        assert {word[len(CALL_WORD) :][:1] for word in mirror.sent} == {kind}
        assert not any(map(end.authenticates, mirror.sent))

    asyncio.run(ask())
