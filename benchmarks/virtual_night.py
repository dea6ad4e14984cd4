"""Both sides of the live system on one virtual clock, with a seed: `runtime.Robot` and
`runtime.Operator` themselves.

A side runs as in its process, but without threads: whoever holds the clock lets each of
its loops turn once. The sound server is asynchronous JACK as the watchdog knows it: it
repeats the last period of a client that is late, until the client goes on, is
disconnected or ends. What is not on the clock stays with the tests of live processes:
how threads take turns, JACK itself, sockets and the kernel's filter, the supervisor's
processes, the clock of the day. Between strokes the robot sends nothing but reports.
"""

import contextlib
import gc
import math
import random
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import psutil

from tactophone.app.replay import Replay
from tactophone.core.settings import Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock, FloatArray
from tactophone.live.audio.actuator import RenderHand
from tactophone.live.log.mcap import McapLog, read_log
from tactophone.live.runtime import operator as operator_side
from tactophone.live.runtime import robot as robot_side
from tactophone.live.runtime import wiring
from tactophone.live.runtime.operator import Operator
from tactophone.live.runtime.pairing import pair_on_one_machine
from tactophone.live.runtime.robot import Robot
from tactophone.live.runtime.supervisor import RESTART_DELAY, ProcessInfo, Side
from tactophone.live.runtime.watchdog import Verdict, Watchdog
from tactophone.live.telemetry import memory
from tactophone.live.telemetry.layout import Request
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.packet import Address

STEP = 0.005
"""Seconds of virtual time in a step while something happens."""

QUIET_STEP = 0.45
"""Seconds of virtual time in a step while nothing happens and only reports keep the
link."""

LIVELY = 4.0
"""Seconds after an event in which steps are short."""

PERIOD = 240
"""Samples of a period of the sound server: a step."""

SOUND_SIZE = 500
"""Bytes from which a datagram holds sound."""

SOON = 0.1
"""Seconds within which every fault and every stop is silence."""

CONCEALED = 0.02
"""Seconds of sound that may stand for lost packets, and lead to commands, before the
link falls silent."""

LONGEST_RECONNECTION = 3.0
"""Seconds of a usable way after which both sides are connected."""

GROWTH = 60.0
"""Megabytes that the process may grow in the last three quarters of a night, whose
restarts leave telemetry behind."""

EVENTS = (
    "network",
    "network",
    "no way,",
    "address of robot,",
    "kill",
    "freeze",
    "freeze",
    "sleep of",
    "",
    "",
    "",
)

TONE = np.tile(
    (0.3 * np.sin(2 * np.pi * 300 * np.arange(PERIOD * 2) / LIVE_SAMPLE_RATE)).astype(
        np.float32
    )[:, None],
    (1, 2),
)


class BrokenPromiseError(AssertionError):
    """What was promised, and when in the night it did not hold."""


@dataclass
class Port:
    """A side's socket: what waits to be read, and what goes out; a context manager."""

    address: Address
    waiting: list[tuple[bytes, Address]] = field(default_factory=list)
    sent: list[tuple[bytes, Address]] = field(default_factory=list)
    turned: Callable[[], None] = lambda: None

    def __enter__(self) -> "Port":
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def receive(self, _: float) -> list[tuple[bytes, Address]]:
        self.turned()  # the loop that asks ends after this turn
        found, self.waiting = self.waiting[:256], self.waiting[256:]
        return found

    def follow(self, _: object) -> None:
        """Prefer no peer: there are no strangers here."""

    def send(self, datagrams: Sequence[tuple[bytes, Address]]) -> None:
        self.sent += datagrams


class Server:
    """A client of the sound server: an `Actuator` and its device."""

    xruns = process_faults = losses = 0
    sample_rate, latency, fault = LIVE_SAMPLE_RATE, 0.01, ""

    def __init__(self, render: RenderHand) -> None:
        self.device, self._render = self, render
        self.connected = True
        self.last = np.zeros(PERIOD, np.float32)

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *_: object) -> None:
        self.connected = False

    @property
    def lost(self) -> bool:
        return not self.connected

    def revive(self) -> None:
        """Join again, as `JackClient.revive` does once its process goes on."""
        self.connected = True

    def period(self, *, on_time: bool) -> FloatArray:
        """Return what the actuator plays in the next period."""
        if not self.connected:
            self.last = np.zeros(PERIOD, np.float32)
        elif on_time:
            self.last = np.empty(PERIOD, np.float32)
            self._render([self.last])
        return self.last


