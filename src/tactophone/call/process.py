"""The process of a call: finds the other end and the way to it, and keeps the way open; and the handle of its parent.

The two share a pair of sockets. Until there is a way, it carries the process's steps and the parent's answers, as JSON;
after that, the STUN messages that the live side passes on.
"""

import asyncio
import contextlib
import json
import select
import socket
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal, Self, TypeAlias

from tactophone import __version__
from tactophone.call.messages import Role
from tactophone.errors import DeviceError
from tactophone.link.way import Way
from tactophone.processes import Child, Parent
from tactophone.settings import Call

Step: TypeAlias = Literal["code", "asked", "found", "checked"]
"""What the process reports: its code, who calls and wants to be accepted, the way, and the words of a check."""

ANSWER_TIMEOUT = 30.0
"""Seconds that an end waits for the other one's next message, once both have the key."""

ACCEPT_TIMEOUT = 180.0
"""Seconds that a caller waits for a person to accept."""

POLL_INTERVAL = 0.1

OTHER: dict[str, Role] = {"robot": "operator", "operator": "robot"}


@dataclass(frozen=True, slots=True)
class Plan:
    """What the process is to do.

    Attributes
    ----------
    settings
        The servers.
    answers
        Whether this end answers a call.
    code
        To use; empty to ask the mailbox for one.
    secret
        Of the last call with the same other end, from which the code is derived; empty without.
    name, fingerprint
        Of this end.
    role
        That this end takes; empty where it takes the other one.
    """

    settings: Call
    answers: bool
    code: str
    secret: bytes
    name: str
    fingerprint: str
    role: Role | Literal[""]


@dataclass(frozen=True, slots=True)
class Found:
    """The other end, and the way to it: all that a live side needs, and the secret of the next call."""

    name: str
    version: str
    fingerprint: str
    role: Role
    secret: bytes
    way: Way
    after: float
    relayed: bool


class CallProcess:
    """The handle of a call's process; a context manager, whose end closes the way."""

    def __init__(self, plan: Plan | Call) -> None:
        self._pair, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._child = Child(_run if isinstance(plan, Plan) else _run_check, plan, its, name="tactophone-call")
        its.close()
        self._failure = ""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._child.ask_to_end()
        self._child.end(3.0)
        self._pair.close()

    def steps(self) -> Iterator[tuple[Step, Any]]:
        """Yield the steps of the process as they come, up to the way, a `Found`.

        Raises `DeviceError` with the reason if it ends before.
        """
        while True:
            if select.select([self._pair], [], [], POLL_INTERVAL)[0]:
                message, descriptors, *_ = socket.recv_fds(self._pair, 1 << 16, 1)
                if message:
                    step, content = json.loads(message)
                    if step == "found":
                        yield step, self._found(content, descriptors[0])
                        return
                    yield step, content
                    continue
            alive = self._child.alive  # asked first: what it told before its end is then read
            if self.failure or not alive:
                raise DeviceError(self.failure or "the process of the call ended without a word")

    def answer(self, accepted: bool) -> None:
        """Accept the call, or decline it."""
        self._pair.send(json.dumps(accepted).encode())

    @property
    def failure(self) -> str:
        """Why the process has ended, or the way is lost; empty while all is well."""
        self._failure = next((text for kind, text in self._child.messages() if kind in ("error", "bug")), self._failure)
        return self._failure

    def _found(self, content: dict[str, Any], descriptor: int) -> Found:
        host, port = content.pop("peer")
        way = Way(socket.socket(fileno=descriptor), (host, port), self._pair, content.pop("channel"))
        return Found(**content | {"secret": bytes.fromhex(content["secret"])}, way=way)


def _run(parent: Parent, plan: Plan, pair: socket.socket) -> None:
    _in_loop(parent, lambda: _Call(plan, pair).run(), twisted=True)


def _run_check(parent: Parent, settings: Call, pair: socket.socket) -> None:
    async def check() -> None:
        from tactophone.call.check import examine

        _tell(pair, "checked", list((await examine(settings)).sentences()))

    _in_loop(parent, check)


def _in_loop(parent: Parent, main: Any, *, twisted: bool = False) -> None:
    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    if twisted:
        from tactophone.call.exchange import install

        install(loop)

    async def until_asked() -> None:
        task = asyncio.ensure_future(main())
        loop.add_reader(parent.fileno(), task.cancel)
        with contextlib.suppress(asyncio.CancelledError):
            await task

    try:
        loop.run_until_complete(until_asked())
    finally:
        if twisted:
            from tactophone.call.exchange import uninstall

            uninstall()


