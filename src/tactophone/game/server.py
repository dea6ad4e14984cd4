"""The stone box's page: pointer in, vibration out, and rounds played over the running chain.

The vibration goes out sample by sample, as the actuator is given it; of what was heard or believed nothing leaves
before the curtain is lifted, unless the trainer is asked.
"""

import asyncio
import datetime
import json
import select
import statistics
import time
from collections.abc import Awaitable, Callable
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import WSMsgType, web
from numpy.typing import NDArray

from tactophone.dashboard.feed import Run
from tactophone.dashboard.message import pack, tick_table
from tactophone.dashboard.server import CREDIT, LARGEST_WISH, page
from tactophone.game.rounds import Box, Point, Round, past, within_reach
from tactophone.telemetry import Request, Snapshot
from tactophone.types import Touch

PERIOD = 0.008
"""Seconds between messages: half a picture, for the sound's sake."""

LONGEST_ROUND = 600.0
"""Seconds whose signals are kept for the last screen."""

SHOWN = 2_000
"""Points of a signal on the last screen."""

TAKEN = 4001
"""WebSocket close code, of the range for applications, that says: opened in another window."""


def stone_box(box: Box) -> web.Application:
    """Build the stone box's page."""
    app = web.Application()
    table = _Table(box)
    app.router.add_get("/", page("play.html"))
    app.router.add_get("/box", table.sit)
    return app


class _Table:
    """Where one player at a time sits; who comes takes the place, who comes back must find it free."""

    def __init__(self, box: Box) -> None:
        self._box = box
        self._run = Run(box.name)
        self._played = 0
        self._seat: web.WebSocketResponse | None = None

    async def sit(self, request: web.Request) -> web.StreamResponse:
        view = web.WebSocketResponse(heartbeat=20, max_msg_size=LARGEST_WISH, compress=False)
        await view.prepare(request)
        if self._seat is not None and not self._seat.closed:
            loser = view if "again" in request.query else self._seat
            await loser.close(code=TAKEN)
            if loser is view:
                return view
        self._seat = view
        player = _Player(self._box, self._run, view, self._played)
        async with asyncio.TaskGroup() as tasks:
            sending = tasks.create_task(player.send())
            await player.receive()
            sending.cancel()
        player.lift()
        self._played = max(self._played, player.played)
        return view


class _Player:
    """One connection: what the player does goes to the finger and to the round, what is felt comes back."""

    def __init__(self, box: Box, run: Run, view: web.WebSocketResponse, played: int) -> None:
        self._box, self._run, self._view = box, run, view
        self._credit = asyncio.Semaphore(CREDIT)
        self._round: Round | None = None
        self._begun = 0.0
        self._last: Snapshot | None = None
        self._ticks: list[NDArray[np.float64]] = []
        self.played = played

    async def receive(self) -> None:
        actions: dict[str, Callable[..., Awaitable[None]]] = {
            "begin": self._begin,
            "move": self._move,
            "choose": self._choose,
            "heard": self._heard,
        }
        async for message in self._view:
            if message.type is not WSMsgType.TEXT:
                continue
            if message.data == "ok":
                self._credit.release()
                continue
            try:
                with_what = json.loads(message.data)
                await actions[with_what.pop("action")](**with_what)
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                await self._view.send_str(json.dumps({"refused": str(error)}))

    async def send(self) -> None:
        """Send what is new of the vibration, for as long as somebody listens."""
        with suppress(ConnectionError):
            while not self._view.closed:
                await self._credit.acquire()
                if (snapshot := self._run.snapshot(self._last)) is None:
                    self._credit.release()
                else:
                    await self._view.send_bytes(self._message(snapshot))
                    self._last = snapshot
                await asyncio.sleep(PERIOD)

    def lift(self) -> None:
        """Take the finger off whatever it is on."""
        last = self._round.path[-1] if self._round and self._round.path else Point(0, 0, 0, 0)
        self._reach(("move", last.x, last.y, -1.0))

    def _message(self, snapshot: Snapshot) -> bytes:
        words: dict[str, Any] = {"alive": snapshot.alive, "armed": snapshot.state.armed}
        if self._round is not None:
            self._keep(snapshot)
            if self._round.trainer and len(snapshot.ticks):
                words["felt"] = Touch(int(snapshot.ticks[-1]["touch"])).name.lower()
                words["truth"] = self._round.truth(self._round.path[-1]).name.lower() if self._round.path else "none"
        # What came before the page looked is over: sound is for now.
        vibration = snapshot.vibration if self._last else snapshot.vibration[:0]
        return pack({**words, "vibration_end": snapshot.vibration_end}, {"vibration": vibration})

    def _keep(self, snapshot: Snapshot) -> None:
        now = time.monotonic()
        if now - self._begun > LONGEST_ROUND or not len(snapshot.ticks):
            return
        table = tick_table(snapshot.ticks, float(snapshot.ticks["time"][-1]))
        table[:, 0] += now - self._begun
        self._ticks.append(table)

    async def _begin(self, trainer: bool = False) -> None:
        seed = self._box.seed + self.played
        order = self._box.orders[self.played % len(self._box.orders)]
        self.played += 1
        self._round = Round(order, seed=seed, trainer=bool(trainer))
        self._begun, self._ticks = time.monotonic(), []
        self._run.ask(Request("arm"))  # beginning is a person's word, should a fault have muted the run
        self._reach(("lay", tuple(int(touch) for touch in order), seed))
        await self._view.send_str(json.dumps({"begun": True, "trainer": self._round.trainer}))

    async def _move(self, x: float, y: float, force: float) -> None:
        point = within_reach(float(x), float(y), float(force), now=time.monotonic())
        self._reach(("move", point.x, point.y, point.force))
        if self._round is not None:
            self._round.touch(point)

    async def _heard(self, delay: float) -> None:
        if self._round is not None and 0 < delay < 5:
            self._round.round_trips.append(float(delay))

    async def _choose(self, stones: list[int]) -> None:
        game, now = self._round, time.monotonic()
        if game is None:
            return
        finished = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        result = game.finish([int(stone) for stone in stones], Point(now, 0, 0, -1), finished=finished)
        result.append(self._box.results)
        self.lift()
        self._round = None
        ticks = np.concatenate([np.empty((0, 10)), *self._ticks])
        words = {"result": asdict(result), "past": _standing(self._box.results), "results": str(self._box.results)}
        await self._view.send_bytes(pack(words, {"ticks": _thin(ticks), "track": _thin(game.track(self._begun))}))

    def _reach(self, message: tuple[object, ...]) -> None:
        """Send to the finger, unless it has stopped listening: a page waits for nobody."""
        if select.select([], [self._box.hand], [], 0)[1]:
            self._box.hand.send(message)


def _thin(table: NDArray[np.float64]) -> NDArray[np.float64]:
    return table[:: len(table) // SHOWN + 1]


def _standing(results: Path) -> dict[str, Any]:
    """How this player, or whoever shares the file, has done so far without the trainer."""
    rounds = [result for result in past(results) if not result.trainer]
    return {
        "rounds": len(rounds),
        "right": sum(result.correct == 2 for result in rounds),
        "median_duration": statistics.median(result.duration for result in rounds) if rounds else None,
    }
