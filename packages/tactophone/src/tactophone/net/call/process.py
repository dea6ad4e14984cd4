"""The process of a call: finds the other end and the path to it, and keeps the path
open; and the handle of its parent.

A pair of sockets between the two carries the process's steps and the parent's answers,
as JSON. Another pair leads from the process to the live side, whose datagrams it passes
on (`tactophone.net.call.passage`).
"""

import asyncio
import contextlib
import json
import select
import socket
import time
from collections.abc import Callable, Coroutine, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

from tactophone.core.errors import DeviceError, TactophoneError
from tactophone.core.processes import Child, Parent
from tactophone.core.settings import CallSettings
from tactophone.core.types import ignore
from tactophone.core.version import __version__
from tactophone.net.call.guard import GuardedLoop
from tactophone.net.call.messages import (
    Accepted,
    Hello,
    Offer,
    Progress,
    Refused,
    Role,
    State,
)
from tactophone.net.call.passage import Passage
from tactophone.net.link.call_socket import CallPeer

if TYPE_CHECKING:  # their libraries are loaded in the process alone
    from tactophone.net.call.exchange import Exchange
    from tactophone.net.call.ice import IceAgent

Step: TypeAlias = Literal["code", "asked", "found", "state", "checked"]
"""What the process reports: its code, who calls and wants to be accepted, each path,
how far the other end is, and the words of a check."""

ANSWER_TIMEOUT = 30.0
"""Seconds that an end waits for the other one's next message, once both have the
key."""

ACCEPT_TIMEOUT = 180.0
"""Seconds that a caller waits for a person to accept."""

STATES_TIMEOUT = 330.0
"""Seconds for which the ends tell each other how far they are: a little longer than the
live side may take to start."""

CALL_POLL = 0.1
"""Seconds that the parent waits for a step before it looks whether the process has
ended."""

OTHER: dict[str, Role] = {"robot": "operator", "operator": "robot"}
"""The role that is left for the other end."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What the process is to do.

    - ``settings``: the servers.
    - ``answers``: whether this end answers a call.
    - ``code``: to use; empty to ask the mailbox for one.
    - ``secrets``: of the last call with the same other end, from which the code is
      derived, and of the one before: the other end may have missed the last one. Empty
      without.
    - ``name``, ``fingerprint``: of this end.
    - ``role``: that this end takes; empty where it takes the other one.
    - ``expected``: fingerprint of the other end; empty where that is not known.
    """

    settings: CallSettings
    answers: bool
    code: str
    secrets: tuple[bytes, ...]
    name: str
    fingerprint: str
    role: Role | Literal[""]
    expected: str = ""


@dataclass(frozen=True, slots=True)
class Found:
    """The other end, what kind of path leads to it, and the secrets for the next call:
    the other end's and the one of this call.

    ``after`` is how long the search took, ``round_trip`` the path's, in s; ``again``
    whether it replaces another path.
    """

    name: str
    fingerprint: str
    role: Role
    secrets: list[str]
    host: str
    relayed: bool
    after: float
    round_trip: float
    again: bool


