"""Which router is between this machine and the internet, which servers answer, and what
follows, in words."""

import asyncio
import contextlib
import socket
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import urlsplit

from tactophone.core.settings import CallSettings
from tactophone.net.call.ice import IceAgent, Server, mapped_addresses, servers_of
from tactophone.net.call.messages import Nat
from tactophone.net.link.packet import Address

STUN_TIMEOUT = 1.5
"""Seconds to wait for the STUN servers: an answer takes a tenth of that from most
places."""

CHECK_TIMEOUT = 3.0
"""Seconds to wait for the mailbox."""

WORDS: dict[Nat, str] = {
    "blocked": "no STUN server answers: UDP to the internet is blocked, or there is "
    "none",
    "open": "no router changes its addresses",
    "keeps": "its router keeps one port for all destinations, which allows a direct "
    "route",
    "changes": "its router takes another port for each destination, which allows a "
    "direct route to few networks",
    "unknown": "only one STUN server answers, so the kind of its router is not known",
}
"""What lies between a machine and the internet."""

HELP = "see *Your own exchange* in docs/guide/apart.md"


@dataclass(frozen=True, slots=True)
class Findings:
    """What ``call --check`` finds out."""

    nat: Nat
    public: str
    stun: list[Address]
    mailbox: bool
    relay: bool
    relay_set: bool
    ipv6: bool

    def sentences(self) -> Iterator[str]:
        yield f"this machine: {WORDS[self.nat]}" + (
            f"; it is seen at {self.public}" if self.public else ""
        )
        servers = ", ".join(f"{host}:{port}" for host, port in self.stun)
        yield f"STUN: {servers or 'no server'} answered"
        other = "does not answer; name another with --set call.mailbox=..."
        yield f"mailbox: {'answers' if self.mailbox else other}"
        if self.relay_set:
            advice = "gives no address; check call.turn, its user and password"
            yield f"relay: {'gives an address' if self.relay else advice}"
        else:
            yield "relay: none is set (call.turn)"
        yield f"IPv6: {'yes' if self.ipv6 else 'no global address'}"
        yield self.route()

    def route(self) -> str:
        """Return which route a call would take."""
        if self.relay and self.nat not in {"keeps", "open"}:
            return (
                "a call would be direct where the other network allows it, else relayed"
            )
        if self.relay:
            return (
                "a call would be direct, and relayed if the other network does not "
                "allow that"
            )
        if self.nat == "blocked":
            return (
                "a call would fail outside this network: it needs a relay that "
                f"this network can reach; {HELP}"
            )
        if self.nat == "changes":
            return (
                "a call would be direct where the other router keeps its ports, "
                f"else it needs a relay; {HELP}"
            )
        return (
            "a call would be direct unless the other router changes its ports; "
            f"then it needs a relay; {HELP}"
        )


async def find_nat(stun: list[Server]) -> tuple[Nat, str, list[Address]]:
    """Return what router is here, under which address servers see this machine, and
    which servers answer."""
    found = dict.fromkeys(
        filter(None, await asyncio.gather(*(server.resolve() for server in stun)))
    )
    answers = await mapped_addresses(list(found), STUN_TIMEOUT) if found else {}
    seen = list(answers.values())
    answered = list(answers)
    if not seen:
        return "blocked", "", []
    nat: Nat
    if _is_local(seen[0][0]):
        nat = "open"
    elif len(set(seen)) > 1:
        nat = "changes"
    else:
        nat = "keeps" if len(seen) > 1 else "unknown"
    return nat, seen[0][0], answered


async def examine(settings: CallSettings) -> Findings:
    asked, turn = servers_of(settings)
    (nat, seen, stun), mailbox, relay = await asyncio.gather(
        find_nat(asked), _answers(settings.mailbox), _relays(turn)
    )
    return Findings(nat, seen, stun, mailbox, relay, turn is not None, _has_ipv6())


def why_no_path(here: Nat, there: Nat, *, relay: bool, lacks_relay: bool) -> str:
    """Return why two ends found no path, and what helps.

    ``relay`` says whether either end has one, ``lacks_relay`` whether the one that is
    set here gives no address.
    """
    reasons = f"here, {WORDS[here]}; there, {WORDS[there]}"
    if lacks_relay:
        return (
            "no route between the two networks, and the relay here gives no address: "
            f"{reasons}; check call.turn with --check"
        )
    if relay:
        return (
            f"no route between the two networks, not even over the relay: {reasons}; "
            "check call.turn with --check"
        )
    return (
        f"no direct route between the two networks: {reasons}; this pair needs a "
        f"relay, call.turn: {HELP}"
    )


async def _answers(mailbox: str) -> bool:
    url = urlsplit(mailbox)
    with contextlib.suppress(OSError, ValueError, TimeoutError):
        async with asyncio.timeout(CHECK_TIMEOUT):
            port = url.port or (443 if url.scheme == "wss" else 80)
            _, writer = await asyncio.open_connection(url.hostname, port)
            writer.close()
            return True
    return False


async def _relays(turn: Server | None) -> bool:
    if turn is None:
        return False
    agent = IceAgent(controls=True, stun=None, turn=turn, relay_only=True)
    try:
        return (await agent.gather("unknown")).relay
    finally:
        await agent.close()


def _is_local(address: str) -> bool:
    """Whether an address is one of this machine: only then can a socket be bound to
    it."""
    with (
        contextlib.suppress(OSError),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe,
    ):
        probe.bind((address, 0))
        return True
    return False


def _has_ipv6() -> bool:
    """Whether this machine would reach the internet over IPv6; nothing is sent."""
    with (
        contextlib.suppress(OSError),
        socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe,
    ):
        probe.connect(("2001:db8::1", 9))
        return not str(probe.getsockname()[0]).startswith("fe80")
    return False
