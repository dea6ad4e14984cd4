"""After any stall, on either side or on the link, sound is fresh again within 0.3 s: in
virtual time, and with processes that are stopped."""

import os
import random
import signal
import threading
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from benchmarks.failsafe import EndlessStroke
from benchmarks.virtual_link import OPERATOR_ADDRESS, ROBOT_ADDRESS, paired_sessions
from tactophone.core.settings import Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock
from tactophone.live.audio.pacing import paced
from tactophone.live.runtime.operator import run_operator
from tactophone.live.runtime.pairing import pair_on_one_machine
from tactophone.live.runtime.priority import MAIN_PRIORITY, prioritize_thread
from tactophone.live.runtime.robot import run_robot
from tactophone.live.runtime.supervisor import Supervisor, supervised
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.codec import Codec
from tactophone.net.link.events import Connected
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import RECALL_AFTER
from tactophone.net.link.stream import SOUND_STALE_AFTER, DecodedAudio

BLOCK = 128
RECOVERY = 0.3
"""Seconds after the end of a stall by which all sound must be fresh."""

TICK = 0.0025


class World:
    """A robot that plays a source, a link and an operator; each of them stands still
    during its own stalls.

    Datagrams wait where a real system keeps them: on the link, or in the receiver's
    socket. A machine ``asleep`` during its stalls receives nothing, and its monotonic
    clock stands still too.
    """

    def __init__(
        self, stalls: dict[str, tuple[tuple[float, float], ...]], *, asleep: str = ""
    ) -> None:
        self.now = 0.0
        self.stalls, self.asleep = stalls, asleep
        self.robot: SendGroup
        self.robot, self.operator = paired_sessions(
            Codec("pcm16", channels=1, packet_size=240)
        )
        self.to_operator: list[tuple[bytes, tuple[str, int]]] = []
        self.to_robot: list[tuple[bytes, tuple[str, int]]] = []
        self.decoded: list[tuple[float, DecodedAudio]] = []
        self.connections = 0
        self.began: float | None = None
        self.pulling, self.next_pull = False, 0.0
        self.queues: list[tuple[float, float]] = []

    def stalled(self, part: str) -> bool:
        return any(start <= self.now < end for start, end in self.stalls.get(part, ()))

    def clock(self, part: str) -> float:
        spans = self.stalls[part] if part == self.asleep else ()
        return self.now - sum(
            max(0.0, min(self.now, end) - start) for start, end in spans
        )

    def sleep(self, duration: float) -> None:
        """Let the world go on while the robot's sound thread sleeps; it wakes no
        earlier than its own stall ends."""
        until = self.now + duration
        while self.now < until or self.stalled("robot"):
            self.now += (
                TICK
                if self.stalled("robot")
                else min(TICK, max(1e-6, until - self.now))
            )
            self.step()

    def step(self) -> None:
        if not self.stalled("robot"):
            if not self.stalled("link"):
                self.robot.receive(self.to_robot, now=self.clock("robot"))
                self.to_robot = []
            self.robot.poll(self.clock("robot"))
            self.to_operator += [
                (datagram, ROBOT_ADDRESS)
                for datagram, _ in self.robot.members[0].session.outgoing()
            ]
        if not (self.stalled("link") or self.stalled("operator")):
            now = self.clock("operator")
            events = [
                *self.operator.receive(self.to_operator, now=now),
                *self.operator.poll(now),
            ]
            self.to_operator = []
            self.connections += sum(isinstance(event, Connected) for event in events)
            self.decoded += [
                (self.now, event) for event in events if isinstance(event, DecodedAudio)
            ]
            self.to_robot += [
                (datagram, OPERATOR_ADDRESS)
                for datagram, _ in self.operator.session.outgoing()
            ]
            if self.pulling and self.now >= self.next_pull:
                self.pull()
        if self.asleep and self.stalled(self.asleep):
            self.to_operator, self.to_robot = [], []

    def pull(self) -> None:
        """Render a block, and note the seconds of sound that then wait; a device that
        was late leaves blocks out."""
        self.next_pull = max(self.next_pull + BLOCK / LIVE_SAMPLE_RATE, self.now)
        self.operator.pull(BLOCK, now=self.clock("operator"))
        playout = self.operator.playout
        if playout is not None and playout._position is not None:
            newest = max(
                (waiting.end for waiting in playout._waiting.values()),
                default=playout._position,
            )
            self.queues.append(
                (self.now, (newest - playout._position) / LIVE_SAMPLE_RATE)
            )

    def run(self, duration: float) -> None:
        while not self.robot.peers or self.operator.peer is None:
            self.sleep(TICK)
        # Only now, as a recording is held back until the operator is there.
        self.began = self.now
        for block in paced(
            source(duration),
            skip=True,
            clock=lambda: self.clock("robot"),
            sleep=self.sleep,
        ):
            self.robot.push(block)
            self.step()
            if self.now > self.began + duration:
                return


