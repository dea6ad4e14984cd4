"""Finds a way between two ends behind routers, with aioice, and keeps it open for the
process that uses it.

aioice has no words for handing over a socket, so this file alone reaches into its
private parts; its version is pinned. After the hand-over the live side reads the socket
and passes STUN back (`WaySocket`): aioice goes on to ask for consent (RFC 7675), to
answer the other end's checks, and to refresh the relay's allocation and channel.
"""

import asyncio
import contextlib
import ipaddress
import math
import socket
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any

import aioice
import msgspec
from aioice import stun
from aioice.turn import TurnTransport

from tactophone.core.errors import DeviceError
from tactophone.core.settings import CallSettings
from tactophone.net.call.messages import Address, Nat, Offer
from tactophone.net.link.packet import split_address
from tactophone.net.link.udp import STUN_COOKIE
from tactophone.net.link.way import READING, SILENT, WANTED, Way, read_kept

GATHER_TIMEOUT = 1.5
"""Seconds for which a server that does not answer is waited for."""

ICE_TIMEOUT = 6.0
"""Seconds until the two ends give up: relayed pairs are tried last, and each check is
repeated for some seconds."""

CHANNEL_REFRESH = 240
"""Seconds until a relay's channel is bound again: before its permission ends after 300
(RFC 8656 section 9)."""

_CHOSEN = b"\x03\0\0\0" + STUN_COOKIE.to_bytes(4)
"""Begin of the word by which the controlling end says which way it has chosen: with
STUN's first byte and cookie, so that it passes every filter, but of a type that no STUN
message has."""

LEAST_PORT = 1024
"""Ports below are of services, such as a router's 53; an end of a call has one that its
system or router chose."""

MOST_ADDRESSES, MOST_OF_A_HOST = 16, 4
"""Most addresses of the other end that are tried, and most of one machine: the other
end chooses where this machine sends, and aioice has no limit."""

RELAY_DELAY = 0.4
"""Seconds that direct ways are tried alone: the first check of one end is lost at the
other's router, and is repeated after `RETRANSMISSION`."""

RETRANSMISSION = 0.1
"""Seconds until an unanswered check is repeated, then twice as many; aioice has half a
second."""

STRAGGLER_TIMEOUT = 0.3
"""Seconds from the first STUN server's answer until the other ones are given up."""

CHOICE_INTERVAL, CHOICE_TIMEOUT = 0.05, 5.0
"""Seconds from one repetition of that word to the next, and until the end gives up."""


def allowed(addresses: Sequence[Address]) -> list[Address]:
    """Return the addresses to which an end of a call may be asked to send, the most
    preferred first.

    None of this machine, of this cable (but IPv6 has no other without a router), of a
    group or reserved, and no network service by its port: what a stranger names is not
    to reach a router or a cloud's metadata.

    >>> [each.host for each in allowed([Address("host", host, 4000, 1, "f000") for host in
    ...     ("192.168.1.7", "127.0.0.1", "169.254.169.254", "224.0.0.251", "2001:db8::7", "::1", "240.0.0.1")])]
    ['192.168.1.7', '2001:db8::7']
    """
    found: list[Address] = []
    of_host: Counter[str] = Counter()
    for each in sorted(addresses, key=lambda each: -each.priority):
        host = ipaddress.ip_address(each.host)
        refused = (
            host.is_multicast
            or host.is_reserved
            or host.is_loopback
            or host.is_unspecified
            or host.is_link_local
        )
        if refused or each.port < LEAST_PORT or of_host[each.host] == MOST_OF_A_HOST:
            continue
        of_host[each.host] += 1
        found.append(each)
    return found[:MOST_ADDRESSES]


