"""What a person reads where the process of a call, or the other end, says nothing."""

import asyncio
import socket
from collections.abc import Iterator
from typing import Any

import pytest

from tactophone.core.errors import DeviceError
from tactophone.core.settings import CallSettings
from tactophone.net.call import process
from tactophone.net.call.messages import Hello, Refused
from tactophone.net.call.process import CallProcess, Plan, _Call

KEY = ":".join(["AB"] * 32)
"""Fingerprint of one end."""

OTHER = ":".join(["CD"] * 32)
"""Fingerprint of the other end."""


class Gone:
    """Stands for a process that was killed."""

    alive = False

    def messages(self) -> Iterator[tuple[str, str]]:
        return iter(())


def test_an_answer_to_a_process_that_was_killed_is_no_end_without_a_word() -> None:
    """A closed pipe is taken for a reader who has seen enough."""
    own: Any = object.__new__(CallProcess)
    own._pair, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    own._child = Gone()
    own._ending = False
    its.close()
    with own._pair:
        own.answer(True)
        with pytest.raises(DeviceError, match="the process of the call ended"):
            next(own.steps())


class Silent:
    def __init__(self) -> None:
        self.sent: list[object] = []

    def send(self, message: object) -> None:
        self.sent.append(message)

    async def receive(self) -> object:
        return await asyncio.Event().wait()


HELLO = Hello("home", "robot", "0.1.0", OTHER)


@pytest.fixture
def caller() -> Any:
    own: Any = object.__new__(_Call)
    own._plan = Plan(CallSettings(), False, "", (), "lab", KEY, "operator")
    return own


def test_two_ends_that_both_call_learn_that_one_has_to_answer(
    caller: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(process, "ACCEPT_TIMEOUT", 0.01)
    with pytest.raises(DeviceError, match="if it calls too, answer at one of the two"):
        asyncio.run(caller._accept(Silent(), HELLO))


def test_who_is_asked_to_accept_a_call_learns_that_the_caller_has_hung_up(
    caller: Any,
) -> None:
    async def hang_up() -> list[object]:
        exchange = Silent()
        waiting = asyncio.ensure_future(caller._accept(exchange, HELLO))
        await asyncio.sleep(0.01)
        waiting.cancel()
        await asyncio.wait([waiting])
        return exchange.sent

    assert asyncio.run(hang_up()) == [Refused("it has hung up")]
