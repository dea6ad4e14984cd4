"""A player's page that sends anything: the finger is lifted, a stop stays, and no file
grows."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import aiohttp
import pytest

from tactophone.core.types import Touch
from tactophone_lab.game.game_page import serve_game
from tactophone_lab.game.stone_box import GameSettings
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

ORDER = (Touch.SMOOTH, Touch.ROUGH, Touch.SMOOTH, Touch.SMOOTH, Touch.ROUGH)

Talk = Callable[[aiohttp.ClientWebSocketResponse, Run], Awaitable[None]]


def play(name: str, results: Path, talk: Talk) -> list[tuple[Any, ...]]:
    """Let a page talk to the box; returns what reached the finger."""
    inbox, finger = Pipe(duplex=False)

    async def connected(url: str, run: Run) -> None:
        async with aiohttp.ClientSession() as session:
            origin = url[: url.rindex("/", 0, -1)]
            async with session.ws_connect(
                url + "player", origin=origin, max_msg_size=0
            ) as view:
                await talk(view, run)

    with (
        Run(name) as run,
        serve_game(GameSettings(name, [ORDER], 7, finger, results)) as page,
    ):
        asyncio.run(connected(page.url, run))
        return _received(inbox)


def _received(inbox: Connection) -> list[tuple[Any, ...]]:
    found = []
    while inbox.poll(0.5):
        found.append(inbox.recv())
    return found


async def answer(view: aiohttp.ClientWebSocketResponse) -> dict[str, Any]:
    """The next text."""
    while True:
        message = await view.receive(timeout=5)
        if message.type is aiohttp.WSMsgType.TEXT:
            if "command" not in (found := dict(json.loads(message.data))):
                return found
        else:
            assert message.type is aiohttp.WSMsgType.BINARY, message
            await view.send_str("ok")


WILD = [
    '{"action":"move","x":NaN,"y":NaN,"force":1}',
    '{"action":"move","x":1e400,"y":0,"force":1}',
    '{"action":"move","x":0,"y":-Infinity,"force":1}',
    '{"action":"move","x":' + "9" * 400 + ',"y":0,"force":1}',
    "[" * 4000,
    '{"action":"choose","stones":[1e400,1]}',
    '{"action":"delay","seconds":"x"}',
    "[]",
]


def test_wild_messages_are_refused_and_the_finger_is_lifted_at_the_end(
    tmp_path: Path,
) -> None:
    async def talk(view: aiohttp.ClientWebSocketResponse, run: Run) -> None:
        await view.send_str('{"action":"begin"}')
        assert (await answer(view))["begun"]
        await view.send_str('{"action":"move","x":0.02,"y":0.03,"force":1.5}')
        for message in WILD:
            await view.send_str(message)
            assert "refused" in await answer(view), message

    moves = [
        rest
        for word, *rest in play("test-wild-player", tmp_path / "r.jsonl", talk)
        if word == "move"
    ]
    assert moves == [[0.02, 0.03, 1.5], [0.02, 0.03, -1.0]]


def test_an_emergency_stop_ends_only_where_the_page_says_so(tmp_path: Path) -> None:
    async def talk(view: aiohttp.ClientWebSocketResponse, run: Run) -> None:
        stopped = replace(
            run.finger,
            armed=False,
            muted_because="emergency stop: find the cause, then resume",
        )
        run.state = replace(run.state, fingers=(stopped,))
        await asyncio.sleep(0.3)
        await view.send_str('{"action":"begin"}')
        assert (await answer(view))["begun"]
        await asyncio.sleep(0.2)
        assert not run.finger.armed
        # Only a page that has seen what it releases.
        await view.send_str('{"action":"arm"}')
        assert "press again" in (await answer(view))["refused"]
        await view.send_str('{"action":"arm","silenced":0}')
        await asyncio.sleep(0.2)
        assert run.finger.armed

    play("test-stopped-player", tmp_path / "r.jsonl", talk)


def test_rounds_of_a_program_are_not_saved(tmp_path: Path) -> None:
    async def talk(view: aiohttp.ClientWebSocketResponse, run: Run) -> None:
        for _ in range(100):
            await view.send_str('{"action":"begin"}')
            await view.send_str('{"action":"choose","stones":[0,1]}')
            assert (await answer(view))["begun"]

    results = tmp_path / "r.jsonl"
    play("test-fast-player", results, talk)
    assert not results.exists()


def test_names_that_no_file_can_have_are_not_found(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    async def ask(url: str) -> list[int]:
        async with aiohttp.ClientSession() as session:
            found = []
            for name in ("game/play.css", f"game/{'A' * 3000}", "game/%00"):
                async with session.get(url + name) as answer:
                    found.append(answer.status)
            return found

    inbox, finger = Pipe(duplex=False)
    settings = GameSettings("test-names", [ORDER], 7, finger, tmp_path / "r.jsonl")
    with inbox, Run(settings.name), serve_game(settings) as page:
        assert asyncio.run(ask(page.url)) == [200, 404, 404]
    assert "Traceback" not in capfd.readouterr().err