class Server:
    """A TURN or STUN server as the settings name it: ``[USER:PASSWORD@]HOST[:PORT]``.

    >>> found = Server("1790000000:lab:k3y=@[2001:db8::1]:3479")
    >>> found.host, found.port, found.user, found.password
    ('2001:db8::1', 3479, '1790000000:lab', 'k3y=')
    """

    def __init__(self, text: str) -> None:
        credentials, _, place = text.strip().rpartition("@")
        self.user, _, self.password = credentials.rpartition(":")
        try:
            self.host, self.port = split_address(place, 3478)
        except ValueError as error:
            raise DeviceError(
                f"call.stun or call.turn has {place!r}: {error}; write HOST or HOST:PORT"
            ) from None

    async def resolve(self) -> tuple[str, int] | None:
        """Return the IPv4 address, which is all that aioice asks servers at; ``None``
        if there is none."""
        with contextlib.suppress(OSError):
            found = await asyncio.get_running_loop().getaddrinfo(
                self.host, self.port, family=socket.AF_INET, type=socket.SOCK_DGRAM
            )
            return str(found[0][4][0]), self.port
        return None


def servers_of(settings: CallSettings) -> tuple[list[Server], Server | None]:
    """Return the STUN servers that may be asked, the relay among them, and the relay;
    ``None`` if none is set."""
    turn = Server(settings.turn) if settings.turn else None
    return [
        *(Server(each) for each in settings.stun.split(",") if each.strip()),
        *filter(None, [turn]),
    ], turn