class Strokes(AlwaysOpen):
    """The robot's source: the night pushes its sound."""

    sample_rate, channels = LIVE_SAMPLE_RATE, 2

    def __init__(self, _: Settings) -> None:
        pass

    def __iter__(self) -> Iterator[AudioBlock]:
        return iter(())


@dataclass
class Machine:
    """One side's machine: its process, perhaps frozen or gone, its socket, and its
    clock, which stands in sleep."""

    address: Address
    begun: float
    side: Any = None
    port: Port = field(default_factory=lambda: Port(("", 0)))
    frozen_until: float = 0.0
    starts_at: float = 0.0
    slept: float = 0.0
    asleep_until: float = 0.0
    restarts: int = 0

    def runs(self, now: float) -> bool:
        return (
            self.side is not None
            and now >= self.frozen_until
            and now >= self.asleep_until
        )


class Night:
    """``hours`` of virtual time with ``sound`` seconds of sound; `run` raises
    `BrokenPromiseError`."""

    def __init__(self, seed: int, *, hours: float, sound: float, folder: Path) -> None:
        self._dice, self.seed, self._hours, self._sound = (
            random.Random(seed),
            seed,
            hours,
            sound,
        )
        self._folder, self._name = folder, f"night-{threading.get_native_id()}-{seed}"
        chosen = [
            "detector.model=paper",
            "detector.threshold_dbfs=-26",
            "detector.check_microphones=false",
        ]
        settings = change(Settings(), [*chosen, "link.codec=pcm16"])
        robot, operator = pair_on_one_machine(
            settings, folder / "keys", name=self._name
        )
        self._settings = {"robot": robot, "operator": operator}
        called: Address = ("127.0.0.1", operator.link.port)
        self.now = 1_000.0
        self._machines = {
            "robot": Machine(("192.0.2.1", 5_000), self._dice.uniform(0, 1e5)),
            "operator": Machine(called, self._dice.uniform(0, 1e5)),
        }
        self._way: dict[str, ImpairedLink] = {}
        self._way_until = 0.0
        self._lively_until = self._usable_since = self.now + LIVELY
        self._quiet_since, self._armed = -math.inf, True
        self._unheard = self._uncommanded = 0.0
        self._command: object = None
        self._lowered_at = -math.inf
        self.felt = self.events = 0
        self.story = ""
        self._position = self.compared = 0
        self._frozen_for, self._checked_at, self._turned_at = 0.0, self.now, self.now
        self._watchdog = Watchdog()
        self._freeze_at = self._dice.randrange(10, 40)

    def run(self) -> None:
        """Live through the night, and then replay its log."""
        before = 0.0
        with contextlib.ExitStack() as stack:
            self._stack = stack
            stack.enter_context(self._virtual())
            self._change_network()
            self._start("operator")
            self._start("robot")
            log = stack.enter_context(McapLog(self._name, self._folder / "night.mcap"))
            strokes, events = self._plan()
            end = self.now + 3600 * self._hours
            read_at = 0.0
            while self.now < end:
                while events and events[0] <= self.now:
                    events.pop(0)
                    self._happen()
                stroke = bool(strokes) and strokes[0][0] <= self.now < strokes[0][1]
                if strokes and self.now >= strokes[0][1]:
                    strokes.pop(0)
                short = stroke or self.now < self._lively_until
                following = min(
                    [end, *(begin for begin, _ in strokes[:1]), *events[:1]]
                )
                step = (
                    STEP if short else min(QUIET_STEP, max(STEP, following - self.now))
                )
                self.now = round(self.now + step, 5)
                self._turn(stroke)
                if not before and self.now > end - 2700 * self._hours:
                    before = _memory()
                if self.now - read_at > (0.5 if short else 5.0):
                    read_at = self.now
                    log.read()
            for name in self._machines:
                self._kill(name)
            log.read()
            log.read()
        for name in self._machines:
            self._forget(name)
        grown = _memory() - before
        self.grown = grown
        self._promise(grown < GROWTH, f"memory grew by {grown:.0f} MB")
        self._replay()

    def _promise(self, kept: bool, what: str) -> None:
        if not kept:
            raise BrokenPromiseError(
                f"seed {self.seed}, {self.now - 1_000:.3f} s into the night: {what}; "
                f"{self.story}"
            )

    def _plan(self) -> tuple[list[tuple[float, float]], list[float]]:
        """Return the spans with sound, and the moments of events: most of them within
        or just after a stroke."""
        strokes, left, span = [], self._sound, 3600 * self._hours
        while left > 0.01:
            length = min(left, self._dice.uniform(0.3, 2.0))
            begin = self.now + self._dice.uniform(LIVELY, span - 3)
            strokes.append((begin, begin + length))
            left -= length
        strokes.sort()
        events = [
            begin + self._dice.uniform(-0.5, end - begin + 0.5)
            for begin, end in strokes
            for _ in range(self._dice.choice((1, 1, 2)))
        ]
        events += [
            self.now + self._dice.uniform(1, span)
            for _ in range(round(4 * self._hours) + 2)
        ]
        return strokes, sorted(events)

    def _happen(self) -> None:
        """Let something happen that happens in a night."""
        self.events += 1
        self._lively_until = self.now + LIVELY
        which, machine = self._dice.choice(list(self._machines.items()))
        event = self._dice.randrange(11)
        match event:
            case 0 | 1:
                self._change_network()
            case 2:
                self._way_until = self.now + self._dice.choice(
                    (0.2, 1.0, 4.0, 30.0, 600.0)
                )
                self._lively_until = (
                    self._way_until + LIVELY
                    if self._way_until < self.now + 60
                    else self.now + LIVELY
                )
            case 3:
                self._machines["robot"].address = (
                    f"192.0.2.{self._dice.randrange(1, 250)}",
                    5_000,
                )
            case 4:
                self._kill(which)
                machine.starts_at = self.now + RESTART_DELAY + self._dice.uniform(0, 2)
            case 5 | 6:
                machine.frozen_until = self.now + self._dice.choice(
                    (0.02, 0.08, 0.5, 1.5, 4.0)
                )
            case 7:
                machine.asleep_until = self.now + self._dice.choice((2.0, 60.0, 1800.0))
            case 8:
                self._ask(Request("stop"))
            case 9:
                self._ask(Request("mute"))
            case _:
                self._ask(
                    Request("ceiling", self._dice.choice((0.0, 0.05, 0.3, 0.5, 0.9)))
                )
        self._tell(f"{EVENTS[event]} {which}" if EVENTS[event] else "request")
        if self._dice.random() < 0.6:
            self._ask(Request("arm"))
            if self._dice.random() < 0.5:
                self._ask(Request("ceiling", 0.5))

    def _tell(self, what: str) -> None:
        self.story = "; ".join(
            [*self.story.split("; ")[-3:], f"{self.now - 1_000:.3f} {what}"]
        )

    def _change_network(self) -> None:
        dice = self._dice
        profile = NetworkProfile(
            loss=dice.choice((0.0, 0.01, 0.05)),
            burst=dice.choice((1.0, 2.0)),
            delay=dice.choice((0.0, 0.005, 0.04)),
            jitter=dice.choice((0.0, 0.002)),
            duplicates=dice.choice((0.0, 0.02)),
            overtaking=dice.random() < 0.5,
        )
        self._tell(f"{profile.loss:g} of {profile.burst:g} lost, {profile.delay:g} s")
        self._way = {
            name: ImpairedLink(profile, seed=dice.randrange(1 << 30))
            for name in self._machines
        }

    @contextmanager
    def _virtual(self) -> Iterator[None]:
        """Give both sides this clock, these sockets and this sound server, and no
        threads."""
        self._clock = self.now

        def clock() -> float:
            return self._clock

        def nothing(*_: object, **__: object) -> str:
            return ""

        def unstarted(*_: object) -> threading.Thread:
            return threading.Thread()

        def port(name: str) -> Callable[..., Port]:
            return lambda *_, **__: self._machines[name].port

        def actuator(_: Settings, render: RenderHand, **__: object) -> Server:
            return Server(render)

        with contextlib.ExitStack() as stack:
            for where, name, instead in (
                (time, "monotonic", clock),
                (Side, "_start", unstarted),
                (Side, "_prepare_thread", nothing),
                (robot_side, "name_thread", nothing),
                (robot_side, "prioritize_thread", nothing),
                (operator_side, "UdpSocket", port("operator")),
                (robot_side, "UdpSocket", port("robot")),
                (wiring, "open_actuator", actuator),
                (wiring, "REHEARSAL", 0.01),
            ):
                stack.enter_context(mock.patch.object(where, name, instead))
            yield

    def _as(self, machine: Machine) -> float:
        """Set the clock to a machine's, and return its time."""
        self._clock = round(machine.begun + self.now - machine.slept, 5)
        return self._clock

    def _start(self, name: str) -> None:
        machine = self._machines[name]
        self._as(machine)
        machine.port = Port(machine.address)
        self._forget(name)
        info = ProcessInfo(self._run_of(name), machine.restarts)
        if name == "robot":
            side: Any = Robot(self._settings[name], info, open_source=Strokes)
        else:
            side = Operator(self._settings[name], info)
            self._watchdog, self._armed = Watchdog(), not machine.restarts
            self._quiet_since = self.now if machine.restarts else -math.inf
        side.__enter__()
        machine.side, machine.port.turned = side, side.ended.set
        machine.frozen_until, machine.restarts = 0.0, machine.restarts + 1

    def _forget(self, name: str) -> None:
        """Remove the telemetry of a process that was killed: `remove_memory` sees that
        this one lives."""
        (memory.folder() / f"{memory.PREFIX}{self._run_of(name)}").unlink(
            missing_ok=True
        )

    def _run_of(self, name: str) -> str:
        return self._name if name == "operator" else f"{self._name}-robot"

    def _kill(self, name: str) -> None:
        """End a process as SIGKILL does: nothing of it is called any more."""
        machine = self._machines[name]
        machine.side, machine.starts_at = None, math.inf
        machine.port = Port(machine.address)
        if name == "operator":
            self._quiet_since, self._armed = (
                min(self._quiet_since, self.now) if not self._armed else self.now,
                False,
            )

    def _ask(self, request: Request) -> None:
        """Ask the operator's process; a frozen one is not asked."""
        machine = self._machines["operator"]
        if not machine.runs(self.now):
            return
        side: Operator = machine.side
        self._as(machine)
        refused = [
            action for finger in side._fingers for action in finger.apply([request])
        ]
        self._promise(
            bool(refused) == (request.action == "ceiling" and request.value > 0.5),
            f"{request} {refused}",
        )
        if request.action in ("stop", "mute") and self._armed:
            self._armed, self._quiet_since = False, self.now
        elif request.action == "arm":
            self._armed = True
        elif request.action == "ceiling" and not refused:
            self._lowered_at = self.now

    def _turn(self, stroke: bool) -> None:
        """Let each side's loops turn once, and hold what comes out to the promises."""
        for name, machine in self._machines.items():
            if machine.side is None and self.now >= machine.starts_at:
                self._start(name)
                self._lively_until = max(self._lively_until, self.now + LIVELY)
        self._sleep()
        robot, operator = self._machines["robot"], self._machines["operator"]
        if stroke:
            self._lively_until = max(self._lively_until, self.now + 5 * SOON)
            start = self._position % PERIOD
            if robot.runs(self.now):
                self._as(robot)
                robot.side._send(
                    AudioBlock(
                        TONE[start : start + PERIOD], LIVE_SAMPLE_RATE, self._position
                    )
                )
            self._position += PERIOD
        for back in (False, True):
            self._carry(back)
        self._check_connection(robot, operator)
        self._check_vibration(operator)

    def _sleep(self) -> None:
        """Take the time that a machine slept off its clock."""
        for machine in self._machines.values():
            if machine.asleep_until and self.now < machine.asleep_until:
                machine.slept += self.now - self._turned_at
            elif machine.asleep_until:
                machine.asleep_until = 0.0
                self._lively_until = max(self._lively_until, self.now + LIVELY)
        self._turned_at = self.now

    def _carry(self, back: bool) -> None:
        """Take the datagrams of both sides over the network, and let their loops read
        what arrived."""
        dead = self.now < self._way_until
        for name, other in (("robot", "operator"), ("operator", "robot")):
            machine, peer = self._machines[name], self._machines[other]
            sent, machine.port.sent = machine.port.sent, []
            for datagram, target in sent:
                # What goes to an address that its machine has no longer is lost.
                if not dead and (other == "operator" or target == peer.address):
                    self._way[name].push(datagram, now=self.now)
            for datagram in self._way[name].pull(self.now):
                if not dead and peer.side is not None and self.now >= peer.asleep_until:
                    peer.port.waiting.append((datagram, machine.address))
                    if other == "operator" and len(datagram) > SOUND_SIZE:
                        self._unheard = 0.0
        for machine in self._machines.values():
            if machine.runs(self.now):
                now = self._as(machine)
                side = machine.side
                side.ended.clear()
                side._follow_network(0) if isinstance(
                    side, Robot
                ) else side._follow_network()
                side.ended.clear()
                if back:
                    side.housekeep(now)

    def _check_connection(self, robot: Machine, operator: Machine) -> None:
        usable = (
            robot.runs(self.now)
            and operator.runs(self.now)
            and self.now >= self._way_until
        )
        if not usable:
            self._usable_since = math.inf
            return
        if math.isinf(self._usable_since):
            self._usable_since, self._lively_until = (
                self.now,
                max(self._lively_until, self.now + LIVELY),
            )
        connected = robot.side._group.peers and operator.side._session.peer
        waited = self.now - self._usable_since
        self._promise(
            bool(connected) or waited <= LONGEST_RECONNECTION,
            f"not connected after {waited:.2f} s",
        )

    def _check_vibration(self, machine: Machine) -> None:
        side, now = machine.side, self.now
        if side is None:
            return
        server: Server = side._actuator
        awake = now >= machine.asleep_until
        out = (
            server.period(on_time=machine.runs(now))
            if awake
            else np.zeros(PERIOD, np.float32)
        )
        if awake and side._watcher is not None:
            match self._watchdog.check(side._watcher.pulse(), now=now):
                case Verdict.LATE:
                    server.connected, server.losses = False, server.losses + 1
                case Verdict.STALLED:
                    self._kill("operator")
                    machine.starts_at = now + RESTART_DELAY
        peak = float(np.abs(out).max())
        gate = side._fingers[0].gate
        self._promise(peak <= 0.5 + 1e-6, f"a peak of {peak:.3f}")
        if now - self._lowered_at > SOON:
            self._promise(
                peak <= gate.limits.ceiling + 1e-5,
                f"{peak:.3f} over the ceiling {gate.limits.ceiling}",
            )
        self._promise(
            self._armed == gate.armed or not machine.runs(now),
            f"armed: {gate.armed}, not {self._armed}",
        )
        if not self._armed and now - self._quiet_since > SOON:
            self._promise(peak == 0.0, f"{peak:.3f} while stopped")
        # Samples count, not time: what was frozen or asleep goes on with its fade where
        # it stood.
        passed = STEP * machine.runs(now)
        fresh = side._fingers[0].renderer._slot is not self._command
        self._command = side._fingers[0].renderer._slot
        self._unheard, self._uncommanded = (
            self._unheard + passed,
            0.0 if fresh else self._uncommanded + passed,
        )
        self._promise(
            peak == 0.0 or self._uncommanded <= SOON,
            f"{peak:.3f} {self._uncommanded:.3f} s after a command",
        )
        heard = self._unheard <= SOON + CONCEALED
        self._promise(
            peak == 0.0 or heard,
            f"{peak:.3f} {self._unheard:.3f} s after the last sound",
        )
        if now < machine.frozen_until:
            self._frozen_for = self._frozen_for + now - self._checked_at
        else:
            self._frozen_for = 0.0
        self._promise(
            peak == 0.0 or self._frozen_for <= SOON, f"{peak:.3f} of a frozen process"
        )
        self._checked_at = now
        self.felt += peak > 0.01
        # Once a night in the middle of a vibration, which only the watchdog can end.
        if self.felt == self._freeze_at:
            self._freeze_at, machine.frozen_until = -1, now + 0.15
            self._tell("freeze while it vibrates")

    def _replay(self) -> None:
        replay = Replay(read_log(self._folder / "night.mcap"))
        for _ in replay.steps():
            pass
        self._promise(
            replay.comparison.different == 0,
            f"replay: {replay.comparison.different} predictions differ",
        )
        self.compared = replay.comparison.equal


def _memory() -> float:
    """Megabytes of this process, without what it could forget."""
    gc.collect()
    return float(psutil.Process().memory_info().rss / 2**20)


def live_through(seed: int, *, hours: float, sound: float) -> Night:
    """Run the night of a seed; raises `BrokenPromiseError`."""
    folder = Path(tempfile.mkdtemp(prefix="tactophone-night-"))
    try:
        night = Night(seed, hours=hours, sound=sound, folder=folder)
        night.run()
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    return night