class CallProcess(contextlib.AbstractContextManager["CallProcess", None]):
    """The handle of a call's process; a context manager, whose end closes the path.

    ``agent`` is for the live side. ``prepare`` is called in the process before it
    passes on the first datagram, to give it a priority.
    """

    def __init__(
        self, plan: Plan | CallSettings, *, prepare: Callable[[], object] = ignore
    ) -> None:
        self._pair, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.agent, live = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._child = Child(
            _run if isinstance(plan, Plan) else _run_check,
            plan,
            its,
            live,
            prepare,
            name="tactophone-call",
        )
        its.close()
        live.close()
        self._ending = False

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Close the path; `steps` ends. Nothing happens where it has ended."""
        self._ending = True
        self._child.ask_to_end()
        self._child.end(3.0)
        self.agent.close()

    def steps(self) -> Iterator[tuple[Step, Any]]:
        """Yield the steps of the process as they come; the content of ``found`` is a
        `Found`.

        Raises `DeviceError` with the reason when the process ends, but not where that
        was asked for.
        """
        while not self._ending:
            if select.select([self._pair], [], [], CALL_POLL)[0] and (
                message := self._pair.recv(1 << 16)
            ):
                step, content = json.loads(message)
                yield step, Found(**content) if step == "found" else content
                continue
            # Asked first, so that whatever the process told before its end is still
            # read.
            alive = self._child.alive
            failure = next(
                (
                    text
                    for kind, text in self._child.messages()
                    if kind in ("error", "bug")
                ),
                "",
            )
            if (failure or not alive) and not self._ending:
                raise DeviceError(
                    failure or "the process of the call ended without a word"
                )

    def answer(self, accepted: bool) -> None:
        """Accept or decline who calls."""
        self._tell(accepted)

    def say(self, progress: Progress) -> None:
        """Let the other end know how far this one is."""
        self._tell(progress)

    def _tell(self, words: bool | Progress) -> None:
        with contextlib.suppress(OSError):  # `steps` raises the reason
            self._pair.send(json.dumps(words).encode())


def _run(
    parent: Parent,
    plan: Plan,
    pair: socket.socket,
    live: socket.socket,
    prepare: Callable[[], object],
) -> None:
    loop = GuardedLoop()

    async def run() -> None:
        await _Call(plan, pair, live, loop, prepare).run()

    _in_loop(parent, loop, run, twisted=True)


def _run_check(
    parent: Parent,
    settings: CallSettings,
    pair: socket.socket,
    _live: socket.socket,
    _prepare: Callable[[], object],
) -> None:
    async def check() -> None:
        from tactophone.net.call.check import examine

        _tell(pair, "checked", list((await examine(settings)).sentences()))

    _in_loop(parent, asyncio.new_event_loop(), check)


def _in_loop(
    parent: Parent,
    loop: asyncio.AbstractEventLoop,
    main: Any,
    *,
    twisted: bool = False,
) -> None:
    asyncio.set_event_loop(loop)
    if twisted:
        from tactophone.net.call.exchange import install

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
            from tactophone.net.call.exchange import uninstall

            uninstall()


def _tell(pair: socket.socket, step: Step, content: Any) -> None:
    pair.send(json.dumps([step, content]).encode())


class _Call:
    """One call, from the code to the end of the last path."""

    def __init__(
        self,
        plan: Plan,
        pair: socket.socket,
        live: socket.socket,
        loop: GuardedLoop,
        prepare: Callable[[], object],
    ) -> None:
        from tactophone.net.call.ice import servers_of

        self._plan = plan
        self._pair = pair
        self._passage = Passage(live, loop.follow, prepare)
        self._servers, self._turn = servers_of(plan.settings)
        self._agent: IceAgent | None = None
        self._closing: set[asyncio.Task[None]] = set()
        self._accepted: asyncio.Future[bool] = (
            asyncio.get_running_loop().create_future()
        )
        self._progress: Progress = "starting"
        self._progressed = asyncio.Event()

    async def run(self) -> None:
        nat = self._ask_nat()
        beside = [
            asyncio.ensure_future(self._heed_parent()),
            asyncio.ensure_future(self._passage.run()),
        ]
        try:
            async with contextlib.AsyncExitStack() as exchanges:
                exchange, hello, secrets = await self._meet(exchanges)
                role, began = await self._accept(exchange, hello)
                relayed = await self._search(exchange, nat, hello)
                open_exchanges = exchanges.pop_all()
            content = {
                "name": hello.name,
                "fingerprint": hello.fingerprint,
                "role": role,
                "again": False,
            }
            content["secrets"] = [each.hex() for each in secrets]
            while agent := self._agent:
                content |= {
                    "host": agent.host,
                    "relayed": relayed,
                    "after": time.monotonic() - began,
                }
                _tell(
                    self._pair,
                    "found",
                    content | {"round_trip": await agent.round_trip()},
                )
                if not content["again"]:
                    beside.append(
                        asyncio.ensure_future(self._states(exchange, open_exchanges))
                    )
                began, relayed = await self._replace(agent, hello, secrets[0])
                content["again"] = True
        finally:
            for each in beside:
                each.cancel()
            if self._agent:
                await self._agent.close()
            await asyncio.gather(*self._closing, *beside, return_exceptions=True)

    async def _meet(
        self, exchanges: contextlib.AsyncExitStack
    ) -> "tuple[Exchange, Hello, list[bytes]]":
        """Wait for the other end; return what it says, and the secrets for the next
        call.

        Two ends that remember each other may have two codes in common. The caller then
        decides by its greeting.
        """
        from tactophone.net.call.exchange import MEET_TIMEOUT, Exchange, code_of

        plan = self._plan
        codes = [code_of(each) for each in plan.secrets] or [plan.code]
        opened = [
            await exchanges.enter_async_context(Exchange(plan.settings.mailbox))
            for _ in codes
        ]
        _tell(
            self._pair,
            "code",
            (await asyncio.gather(*map(Exchange.open, opened, codes)))[0],
        )

        async def greeted(place: int) -> tuple[int, bytes, Hello | None]:
            # The caller of a spoken code waits already; one that is remembered may come
            # at any time.
            told = plan.answers and not plan.secrets
            secret = await opened[place].meet(timeout=MEET_TIMEOUT if told else None)
            return (
                place,
                secret,
                await self._next(
                    opened[place],
                    Hello,
                    advice="if it answers too, call from one of the two; else call "
                    "again",
                )
                if plan.answers
                else None,
            )

        waiting = [asyncio.ensure_future(greeted(place)) for place in range(len(codes))]
        try:
            await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
            place, secret, hello = next(
                each for each in waiting if each.done()
            ).result()
        finally:
            for each in waiting:
                each.cancel()
        opened[place].send(Hello(plan.name, plan.role, __version__, plan.fingerprint))
        return (
            opened[place],
            hello or await self._next(opened[place], Hello),
            [secret, *plan.secrets[place:][:1]],
        )

    async def _accept(self, exchange: "Exchange", hello: Hello) -> tuple[Role, float]:
        """Agree on the roles, and let the answering side accept; return this end's
        role, and when that was."""
        plan = self._plan
        if hello.fingerprint == plan.fingerprint:
            raise DeviceError(
                "the other end is this machine itself: it has the same key"
            )
        if plan.expected not in ("", hello.fingerprint):
            raise DeviceError(
                f"the other end, {hello.name}, has another key than the one "
                "remembered: call with a code"
            )
        # The one that named no role takes the other one.
        role: Role = plan.role or OTHER.get(hello.role, "robot")
        taken = hello.role or OTHER[role]
        if role == taken:
            reason = (
                f"both ends are the {role}: start one with "
                f"--{'operator' if role == 'robot' else 'robot'}"
            )
            exchange.send(Refused(reason))
            raise DeviceError(reason)
        if plan.answers:
            _tell(
                self._pair,
                "asked",
                [hello.name, taken, hello.version, hello.fingerprint],
            )
            if not await self._accepted:
                exchange.send(Refused("it was not accepted"))
                raise DeviceError("you did not accept the call")
            exchange.send(Accepted(role))
        else:
            try:
                await self._next(
                    exchange,
                    Accepted,
                    timeout=ACCEPT_TIMEOUT,
                    advice="if it calls too, answer at one of the two; else call again",
                )
            except asyncio.CancelledError:
                # Whoever is asked would accept, and then wait for nobody.
                exchange.send(Refused("it has hung up"))
                raise
        return role, time.monotonic()

    async def _search(
        self, exchange: "Exchange", asked: asyncio.Task[Any], hello: Hello
    ) -> bool:
        """Find a path and pass the live side's datagrams over it; return whether it is
        relayed."""
        from tactophone.net.call import check
        from tactophone.net.call.ice import IceAgent

        nat, _, answered = await asked
        agent = IceAgent(
            controls=not self._plan.answers,
            stun=answered[0] if answered else None,
            turn=self._turn,
            relay_only=self._plan.settings.relay_only,
        )
        try:
            offer = await agent.gather(nat)
            exchange.send(offer)
            theirs = await self._next(exchange, Offer)
            try:
                relayed = await agent.connect(theirs, nat)
            except (ConnectionError, TimeoutError):
                reason = check.why_no_path(
                    nat,
                    theirs.nat,
                    relay=offer.relay or theirs.relay,
                    lacks_relay=self._turn is not None and not offer.relay,
                )
                raise DeviceError(reason) from None
        except BaseException:
            await agent.close()
            raise
        self._agent = agent
        self._passage.use(agent, CallPeer(hello.name, hello.fingerprint))
        return relayed

    async def _replace(
        self, agent: "IceAgent", hello: Hello, secret: bytes
    ) -> tuple[float, bool]:
        """Keep the path until another one replaces it; return when the search for that
        began, and if it is relayed."""
        keeping = asyncio.ensure_future(agent.lost.wait())
        searching = asyncio.ensure_future(self._search_again(hello, secret))
        try:
            await asyncio.wait(
                [keeping, searching], return_when=asyncio.FIRST_COMPLETED
            )
            if not searching.done():
                raise DeviceError(
                    "the route to the other end is lost, and no other one was found: "
                    "call again"
                )
            self._close_later(agent.close())
            return searching.result()
        finally:
            keeping.cancel()
            searching.cancel()

    async def _search_again(self, hello: Hello, secret: bytes) -> tuple[float, bool]:
        """Search whenever nothing comes over the path, as the other end does, to which
        nothing comes either."""
        from tactophone.net.call.exchange import Exchange, code_of

        while True:
            await self._passage.silent.wait()
            self._passage.silent.clear()
            nat = self._ask_nat()
            began = time.monotonic()
            # A search that fails is repeated, as long as nothing is heard.
            with contextlib.suppress(TactophoneError, OSError):
                async with contextlib.AsyncExitStack() as exchanges:
                    exchange = await exchanges.enter_async_context(
                        Exchange(self._plan.settings.mailbox)
                    )
                    await exchange.open(code_of(secret + b"again"))
                    await exchange.meet()
                    relayed = await self._search(exchange, nat, hello)
                    self._close_later(exchanges.pop_all().aclose())
                    return began, relayed

    def _ask_nat(self) -> asyncio.Task[Any]:
        from tactophone.net.call.check import find_nat

        return asyncio.ensure_future(find_nat(self._servers))

    def _close_later(self, closing: Coroutine[Any, Any, None]) -> None:
        """Close what is not needed any more, which takes an answer from the network,
        beside everything else."""
        task = asyncio.ensure_future(closing)
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)

    async def _next(
        self,
        exchange: "Exchange",
        kind: Any,
        *,
        timeout: float = ANSWER_TIMEOUT,
        advice: str = "call again",
    ) -> Any:
        """Return the other end's next message, which has to be of one kind."""
        try:
            async with asyncio.timeout(timeout):
                message = await exchange.receive()
        except TimeoutError:
            raise DeviceError(
                f"the other end said nothing for {timeout:g} s: {advice}"
            ) from None
        if isinstance(message, Refused):
            raise DeviceError(f"the other end refused the call: {message.reason}")
        if not isinstance(message, kind):
            raise DeviceError(
                f"the other end sent {type(message).__name__}, but its turn was "
                f"{kind.__name__}"
            )
        return message

    async def _heed_parent(self) -> None:
        """Take what the parent says: whether the call is accepted, and how far the live
        side is."""
        self._pair.setblocking(False)
        while data := await asyncio.get_running_loop().sock_recv(self._pair, 1 << 10):
            said = json.loads(data)
            if isinstance(said, bool):
                self._accepted.set_result(said)
            else:
                self._progress = said
                self._progressed.set()

    async def _states(
        self, exchange: "Exchange", exchanges: contextlib.AsyncExitStack
    ) -> None:
        """Tell how far this end is, and hear how far the other one is, until both are
        ready; then close the exchange.

        An older end neither tells nor reads anything.
        """
        async with exchanges:
            with contextlib.suppress(TactophoneError, OSError):
                async with asyncio.timeout(STATES_TIMEOUT):
                    await asyncio.gather(
                        self._tell_progress(exchange), self._hear_progress(exchange)
                    )

    async def _tell_progress(self, exchange: "Exchange") -> None:
        told = ""
        while told != "ready":
            told = self._progress
            exchange.send(State(self._progress))
            if told != "ready":
                await self._progressed.wait()
                self._progressed.clear()

    async def _hear_progress(self, exchange: "Exchange") -> None:
        order = get_args(Progress)
        heard = -1
        while heard < len(order) - 1:
            message = await exchange.receive()
            if not isinstance(message, State):
                break
            place = order.index(message.progress)
            # Only progress is shown, so an end that says much is shown three times.
            if place > heard:
                heard = place
                _tell(self._pair, "state", message.progress)