class Finder:
    """One search for a way. ``controls`` is true for the end that called.

    ``silent`` is set when the live side hears nothing over the way, ``lost`` when the
    other end has not consented to it for half a minute.
    """

    def __init__(
        self,
        *,
        controls: bool,
        stun: tuple[str, int] | None,
        turn: Server | None,
        relay_only: bool,
    ) -> None:
        self._turn = turn
        self._controls = controls
        self._stun = stun
        self._relay_only = relay_only
        self._heard: asyncio.Future[tuple[Any, tuple[str, int]]] = (
            asyncio.get_running_loop().create_future()
        )
        self._word = b""
        self.silent, self.lost = asyncio.Event(), asyncio.Event()
        self._way: Way | None = None

    async def gather(self, nat: Nat) -> Offer:
        """Ask the servers where this end may be reached; sockets are open from now
        on."""
        turn = await self._turn.resolve() if self._turn else None
        policy = (
            aioice.TransportPolicy.RELAY
            if self._relay_only
            else aioice.TransportPolicy.ALL
        )
        self._ice = aioice.Connection(
            ice_controlling=self._controls,
            stun_server=self._stun,
            turn_server=turn,
            turn_username=self._turn.user if self._turn else None,
            turn_password=self._turn.password if self._turn else None,
            transport_policy=policy,
        )
        self._ice.get_component_candidates = partial(
            self._ice.get_component_candidates, timeout=GATHER_TIMEOUT
        )
        await self._ice.gather_candidates()
        for protocol in self._ice._protocols:
            self._listen(protocol)
        found = [
            Address(each.type, each.host, each.port, each.priority, each.foundation)
            for each in self._ice.local_candidates
        ]
        relay = any(each.kind == "relay" for each in found)
        return Offer(
            self._ice.local_username, self._ice.local_password, found, nat, relay
        )

    async def connect(
        self,
        offer: Offer,
        nat: Nat,
        live: socket.socket,
        *,
        name: str,
        fingerprint: str,
    ) -> bool:
        """Find the way to the end that made the offer; return whether a relay of either
        end passes it on.

        The live side gets it at once. ``nat`` is what lies before this end; ``name``
        and ``fingerprint`` are the other end's. Raises `ConnectionError` or
        `TimeoutError` if there is none.
        """
        ice = self._ice
        offer = msgspec.structs.replace(offer, addresses=allowed(offer.addresses))
        ice.remote_username = offer.user
        ice.remote_password = offer.password
        # Known to the two ends alone, as it came through the mailbox under their key.
        self._word = (
            _CHOSEN
            + (ice.local_password if self._controls else offer.password).encode()
        )
        async with asyncio.timeout(ICE_TIMEOUT):
            await self._check(
                offer,
                0.0 if {nat, offer.nat} <= {"changes", "blocked"} else RELAY_DELAY,
            )
        protocol, peer = await self._agree()
        bound, channel = self._hand_over(protocol, peer)
        self._way = Way(bound, peer, channel, name, fingerprint)
        self._way.send(live)
        asyncio.get_running_loop().add_reader(live, self._feed, live)
        return channel > 0 or any(
            each.kind == "relay" and (each.host, each.port) == peer
            for each in offer.addresses
        )

    @property
    def host(self) -> str:
        """The other end's address, or its relay's."""
        return self._way.peer[0] if self._way else ""

    async def round_trip(self) -> float:
        """Return the seconds there and back; not a number if two answers were lost or
        took half a second."""
        pair = self._ice._nominated[1]
        loop = asyncio.get_running_loop()
        for _ in range(2):
            request = self._ice.build_request(pair, nominate=False)
            key = self._ice.remote_password.encode()
            began = loop.time()
            with contextlib.suppress(stun.TransactionError):
                await pair.protocol.request(
                    request, pair.remote_addr, integrity_key=key, retransmissions=0
                )
                return loop.time() - began
        return math.nan

    async def close(self) -> None:
        """Free the relay's allocation and close all sockets."""
        if self._way:
            self._way.bound.close()
        with contextlib.suppress(Exception):
            async with asyncio.timeout(1.0):
                await aioice.Connection.close(self._ice)

    def _listen(self, protocol: Any) -> None:
        """Notice the word of the controlling end, and on which way it came."""
        received = protocol.datagram_received

        def notice(data: bytes, source: tuple[Any, ...]) -> None:
            if not (self._word and data == self._word):
                received(data, source)
                return
            address = str(source[0]), int(source[1])
            if not self._heard.done():
                self._heard.set_result((protocol, address))
            # The other end repeats its word until it is returned; ours may be lost, so
            # each is answered.
            if not self._controls:
                protocol.transport.sendto(data, address)

        protocol.datagram_received = notice

    async def _check(self, offer: Offer, delay: float) -> None:
        """Try the direct ways first, and from ``delay`` s on the relayed ones, which
        would often be the first to work.

        aioice takes the first way that works, and whatever is added while it tries.
        """
        ice = self._ice
        direct = [each for each in offer.addresses if each.kind != "relay"]
        relays = [
            each for each in ice._protocols if each.local_candidate.type == "relay"
        ]
        if not direct or len(relays) == len(ice._protocols):
            delay = 0.0
        ice._protocols = [each for each in ice._protocols if each not in relays]
        for each in direct:
            await ice.add_remote_candidate(_candidate(each))
        usual = stun.RETRY_RTO
        stun.RETRY_RTO = RETRANSMISSION
        checks = asyncio.ensure_future(ice.connect())
        try:
            await asyncio.wait([checks], timeout=delay)
            ice._protocols += relays
            for candidate in ice.remote_candidates:
                ice._pair_remote_candidate(candidate)
            for each in offer.addresses:
                await ice.add_remote_candidate(_candidate(each))
            await ice.add_remote_candidate(None)
            await checks
        finally:
            checks.cancel()
            stun.RETRY_RTO = (
                usual  # for which an answer is waited for once there is a way
            )

    async def _agree(self) -> tuple[Any, tuple[str, int]]:
        """Agree on one way: each end may have found several, and each another one
        first."""
        async with asyncio.timeout(CHOICE_TIMEOUT):
            if not self._controls:
                return await self._heard
            pair = self._ice._nominated[1]
            chosen = pair.protocol, pair.remote_addr
            while not self._heard.done():
                pair.protocol.transport.sendto(self._word, pair.remote_addr)
                await asyncio.wait([self._heard], timeout=CHOICE_INTERVAL)
            return chosen

    def _hand_over(
        self, protocol: Any, peer: tuple[str, int]
    ) -> tuple[socket.socket, int]:
        """Return a duplicate of the socket, and the relay's channel."""
        # From here on aioice asks for consent on this way alone, and knows it for the
        # only one.
        pairs = [
            each
            for each in self._ice._check_list
            if each.protocol is protocol and each.remote_addr == peer
        ]
        if not pairs:
            raise ConnectionError(
                "the other end has chosen a way that this one has not checked"
            )
        self._ice._nominated[1] = pairs[0]
        self._ice.check_incoming = lambda *_: None
        self._ice.close = self._note_loss
        channel = 0
        self._reader = protocol
        transport = protocol.transport
        if isinstance(transport, TurnTransport):
            self._reader = transport._TurnTransport__inner_protocol
            transport = self._reader.transport
            channel = self._reader.peer_to_channel[peer]
            self._reader.channel_refresh_time = CHANNEL_REFRESH
            self._reader.channel_refresh_at[channel] = (
                0.0  # with the next question for consent
            )
        self._read_by = transport._loop, transport._sock_fd
        # Also of a relay whose allocation is not needed: it is freed.
        for other in [each for each in self._ice._protocols if each is not protocol]:
            self._ice._protocols.remove(other)
            other.transport.close()
        return transport.get_extra_info("socket").dup(), channel

    async def _note_loss(self) -> None:
        # In place of the end that aioice makes when consent is lost, for which it waits
        # 40 s for a relay that is gone.
        self.lost.set()

    def _feed(self, live: socket.socket) -> None:
        """Take what the live side says, or a STUN message that it passes on."""
        loop, descriptor = self._read_by
        with contextlib.suppress(OSError, ValueError):
            match message := live.recv(1 << 16):
                case b"":
                    loop.remove_reader(live)
                case _ if (
                    message == READING
                ):  # both processes have the socket, and only one may read it
                    loop._remove_reader(descriptor)
                case _ if message == SILENT:
                    self.silent.set()
                case _ if message == WANTED and self._way:
                    self._way.send(live)
                case _:
                    self._reader.datagram_received(*read_kept(message))