def _tell(pair: socket.socket, step: Step, content: Any, descriptors: tuple[int, ...] = ()) -> None:
    socket.send_fds(pair, [json.dumps([step, content]).encode()], descriptors)


class _Call:
    """One call, from the code to the end of the way."""

    def __init__(self, plan: Plan, pair: socket.socket) -> None:
        self._plan, self._pair = plan, pair

    async def run(self) -> None:
        from tactophone.call.exchange import Exchange, code_of

        plan = self._plan
        async with Exchange(plan.settings.mailbox) as exchange:
            code = await exchange.open(code_of(plan.secret) if plan.secret else plan.code)
            _tell(self._pair, "code", code)
            secret = await exchange.meet()
            finder, found, way = await self._find(exchange)
        try:
            content = {**found, "secret": secret.hex(), "peer": way.peer, "channel": way.channel}
            _tell(self._pair, "found", content, (way.bound.fileno(),))
            way.bound.close()
            await finder.keep(self._pair)
            raise DeviceError("the way to the other end is lost, and did not come back for half a minute: call again")
        finally:
            await finder.close()

    async def _find(self, exchange: Any) -> "tuple[Any, dict[str, Any], Way]":
        from tactophone.call import check
        from tactophone.call.ice import Finder, Server
        from tactophone.call.messages import Accepted, Hello, Offer, Refused

        plan = self._plan
        exchange.send(Hello(plan.name, plan.role, __version__, plan.fingerprint))
        hello = await self._next(exchange, Hello)
        began = time.monotonic()
        if hello.fingerprint == plan.fingerprint:
            raise DeviceError("the other end is this machine itself: it has the same key")
        # The one that named no role takes the other one.
        role: Role = plan.role or OTHER.get(hello.role, "robot")
        taken = hello.role or OTHER[role]
        if role == taken:
            reason = f"both ends are the {role}: start one with --{'operator' if role == 'robot' else 'robot'}"
            exchange.send(Refused(reason))
            raise DeviceError(reason)
        if plan.answers:
            _tell(self._pair, "asked", [hello.name, taken, hello.version])
            if not await self._accepted():
                exchange.send(Refused("it was not accepted"))
                raise DeviceError("you did not accept the call")
            exchange.send(Accepted(role))
            began = time.monotonic()
        else:
            await self._next(exchange, Accepted, timeout=ACCEPT_TIMEOUT)
            began = time.monotonic()
        settings = plan.settings
        stun = [Server(each) for each in settings.stun.split(",") if each.strip()]
        turn = Server(settings.turn) if settings.turn else None
        resolved = [found for server in stun if (found := await server.resolve())]
        finder = Finder(
            controls=not plan.answers, stun=resolved[0] if resolved else None, turn=turn, relay_only=settings.relay_only
        )
        try:
            (nat, *_), offer = await asyncio.gather(check.find_nat([*stun, *filter(None, [turn])]), finder.gather())
            exchange.send(Offer(offer.user, offer.password, offer.addresses, nat, offer.relay))
            theirs = await self._next(exchange, Offer)
            try:
                way, relayed = await finder.connect(theirs, nat, self._pair)
            except (ConnectionError, TimeoutError):
                reason = check.why_no_way(nat, theirs.nat, relay=offer.relay or theirs.relay)
                raise DeviceError(reason) from None
        except BaseException:
            await finder.close()
            raise
        content = {
            "name": hello.name, "version": hello.version, "fingerprint": hello.fingerprint, "role": role,
            "after": time.monotonic() - began, "relayed": relayed,
        }  # fmt: skip
        return finder, content, way

    async def _next(self, exchange: Any, kind: Any, *, timeout: float = ANSWER_TIMEOUT) -> Any:
        """Return the other end's next message, which has to be of one kind."""
        from tactophone.call.messages import Refused

        try:
            async with asyncio.timeout(timeout):
                message = await exchange.receive()
        except TimeoutError:
            raise DeviceError(f"the other end said nothing for {timeout:g} s: call again") from None
        if isinstance(message, Refused):
            raise DeviceError(f"the other end refused the call: {message.reason}")
        if not isinstance(message, kind):
            raise DeviceError(f"the other end sent {type(message).__name__}, but its turn was {kind.__name__}")
        return message

    async def _accepted(self) -> bool:
        self._pair.setblocking(False)
        return bool(json.loads(await asyncio.get_running_loop().sock_recv(self._pair, 1 << 10)))
