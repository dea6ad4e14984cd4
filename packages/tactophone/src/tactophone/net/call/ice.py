"""Finds a path between two ends behind routers, with aioice, and keeps it open.

Two connections of aioice search side by side, under one name and password. The direct
one knows no relay; the relayed one begins a little later, as a relay would often be the
first to work. Where this end has a relay, it offers in the second one the relay's
address alone: so whatever the second one finds leads over a relay, of one end or of
both, and the calling end may choose between the two without a look into either.

aioice asks for consent (RFC 7675), answers the other end's checks and refreshes the
relay's allocation.
"""

import asyncio
import contextlib
import hashlib
import hmac
import ipaddress
import math
import secrets
import socket
from collections import Counter
from collections.abc import Callable, Coroutine, Sequence
from typing import Any

import aioice
from aioice import stun

from tactophone.core.errors import DeviceError
from tactophone.core.settings import CallSettings
from tactophone.net.call.aioice_defaults import quick_checks, refresh_channels_in_time
from tactophone.net.call.guard import CALL_WORD, GuardedLoop
from tactophone.net.call.messages import Address, Nat, Offer
from tactophone.net.link.packet import split_address
from tactophone.net.link.udp import host_towards

GATHER_TIMEOUT = 1.5
"""Seconds for which a relay that does not answer is waited for."""

ICE_TIMEOUT = 6.0
"""Seconds until the two ends give up: relayed pairs are tried last, and each check is
repeated for some seconds."""

LEAST_PORT = 1024
"""Lower ports belong to services, such as a router's DNS; an end of a call has a port
that its system or router chose."""

MOST_ADDRESSES = 16
"""Maximum addresses of the other end that are tried for each kind of path: the other
end chooses where this machine sends, and aioice has no limit."""

MOST_OF_A_HOST = 4
"""Maximum of these addresses that one machine may have."""

RELAY_DELAY = 0.4
"""Seconds for which direct paths are tried alone: the first check of one end is lost at
the other's router, and is repeated after `aioice_defaults.RETRANSMISSION`."""

STRAGGLER_TIMEOUT = 0.3
"""Seconds from the first STUN server's answer until the other ones are given up."""

CHOICE_INTERVAL = 0.05
"""Seconds from one repetition of the word for the chosen path to the next."""

CHOICE_TIMEOUT = 5.0
"""Seconds until an end gives up a path over which that word, or its answer, does not
come."""

ROUND_TRIP_TIMEOUT = 0.5
"""Seconds after which an answer counts as lost."""

CLOSE_TIMEOUT = 1.0
"""Seconds for the relay to free an allocation; it expires anyway."""

CHOOSE = b"c"
"""The calling end has chosen the path on which this word comes."""

PING = b"p"
"""A question for the time there and back."""

REPLY = b"r"
"""The answer to either."""

_CALLING = b"c"
_ANSWERING = b"a"
_NUMBER_SIZE = 8
"""Bytes of the random number by which an answer is told from others."""

_STUN_HEADER_SIZE = 20
_INTEGRITY_HEAD = b"\0\x08\0\x14"
_INTEGRITY_SIZE = 24
_FINGERPRINT_SIZE = 8

_MAC_SIZE = 16
"""Bytes of the code that proves who sent a word: half of SHA-256."""


def allowed(addresses: Sequence[Address]) -> list[Address]:
    """Return the addresses to which an end of a call may be asked to send, the most
    preferred first.

    What a stranger names must not reach this machine, a router or a cloud's metadata.
    So loopback, link-local, multicast and reserved addresses are left out, and ports
    that belong to network services.

    >>> hosts = ("192.168.1.7", "127.0.0.1", "169.254.169.254", "224.0.0.251")
    >>> hosts += ("2001:db8::7", "::1", "240.0.0.1")
    >>> named = [Address("host", host, 4000, 1, "f000") for host in hosts]
    >>> [each.host for each in allowed(named)]
    ['192.168.1.7', '2001:db8::7']
    """
    found: list[Address] = []
    # By address: one of IPv6 can be written in many ways.
    of_host: Counter[int] = Counter()
    for each in sorted(addresses, key=lambda each: -each.priority):
        host = ipaddress.ip_address(each.host)
        refused = (
            host.is_multicast
            or host.is_reserved
            or host.is_loopback
            or host.is_unspecified
            or host.is_link_local
        )
        if refused or each.port < LEAST_PORT or of_host[int(host)] == MOST_OF_A_HOST:
            continue
        of_host[int(host)] += 1
        found.append(each)
    return found[:MOST_ADDRESSES]