def _candidate(address: Address) -> aioice.Candidate:
    return aioice.Candidate(
        address.foundation,
        1,
        "udp",
        address.priority,
        address.host,
        address.port,
        address.kind,
    )


async def mapped_addresses(
    servers: list[tuple[str, int]], timeout: float
) -> dict[tuple[str, int], tuple[str, int]]:
    """Return under which address each STUN server that answers sees one and the same
    socket of this machine."""
    loop = asyncio.get_running_loop()
    answers = dict[bytes, tuple[str, int]]()

    class Probe(asyncio.DatagramProtocol):
        def datagram_received(self, data: bytes, addr: tuple[Any, ...]) -> None:
            with contextlib.suppress(ValueError, KeyError):
                message = stun.parse_message(data)
                if message.transaction_id in asked:
                    answers[message.transaction_id] = message.attributes[
                        "XOR-MAPPED-ADDRESS"
                    ]
                    changed.set()

    changed = asyncio.Event()
    transport, _ = await loop.create_datagram_endpoint(Probe, local_addr=("0.0.0.0", 0))
    requests = [stun.Message(stun.Method.BINDING, stun.Class.REQUEST) for _ in servers]
    asked = {request.transaction_id for request in requests}
    deadline = loop.time() + timeout
    while len(answers) < len(servers) and loop.time() < deadline:
        for request, server in zip(requests, servers, strict=True):
            if request.transaction_id not in answers:
                transport.sendto(bytes(request), server)
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(changed.wait(), 0.1)
            deadline = min(deadline, loop.time() + STRAGGLER_TIMEOUT)
        changed.clear()
    transport.close()
    pairs = zip(servers, requests, strict=True)
    return {
        server: answers[each.transaction_id]
        for server, each in pairs
        if each.transaction_id in answers
    }