def source(duration: float) -> Iterator[AudioBlock]:
    for start in range(0, round(duration * LIVE_SAMPLE_RATE), BLOCK):
        yield AudioBlock(np.zeros((BLOCK, 1), np.float32), LIVE_SAMPLE_RATE, start)


def stale_after(world: World, end: float) -> list[float]:
    """Seconds after the end of a stall at which sound was still stale."""
    return [now - end for now, audio in world.decoded if audio.stale and now > end]


@pytest.mark.slow
@pytest.mark.parametrize("duration", [0.02, 0.05, 0.08, 0.12, 0.2, 0.5, 0.95, 1.4, 2.0])
@pytest.mark.parametrize("part", ["robot", "link", "operator"])
def test_sound_is_fresh_again_soon_after_any_stall(part: str, duration: float) -> None:
    world = World({part: ((1.5, 1.5 + duration),)})
    world.run(4.5)
    assert max(stale_after(world, 1.5 + duration), default=0.0) < RECOVERY
    fresh = [
        now for now, audio in world.decoded if not audio.stale and now > 1.5 + duration
    ]
    assert fresh[0] - (1.5 + duration) < RECOVERY
    # From then on nothing is missing: a fresh packet every 5 ms.
    late = [now for now in fresh if now > 1.5 + duration + RECOVERY]
    assert np.diff(late).max() < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("part", ["robot", "link", "operator"])
@pytest.mark.parametrize("duration", [1.2, 2.0, 3.5])
def test_the_stream_goes_on_after_a_stall_in_which_the_robot_called_again(
    part: str, duration: float
) -> None:
    """A stream that began anew would count its times from 0, and every log of the run
    would be off."""
    world = World({part: ((1.5, 1.5 + duration),)})
    world.run(3.0 + duration)
    assert world.connections == 1
    starts = [audio.block.start for _, audio in world.decoded]
    assert starts == sorted(starts)
    assert starts[-1] / LIVE_SAMPLE_RATE == pytest.approx(3.0 + duration, abs=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["robot", "operator"])
@pytest.mark.parametrize("duration", [0.3, 3.0, 10.0])
def test_sound_is_fresh_again_soon_after_a_machine_slept(
    part: str, duration: float
) -> None:
    end = 1.5 + duration
    world = World({part: ((1.5, end),)}, asleep=part)
    world.run(end + 4.0)
    # The other end may have hung up, which this one finds out when nobody answers for a
    # second.
    recovered = end + RECALL_AFTER + RECOVERY
    fresh = [now for now, audio in world.decoded if not audio.stale and now > recovered]
    assert stale_after(world, recovered) == []
    assert fresh[0] < recovered + 0.03
    assert np.diff(fresh).max() < 0.03


def test_times_go_on_after_a_stall_that_ended_the_session() -> None:
    """After more than five seconds the stream is a new one; in a log, its times still
    belong to one run."""
    world = World({"robot": ((1.5, 8.5),)})
    world.run(10.5)
    assert world.connections == 2
    starts = [audio.block.start for _, audio in world.decoded]
    assert starts == sorted(starts)
    assert starts[-1] / LIVE_SAMPLE_RATE == pytest.approx(10.5, abs=0.2)
    assert world.robot.origin is not None
    sent = (world.operator.origin + starts[-1] - world.robot.origin) % (1 << 32)
    assert sent / LIVE_SAMPLE_RATE == pytest.approx(10.5, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["robot", "link", "operator"])
def test_stalls_one_after_another_do_not_add_up(part: str) -> None:
    stalls = tuple((1.5 + 0.6 * k, 1.5 + 0.6 * k + 0.15) for k in range(8))
    world = World({part: stalls})
    world.run(7.0)
    fresh = sum(not audio.stale for _, audio in world.decoded)
    # The stalls themselves take 1.2 of 7 s.
    assert fresh * 0.005 > 7.0 - 1.2 - 0.5
    assert max(stale_after(world, stalls[-1][1]), default=0.0) < RECOVERY


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_sound_is_fresh_soon_after_any_sequence_of_stalls_of_all_parts(
    seed: int,
) -> None:
    dice, stalls = random.Random(seed), dict[str, tuple[tuple[float, float], ...]]()
    for part in ("robot", "link", "operator"):
        at, found = 1.0, []
        while at < 4.0:
            at += dice.choice(
                [
                    dice.uniform(0.02, 0.15),
                    dice.uniform(0.1, 0.6),
                    dice.uniform(0.5, 2.0),
                ]
            )
            end = at + dice.choice(
                [
                    dice.uniform(0.02, 0.12),
                    dice.uniform(0.05, 0.4),
                    dice.uniform(0.2, 2.0),
                ]
            )
            found.append((at, end))
            at = end
        stalls[part] = tuple(found)
    world, pairs = World(stalls), [pair for found in stalls.values() for pair in found]
    world.run(max(end for _, end in pairs) + 1.0)
    for now in (now for now, audio in world.decoded if audio.stale):
        assert (
            min(max(0.0, now - end) for start, end in pairs if start <= now) < RECOVERY
        )


