"""The game's page: pointer in, vibration out, and rounds played over the running
system.

The page receives the vibration sample by sample, as the actuator does. Sound,
predictions and the order of the stones stay on the server until the curtain is lifted,
except with the trainer.
"""

import asyncio
import datetime
import json
import select
import statistics
import time
from collections.abc import Awaitable, Callable
from dataclasses import asdict, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
from aiohttp import WSMsgType, web
from numpy.typing import NDArray

from tactophone.core.types import Touch
from tactophone.faces.web.dashboard import SILENCED_SINCE
from tactophone.faces.web.devices import answer_time, command_of
from tactophone.faces.web.feed import STEP_COLUMNS, WatchedRun, pack, step_table
from tactophone.faces.web.views import (
    CREDIT,
    TAKEN,
    add_files,
    admit,
    exchange,
    is_local,
    messages_of,
    page,
    say_command,
)
from tactophone.live.telemetry.layout import Action, Request
from tactophone.live.telemetry.watcher import Snapshot
from tactophone.signal.perception.decision import count_bumps, count_dips
from tactophone_lab.game.stone_box import (
    GameSettings,
    Point,
    Round,
    read_results,
    within_reach,
)

STATIC = files("tactophone_lab.game") / "static"
"""The page; what it shares with others comes from `tactophone.faces.web`."""

GAME_PERIOD = 0.004
"""Seconds between messages: they carry sound, and what waits here is felt late."""

EXPECTED_START = 15.0
"""Seconds that a start takes at most, once the simulation is compiled and kept in the
user's cache."""

SHORTEST_ROUND = 0.5
"""Seconds; shorter rounds are a program's, and are not saved: it would fill the
disk."""

LONGEST_ROUND = 600.0
"""Seconds whose signals and path are kept for the last screen."""

SHOWN = 2_000
"""Points of a signal on the last screen."""


def game_application(game: GameSettings) -> web.Application:
    app = web.Application()
    app.router.add_get("/", page(STATIC / "play.html"))
    add_files(app, "/game", STATIC)
    app.router.add_get("/player", _PlayerSlot(game).connect)
    return app


class _PlayerSlot:
    """The place of the one player: a new window takes it over, a window that reconnects
    must find it free."""

    def __init__(self, game: GameSettings) -> None:
        self._game = game
        self._run = WatchedRun(game.name)
        self._played = 0
        self._view: web.WebSocketResponse | None = None

    async def connect(self, request: web.Request) -> web.StreamResponse:
        view = await admit(request, (), 1)
        if view is None:
            return web.Response()
        if self._view is not None and not self._view.closed:
            loser = view if "again" in request.query else self._view
            await loser.close(code=TAKEN)
            if loser is view:
                return view
        self._view = view
        await say_command(view, request)
        player = _Player(
            self._game, self._run, view, self._played, local=is_local(request)
        )
        try:
            await exchange(
                view,
                player.message,
                player.receive(),
                credit=player.credit,
                interval=GAME_PERIOD,
            )
        finally:
            player.lift()
            self._played = max(self._played, player.played)
        return view