def has_integrity(message: bytes, key: bytes) -> bool:
    """Whether a STUN message is authenticated by a key, as every message of a path is:
    its last attributes are MESSAGE-INTEGRITY and FINGERPRINT (RFC 8489, sections 14.5
    and 14.7).

    aioice asks this too, but parses the message first, and floods must stay cheap.
    """
    covered = len(message) - _INTEGRITY_SIZE - _FINGERPRINT_SIZE
    if covered < _STUN_HEADER_SIZE:
        return False
    if message[covered : covered + 4] != _INTEGRITY_HEAD:
        return False
    # The length in the header is counted up to MESSAGE-INTEGRITY, without what follows.
    length = covered + _INTEGRITY_SIZE - _STUN_HEADER_SIZE
    content = message[:2] + length.to_bytes(2) + message[4:covered]
    found = message[covered + 4 : covered + _INTEGRITY_SIZE]
    return hmac.compare_digest(found, hmac.digest(key, content, hashlib.sha1))


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
                f"call.stun or call.turn has {place!r}: {error}; write HOST or "
                "HOST:PORT"
            ) from None

    async def resolve(self) -> tuple[str, int] | None:
        """Return the IPv4 address, the only kind at which aioice asks servers; ``None``
        if the server has no such address."""
        with contextlib.suppress(OSError, UnicodeError):
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