@pytest.mark.slow
@pytest.mark.parametrize("part", ["robot", "link", "operator"])
@pytest.mark.parametrize("duration", [0.1, 0.7])
def test_no_fresh_sound_has_waited_longer_than_what_counts_as_stale(
    part: str, duration: float
) -> None:
    world = World({part: ((1.5, 1.5 + duration),)})
    world.run(3.5)
    assert world.began is not None
    first = world.decoded[0][1].block.start / LIVE_SAMPLE_RATE
    ages = [
        now - world.began - first - audio.block.end / LIVE_SAMPLE_RATE
        for now, audio in world.decoded
        if not audio.stale
    ]
    assert max(ages) - min(ages) < SOUND_STALE_AFTER + 0.01


def test_the_session_of_a_world_without_stalls_has_no_stale_sound() -> None:
    world = World({})
    world.run(1.0)
    assert isinstance(world.operator, ReceiveSession)
    assert not any(audio.stale for _, audio in world.decoded)
    assert len(world.decoded) > 190


def last_stale(watcher: Watcher, *, seconds: float) -> float:
    """Seconds from now to the last packet that counts as stale in the next ``seconds``;
    0 if none does."""
    begun, last = time.monotonic(), 0.0
    before = watcher.snapshot().counters["packets_skipped"]
    while (passed := time.monotonic() - begun) < seconds:
        time.sleep(0.005)
        if (count := watcher.snapshot().counters["packets_skipped"]) != before:
            before, last = count, passed
    return last


def is_permitted() -> bool:
    """Whether a thread of this user may have a real-time priority."""
    warnings: list[str] = []
    thread = threading.Thread(
        target=lambda: warnings.append(prioritize_thread(MAIN_PRIORITY))
    )
    thread.start()
    thread.join()
    return warnings == [""]


@pytest.mark.realtime
@pytest.mark.timed
def test_a_process_that_was_stopped_is_fresh_again_soon(tmp_path: Path) -> None:
    name = f"test-stall-{os.getpid()}"
    changes = [
        "output.actuator=none",
        "detector.check_microphones=false",
        "process.watchdog=false",
    ]
    robot, operator = pair_on_one_machine(
        change(Settings(), changes), tmp_path, name=name
    )
    receiving = Supervisor(run_operator, operator, name=name)
    sending = Supervisor(
        partial(run_robot, open_source=EndlessStroke), robot, name=robot.process.name
    )
    with supervised(receiving, sending):
        watcher = Watcher(name)
        last_stale(watcher, seconds=1.5)
        assert watcher.snapshot().counters["packets_received"] > 100
        for side in (sending, receiving):
            if is_permitted():
                # On a busy machine the threads of the sound would wait for a main
                # thread that holds the interpreter.
                assert os.sched_getscheduler(side.pid) == os.SCHED_FIFO
                assert os.sched_getparam(side.pid).sched_priority == MAIN_PRIORITY
            for duration in (0.08, 0.3, 0.9):
                os.kill(side.pid, signal.SIGSTOP)
                time.sleep(duration)
                os.kill(side.pid, signal.SIGCONT)
                # The machine may be late for reasons of its own: what counts is that
                # no second passes in staleness.
                late = last_stale(watcher, seconds=1.0)
                assert late < RECOVERY + 0.1, (side.name, duration)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["robot", "link", "operator"])
@pytest.mark.parametrize("duration", [0.02, 0.05, 0.08, 0.2, 0.5, 2.0])
def test_the_clocked_playout_holds_no_old_sound_after_a_stall(
    part: str, duration: float
) -> None:
    """The sound that a profile renders itself is queued; what has waited in it for
    longer than 60 ms is old."""
    end = 1.5 + duration
    world = World({part: ((1.5, end),)})
    world.pulling = True
    world.run(end + 1.0)
    assert (
        max(queue for now, queue in world.queues if now > end + RECOVERY)
        < SOUND_STALE_AFTER
    )
