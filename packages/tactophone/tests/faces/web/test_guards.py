"""What a page may feel and do, decided without a server: nothing where it is muted, and
less from another machine."""

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from aiohttp import WSMessage, WSMsgType, web

from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.faces.web.devices import command_of
from tactophone.faces.web.views import is_local, messages_of
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry


@pytest.mark.parametrize("armed", [True, False])
def test_a_page_renders_a_command_only_while_the_finger_is_armed(armed: bool) -> None:
    with Telemetry("test-guards") as telemetry:
        telemetry.update(RunState(fingers=(FingerState(armed=armed),)), now=1e9)
        block = AudioBlock(np.full((480, 2), 0.5, np.float32), 48_000)
        prediction = Prediction((0, 0, 1), Touch.ROUGH, 1.0, -20.0, 0, 0)
        telemetry.publish(
            PipelineStep(block, (prediction,), (HapticCommand(0.25, 60.0, 0.0),)),
            now=1e9,
        )
        watcher = Watcher.find("test-guards")
        assert watcher is not None
        command = command_of(watcher.snapshot(), None)["command"]
    assert command[0] == (0.25 if armed else 0.0)


@pytest.mark.parametrize(
    ("peer", "own", "local"),
    [
        ("127.0.0.1", "127.0.0.1", True),
        ("192.0.2.7", "192.0.2.7", True),
        ("192.0.2.8", "192.0.2.7", False),
        (None, "192.0.2.7", False),
    ],
)
def test_a_page_is_local_where_both_ends_have_one_address(
    peer: str | None, own: str, local: bool
) -> None:
    ends: dict[str, Any] = {"peername": peer and (peer, 1), "sockname": (own, 2)}
    request = SimpleNamespace(transport=SimpleNamespace(get_extra_info=ends.get))
    assert is_local(cast(web.Request, request)) is local
    assert not is_local(cast(web.Request, SimpleNamespace(transport=None)))


class LeftView:
    """A page that asks for an answer and has left."""

    def __init__(self, *messages: WSMessage) -> None:
        self._messages = list(messages)
        self.answered = 0

    def __aiter__(self) -> "LeftView":
        return self

    async def __anext__(self) -> WSMessage:
        if not self._messages:
            raise StopAsyncIteration
        return self._messages.pop(0)

    async def pong(self, _: bytes) -> None:
        self.answered += 1
        raise ConnectionError("Connection lost")


def test_a_page_that_leaves_before_its_ping_is_answered_is_no_fault_of_ours() -> None:
    ping, text = (
        WSMessage(kind, b"", None) for kind in (WSMsgType.PING, WSMsgType.TEXT)
    )
    view = LeftView(text, ping, text)

    async def receive() -> list[WSMessage]:
        messages = messages_of(cast(web.WebSocketResponse, view))
        return [message async for message in messages]

    assert asyncio.run(receive()) == [text]
    assert view.answered == 1