def _note_failure(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Report a failure that nobody waits for, unless a server did not answer: aioice
    goes on asking for a search that was given up."""
    if not isinstance(context.get("exception"), stun.TransactionError):
        loop.default_exception_handler(context)


class IceAgent:
    """One search for a path, and the path that it found. ``controls`` is true for the
    end that called.

    ``deliver`` is called with each datagram of the session. ``lost`` is set when the
    other end has not consented to the path for half a minute.
    """

    def __init__(
        self,
        *,
        controls: bool,
        stun: tuple[str, int] | None,
        turn: Server | None,
        relay_only: bool,
    ) -> None:
        self.deliver: Callable[[bytes], None] = lambda datagram: None
        self.lost = asyncio.Event()
        self.host = ""
        """The other end's address, or its relay's."""

        self._turn = turn
        self._controls = controls
        self._stun = stun
        self._relay_only = relay_only
        self._direct: aioice.Connection | None = None
        self._relayed: aioice.Connection | None = None
        # Set by the calling end's word, or at the calling end by its answer.
        self._chosen: asyncio.Future[aioice.Connection] = (
            asyncio.get_running_loop().create_future()
        )
        self._key = b""
        self._password = secrets.token_hex(16)
        self._passwords = [self._password.encode()]
        self._asked: dict[bytes, asyncio.Future[bytes]] = {}
        self._round_trip = math.nan
        self._beside: set[asyncio.Task[Any]] = set()

    async def gather(self, nat: Nat) -> Offer:
        """Ask the servers where this end may be reached; sockets are open from now
        on."""
        refresh_channels_in_time()
        asyncio.get_running_loop().set_exception_handler(_note_failure)
        turn = await self._turn.resolve() if self._turn else None
        user = secrets.token_hex(4)
        loop = asyncio.get_running_loop()
        if isinstance(loop, GuardedLoop):
            loop.trust(self.authenticates)

        def connection(
            policy: aioice.TransportPolicy, relay: tuple[str, int] | None
        ) -> aioice.Connection:
            return aioice.Connection(
                ice_controlling=self._controls,
                stun_server=self._stun,
                turn_server=relay,
                turn_username=self._turn.user if relay and self._turn else None,
                turn_password=self._turn.password if relay and self._turn else None,
                transport_policy=policy,
                local_username=user,
                local_password=self._password,
            )

        everything = aioice.TransportPolicy.ALL
        relay_alone = aioice.TransportPolicy.RELAY
        hides = turn is not None or self._relay_only
        self._relayed = connection(relay_alone if hides else everything, turn)
        searches = [self._gather_relayed()]
        if not self._relay_only:
            self._direct = connection(everything, None)
            searches.append(self._direct.gather_candidates())
        await asyncio.gather(*searches)
        relayed = _addresses(self._relayed)
        return Offer(
            user,
            self._password,
            _addresses(self._direct),
            relayed,
            nat,
            any(each.kind == "relay" for each in relayed),
        )

    async def connect(self, offer: Offer, nat: Nat) -> bool:
        """Find the path to the end that made the offer; return whether a relay of
        either end passes it on.

        ``nat`` is what lies before this end. Raises `ConnectionError` or `TimeoutError`
        if no path is found.
        """
        # Known to the two ends alone, as it came through the mailbox under their key.
        self._key = (self._password if self._controls else offer.password).encode()
        self._passwords.append(offer.password.encode())
        direct = allowed(offer.addresses)
        relayed = allowed(offer.relayed)
        hopeless = {nat, offer.nat} <= {"changes", "blocked"}
        searches: dict[asyncio.Task[None], aioice.Connection] = {}

        def search(
            connection: aioice.Connection, addresses: list[Address], delay: float
        ) -> None:
            task = asyncio.ensure_future(
                self._check(connection, offer, addresses, delay)
            )
            # Asking for the exception keeps asyncio from reporting a failure that no
            # longer matters, because another search has won.
            task.add_done_callback(lambda done: done.cancelled() or done.exception())
            searches[task] = connection

        if self._direct and direct:
            search(self._direct, direct, 0.0)
        own_relay = self._relayed is not None and any(
            each.type == "relay" for each in self._relayed.local_candidates
        )
        if self._relayed and relayed and (own_relay or offer.relay):
            search(
                self._relayed,
                relayed,
                RELAY_DELAY if searches and not hopeless else 0.0,
            )
        try:
            with quick_checks():
                async with asyncio.timeout(ICE_TIMEOUT + CHOICE_TIMEOUT):
                    chosen = await (
                        self._choose(searches)
                        if self._controls
                        else self._be_told(searches)
                    )
        finally:
            for task in searches:
                task.cancel()
        if not self._chosen.done():
            self._chosen.set_result(chosen)
        is_relayed = chosen is self._relayed
        self._drop(self._direct if is_relayed else self._relayed)
        return is_relayed

    async def send(self, datagram: bytes) -> None:
        """Send over the path that was found."""
        try:
            await self._chosen.result().send(datagram)
        except ConnectionError:
            # aioice has closed the connection, but waits up to 40 s for a relay that is
            # gone before it says so.
            self.lost.set()

    async def round_trip(self) -> float:
        """Return the seconds there and back; not a number if two answers were lost or
        took half a second."""
        connection = self._chosen.result()
        for _ in range(2):
            if math.isfinite(self._round_trip):
                break
            self._round_trip = await self._ask(connection, PING, ROUND_TRIP_TIMEOUT)
        return self._round_trip

    async def close(self) -> None:
        """Free the relay's allocation and close all sockets."""
        loop = asyncio.get_running_loop()
        if isinstance(loop, GuardedLoop):
            loop.distrust(self.authenticates)
        for task in self._beside:
            task.cancel()
        for connection in filter(None, (self._direct, self._relayed)):
            await _close(connection)

    async def _gather_relayed(self) -> None:
        connection = self._relayed
        assert connection
        try:
            async with asyncio.timeout(GATHER_TIMEOUT):
                await connection.gather_candidates()
        except TimeoutError:
            # A relay that is gone leaves the direct path to be tried.
            self._relayed = None
            self._do_beside(_close(connection))

    async def _check(
        self,
        connection: aioice.Connection,
        offer: Offer,
        addresses: list[Address],
        delay: float,
    ) -> None:
        """Find a path within one connection, and listen to it from then on."""
        await asyncio.sleep(delay)
        connection.remote_username = offer.user
        connection.remote_password = offer.password
        for each in addresses:
            await connection.add_remote_candidate(_candidate(each))
        await connection.add_remote_candidate(None)
        async with asyncio.timeout(ICE_TIMEOUT):
            await connection.connect()
        self._do_beside(self._listen(connection))

    async def _choose(
        self, searches: dict[asyncio.Task[None], aioice.Connection]
    ) -> aioice.Connection:
        """Return the first connection over which the other end answers; it then uses
        the same one."""
        failure: BaseException = ConnectionError("there is no address to try")
        while searches:
            done, _ = await asyncio.wait(searches, return_when=asyncio.FIRST_COMPLETED)
            # The direct one stands first.
            for task in [each for each in searches if each in done]:
                connection = searches.pop(task)
                if error := task.exception():
                    failure = error
                    continue
                taken = await self._ask(connection, CHOOSE, CHOICE_TIMEOUT)
                if math.isfinite(taken):
                    self._round_trip = taken
                    for other in searches:
                        other.cancel()
                    return connection
                failure = TimeoutError()
        raise failure

    async def _be_told(
        self, searches: dict[asyncio.Task[None], aioice.Connection]
    ) -> aioice.Connection:
        """Return the connection that the calling end has chosen."""
        waiting: set[asyncio.Future[Any]] = {*searches}
        failure: BaseException = ConnectionError("there is no address to try")
        found = False
        while waiting or found:
            await asyncio.wait(
                {self._chosen, *waiting}, return_when=asyncio.FIRST_COMPLETED
            )
            if self._chosen.done():
                return self._chosen.result()
            for task in [each for each in waiting if each.done()]:
                waiting.discard(task)
                if error := task.exception():
                    failure = error
                else:
                    found = True
        raise failure

    async def _listen(self, connection: aioice.Connection) -> None:
        with contextlib.suppress(ConnectionError):
            while True:
                datagram = await connection.recv()
                if datagram.startswith(CALL_WORD):
                    await self._heed(connection, datagram)
                elif self._chosen.done():
                    self.deliver(datagram)
        if self._chosen.done() and self._chosen.result() is connection:
            self.lost.set()

    async def _heed(self, connection: aioice.Connection, word: bytes) -> None:
        """Take a word of the other end, which is dropped if it is anybody else's."""
        content = word[len(CALL_WORD) : -_MAC_SIZE]
        kind = content[:1]
        number = content[1:]
        if not self._is_of_other_end(word):
            return
        if kind == REPLY:
            if (asked := self._asked.get(number)) and not asked.done():
                asked.set_result(word)
            return
        # The other end repeats its word until it is answered, and any answer may be
        # lost, so each word is answered.
        with contextlib.suppress(ConnectionError):
            await connection.send(self._word(REPLY, number, calling=self._controls))
        if kind == CHOOSE and not self._controls and not self._chosen.done():
            self.host = _source_of(word)
            self._chosen.set_result(connection)

    async def _ask(
        self, connection: aioice.Connection, kind: bytes, timeout: float
    ) -> float:
        """Repeat a word until it is answered; return the seconds there and back, or not
        a number if no answer came."""
        loop = asyncio.get_running_loop()
        deadline = loop.time() + timeout
        sent: dict[bytes, float] = {}
        try:
            while (now := loop.time()) < deadline:
                number = secrets.token_bytes(_NUMBER_SIZE)
                sent[number] = now
                self._asked[number] = loop.create_future()
                with contextlib.suppress(ConnectionError):
                    await connection.send(
                        self._word(kind, number, calling=self._controls)
                    )
                waiting = [self._asked[each] for each in sent]
                done, _ = await asyncio.wait(
                    waiting,
                    timeout=CHOICE_INTERVAL,
                    return_when=asyncio.FIRST_COMPLETED,
                )
                for answered in done:
                    word = answered.result()
                    began = sent[word[len(CALL_WORD) + 1 : -_MAC_SIZE]]
                    self.host = self.host or _source_of(word)
                    return loop.time() - began
            return math.nan
        finally:
            for number in sent:
                del self._asked[number]

    def authenticates(self, message: bytes) -> bool:
        """Whether the other end made a word of this search, or either end a STUN
        message of it."""
        if message.startswith(CALL_WORD):
            return bool(self._key) and self._is_of_other_end(message)
        return any(has_integrity(message, key) for key in self._passwords)

    def _is_of_other_end(self, word: bytes) -> bool:
        content = word[len(CALL_WORD) : -_MAC_SIZE]
        made = self._word(content[:1], content[1:], calling=not self._controls)
        return hmac.compare_digest(word, made)

    def _word(self, kind: bytes, number: bytes, *, calling: bool) -> bytes:
        """Return a word of the calling end, or of the one that answers, which nobody
        without the key can say.

        The two ends' words differ, or an end would heed its own one sent back to it.
        """
        role = _CALLING if calling else _ANSWERING
        mac = hmac.digest(self._key, role + kind + number, hashlib.sha256)
        return CALL_WORD + kind + number + mac[:_MAC_SIZE]

    def _drop(self, connection: aioice.Connection | None) -> None:
        """Close the connection that was not chosen, and free its relay's allocation."""
        if connection:
            self._do_beside(_close(connection))

    def _do_beside(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.ensure_future(work)
        self._beside.add(task)
        task.add_done_callback(self._beside.discard)


async def _close(connection: aioice.Connection) -> None:
    with contextlib.suppress(Exception):
        async with asyncio.timeout(CLOSE_TIMEOUT):
            await connection.close()


def _source_of(word: bytes) -> str:
    """Return the address from which a word came; empty where a relay hides it."""
    loop = asyncio.get_running_loop()
    return loop.source_of(word) if isinstance(loop, GuardedLoop) else ""


def _addresses(connection: aioice.Connection | None) -> list[Address]:
    if connection is None:
        return []
    return [
        Address(each.type, each.host, each.port, each.priority, each.foundation)
        for each in connection.local_candidates
    ]


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
    transport, _ = await loop.create_datagram_endpoint(
        Probe, local_addr=(host_towards(servers) or "0.0.0.0", 0)
    )
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