class _Player:
    """A connection: the player's actions go to the finger and the round, the vibration
    comes back."""

    def __init__(
        self,
        game: GameSettings,
        run: WatchedRun,
        view: web.WebSocketResponse,
        played: int,
        *,
        local: bool,
    ) -> None:
        self._game = game
        self._run = run
        self._view = view
        self.credit = asyncio.Semaphore(CREDIT)
        self._round: Round | None = None
        self._begun = 0.0
        self._last: Snapshot | None = None
        self._steps: list[NDArray[np.float64]] = []
        self.played = played
        self._local = local
        self._opened = time.monotonic()

    async def receive(self) -> None:
        actions: dict[str, Callable[..., Awaitable[None]]] = {
            "begin": self._begin,
            "move": self._move,
            "choose": self._choose,
            "delay": self._delay,
            "time": self._time,
            **{
                action: partial(self._request, action)
                for action in ("stop", "mute", "arm")
            },
        }
        async for message in messages_of(self._view):
            if message.type is not WSMsgType.TEXT:
                continue
            if message.data == "ok":
                self.credit.release()
                continue
            try:
                arguments = json.loads(message.data)
                await actions[arguments.pop("action")](**arguments)
            except (
                ValueError,
                TypeError,
                KeyError,
                AttributeError,
                OverflowError,
                RecursionError,
            ) as error:
                await self._view.send_str(json.dumps({"refused": str(error)}))

    async def _request(self, action: Action, silenced: int = -1) -> None:
        if action == "arm" and not self._local:
            raise ValueError("only a page on the run's own machine may arm")
        if action == "arm" and silenced != self._run.silenced:
            raise ValueError(SILENCED_SINCE)
        self._run.ask(Request(action))

    def message(self) -> bytes:
        """Return the vibration since the last message; empty while there is no run."""
        if (snapshot := self._run.snapshot(self._last)) is None:
            return b""
        message = self._message(snapshot)
        self._last = snapshot
        return message

    def lift(self) -> None:
        here = self._round.here if self._round else None
        last = here or Point(0, 0, 0, 0)
        self._command(("move", last.x, last.y, -1.0))

    def _message(self, snapshot: Snapshot) -> bytes:
        # The operator's side starts before the robot's: a round can begin when sound
        # has arrived.
        started = snapshot.alive and snapshot.step_end > 0
        header: dict[str, Any] = {
            **command_of(snapshot, self._last),
            "alive": started,
            "silenced": self._run.silenced,
            "made": time.monotonic(),
            "starting": "" if started else starting(time.monotonic() - self._opened),
        }
        if self._round is not None:
            self._keep(snapshot)
            if self._round.trainer and len(snapshot.steps):
                header["detected"] = Touch(
                    int(snapshot.steps[-1]["touch"])
                ).name.lower()
                here = self._round.here
                truth = self._round.truth(here) if here else Touch.NONE
                header["truth"] = truth.name.lower()
        # A page plays only what follows its first message; older vibration is out of
        # date.
        vibration = snapshot.vibration if self._last else snapshot.vibration[:0]
        return pack(
            {**header, "vibration_end": snapshot.vibration_end},
            {"vibration": vibration},
        )

    @property
    def _keeps(self) -> bool:
        """Whether what happens is still kept for the round's pictures and results."""
        return time.monotonic() - self._begun <= LONGEST_ROUND

    def _keep(self, snapshot: Snapshot) -> None:
        if not self._keeps or not len(snapshot.steps):
            return
        table = step_table(snapshot.steps, float(snapshot.steps["time"][-1]))
        table[:, 0] += time.monotonic() - self._begun
        self._steps.append(table)

    async def _begin(self, trainer: bool = False) -> None:
        seed = self._game.seed + self.played
        order = self._game.orders[self.played % len(self._game.orders)]
        self.played += 1
        self._round = Round(order, seed=seed, trainer=bool(trainer))
        self._begun = time.monotonic()
        self._steps = []
        self._command(("lay", tuple(int(touch) for touch in order), seed))
        await self._view.send_str(
            json.dumps({"begun": True, "trainer": self._round.trainer})
        )

    async def _move(self, x: float, y: float, force: float) -> None:
        point = within_reach(float(x), float(y), float(force), now=time.monotonic())
        self._command(("move", point.x, point.y, point.force))
        if self._round is not None:
            self._round.touch(point, kept=self._keeps)

    async def _time(self, time: float) -> None:
        await self._view.send_str(answer_time(json.dumps({"time": time})))

    async def _delay(self, seconds: float) -> None:
        plausible = 0 < seconds < 5
        if self._round is not None and plausible and self._keeps:
            self._round.round_trips.append(float(seconds))

    async def _choose(self, stones: list[int]) -> None:
        played = self._round
        now = time.monotonic()
        if played is None:
            return
        finished = datetime.datetime.now().astimezone().isoformat(timespec="seconds")
        result = played.finish(
            [int(stone) for stone in stones], Point(now, 0, 0, -1), finished=finished
        )
        steps = np.concatenate([np.empty((0, 1 + len(STEP_COLUMNS))), *self._steps])
        touch, truth = (
            steps[:, 1 + STEP_COLUMNS.index(name)] for name in ("touch", "truth")
        )
        bumps = count_bumps(touch == Touch.ROUGH, truth == Touch.SMOOTH)
        result = replace(
            result,
            false_bumps=bumps,
            dips=count_dips(touch == Touch.ROUGH, truth == Touch.ROUGH),
        )
        kept = f"Saved in {self._game.results}"
        try:
            if now - self._begun < SHORTEST_ROUND:
                kept = "Not saved: nobody plays that fast"
            else:
                result.append(self._game.results)
        except OSError as error:  # the round is shown all the same
            kept = f"Not saved in {self._game.results}: {error.strerror}"
        self.lift()
        self._round = None
        header = {
            "result": asdict(result),
            "past": _summary(self._game.results),
            "kept": kept,
        }
        await self._view.send_bytes(
            pack(
                header,
                {"steps": _thin(steps), "track": _thin(played.track(self._begun))},
            )
        )

    def _command(self, message: tuple[object, ...]) -> None:
        """Send to the finger, unless the pipe is full: the page never waits."""
        if select.select([], [self._game.finger], [], 0)[1]:
            self._game.finger.send(message)


def starting(seconds: float) -> str:
    """Return what the page says while the simulated finger starts: what is done, and
    for how long already."""
    first = (
        " The first start on a machine compiles it, for about a minute."
        if seconds > EXPECTED_START
        else ""
    )
    return f"The simulated finger starts: {seconds:.0f} s.{first}"


def _thin(table: NDArray[np.float64]) -> NDArray[np.float64]:
    return table[:: len(table) // SHOWN + 1]


def _summary(path: Path) -> dict[str, Any]:
    """Summarize the rounds of a results file that were played without the trainer."""
    rounds = [result for result in read_results(path) if not result.trainer]
    return {
        "rounds": len(rounds),
        "right": sum(result.correct == 2 for result in rounds),
        "median_duration": statistics.median(result.duration for result in rounds)
        if rounds
        else None,
    }
