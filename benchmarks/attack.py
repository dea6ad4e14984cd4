"""Attacks the live system on this machine and prints a table with goals: ``python benchmarks/attack.py``.

Everything goes to 127.0.0.1, to two processes that it starts itself; each part is bounded in time and ends by itself.
The attacker shares the machine's processors with its victims. ``--only flood`` runs one part; all of them take about
an hour, most of it ``kill`` and ``fault`` (``--kills`` and ``--faults`` set their repetitions).
"""

import argparse
import http.client
import itertools
import math
import multiprocessing
import os
import random
import resource
import secrets
import select
import signal
import socket
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from http import HTTPStatus
from multiprocessing.sharedctypes import Synchronized
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast
from urllib.parse import SplitResult, urlsplit

import numpy as np
import psutil

from tactophone.app.measurement.impulses import Graph
from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings, change
from tactophone.core.types import FloatArray
from tactophone.faces.web.server import watch as watch_page
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient
from tactophone.live.runtime.latency import follow
from tactophone.live.runtime.operator import run_operator
from tactophone.live.runtime.pairing import pair_on_one_machine
from tactophone.live.runtime.robot import run_robot
from tactophone.live.runtime.supervisor import Supervisor
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.packet import Packet, Payload, PayloadType
from tactophone.net.link.session import Session
from tactophone.net.link.udp import UdpSocket

sys.path.insert(0, str(Path(__file__).parents[1]))

from benchmarks.failsafe import (
    SILENT,
    EndlessStroke,
    freeze_operator,
    freeze_robot,
    kill_operator,
    kill_robot,
    measure_time_to_silence,
)
from benchmarks.hostile_callers import CERTIFICATE_FAULTS, DelayedLine, call_with_certificate, overlong_hello
from benchmarks.kills import DAY, KINDS, WallClock, kill, left_by, running_link
from benchmarks.unplugged import OUTAGES, can_make_networks, unpluggable_link

HOST = "127.0.0.1"
FLOOD_SECONDS = 12.0
EVIL_SECONDS = 4.0
MAX_DATAGRAMS = 2_000_000
"""Datagrams after which any flood stops."""

CROWD = 5_000
"""Silent connections to a page."""

FORK = multiprocessing.get_context("fork")


STARVED = """
import sys, threading, time
from tactophone.live.audio.jack import JackClient

def silent(inputs, outputs):
    for samples in outputs:
        samples[:] = 0.0

def compute():
    while True:
        sum(range(200_000))

client = JackClient("starved", silent, inputs={"in": ""}, outputs={"out": ""}, server=sys.argv[1])
client.open()
for _ in range(3):
    threading.Thread(target=compute, daemon=True).start()
time.sleep(0.3)
print(time.monotonic(), flush=True)
client.close()
"""
"""A program whose client's callback waits for the interpreter most of the time; prints when it begins to close it."""


class Sender:
    """Sends datagrams from one socket, and counts what was sent."""

    def __init__(self, source: socket.socket) -> None:
        self._source = source
        self.sent = FORK.Value("q", 0, lock=False)

    def __call__(self, datagram: bytes) -> None:
        with suppress(OSError):
            self._source.send(datagram)
        self.sent.value += 1


# -- victims --------------------------------------------------------------------------------------------------------


@dataclass
class Victims:
    """Robot and operator, joined by a relay whose sockets an attacker may share."""

    robot: Supervisor
    operator: Supervisor
    folder: Path
    port: int
    robot_side: socket.socket
    operator_side: socket.socket

    @property
    def watcher(self) -> Watcher:
        return Watcher(self.operator.name)

    def counters(self) -> dict[str, int]:
        return dict(self.watcher.snapshot().counters)


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Keep so many processes computing."""
    processes = [multiprocessing.Process(target=_compute, args=(os.getpid(),), daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def _compute(parent: int) -> None:
    while os.getppid() == parent:
        sum(range(100_000))


@contextmanager
def victims(*, second: bool = False) -> Iterator[Victims]:
    """Run both sides, connected through a relay, with no actuator."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="tactophone-attack-")))
        settings = change(Settings(), ["detector.check_microphones=false", "output.actuator=none"])
        robot, operator = pair_on_one_machine(settings, folder, name=f"attack-{secrets.token_hex(3)}")
        if second:
            other = Identity.create("second")
            other.save(folder / "second")
            Peers.load(folder / "robot").save(folder / "second")
            Peers.load(folder / "operator").trusting("second", other.fingerprint).save(folder / "operator")
        port = operator.link.port
        sides = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(2)]
        sides[0].bind((HOST, 0))
        sides[1].connect((HOST, port))
        relay = FORK.Process(target=relay_datagrams, args=sides, daemon=True)
        relay.start()
        stack.callback(stop_process, relay)
        robot = replace(robot, link=replace(robot.link, port=sides[0].getsockname()[1]))
        receiving = stack.enter_context(Supervisor(run_operator, operator, name=operator.process.name))
        sending = stack.enter_context(
            Supervisor(partial(run_robot, open_source=EndlessStroke), robot, name=robot.process.name)
        )
        result = Victims(sending, receiving, folder, port, *sides)
        await_that(lambda: result.counters()["packets_received"] > 200, "the two sides to connect")
        time.sleep(1.0)
        yield result


def relay_datagrams(robot_side: socket.socket, operator_side: socket.socket) -> None:
    """Pass datagrams both ways until the process is ended."""
    with suppress(OSError):  # as the two sides: it stands for the network, which does not wait for a processor
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(60))
    robot = None
    while True:
        for ready in select.select([robot_side, operator_side], [], [])[0]:
            with suppress(OSError):
                if ready is robot_side:
                    datagram, robot = robot_side.recvfrom(2_048)
                    operator_side.send(datagram)
                elif robot:
                    robot_side.sendto(operator_side.recv(2_048), robot)


def stop_process(process: multiprocessing.process.BaseProcess) -> None:
    process.kill()
    process.join()


def await_that(condition: Callable[[], bool], what: str, *, timeout: float = 30.0) -> None:
    until = time.monotonic() + timeout
    while time.monotonic() < until:
        with suppress(TactophoneError):
            if condition():
                return
        time.sleep(0.02)
    raise TactophoneError(f"waited {timeout:g} s for {what}")


# -- floods ---------------------------------------------------------------------------------------------------------


def garbage(send: Sender, _: Victims) -> None:
    dice = random.Random(1)
    datagrams = [
        bytes([dice.choice([128, 144, 22, 0, 255])]) + dice.randbytes(dice.randrange(1, 1_200)) for _ in range(500)
    ]
    for number in range(MAX_DATAGRAMS):
        send(datagrams[number % len(datagrams)])


def hellos(send: Sender, _: Victims) -> None:
    hello = bytearray(foreign_hello())
    dice = random.Random(2)
    for _ in range(MAX_DATAGRAMS):
        hello[27:59] = dice.randbytes(32)
        send(bytes(hello))


def exchanges(send: Sender, at: Victims) -> None:
    """Return the cookie from ever new ports, so that each hello begins a handshake; 50 at once, waiting for none."""
    eve, trusts = Identity.create("eve"), Peers({"AB" * 32: "op"})
    while send.sent.value < MAX_DATAGRAMS:
        with ExitStack() as stack:
            calls = [(Session(eve, trusts, call="op"), stack.enter_context(caller_at(at))) for _ in range(50)]
            for session, caller in calls:
                session.poll(0.0)
                post(session, caller, send)
            time.sleep(0.01)
            for session, caller in calls:
                with suppress(OSError):
                    session.receive(caller.recv(2_048, socket.MSG_DONTWAIT), source="op", now=0.0)
                    post(session, caller, send)


def caller_at(at: Victims) -> socket.socket:
    """Return a socket of a port of its own, connected to the operator."""
    caller = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    caller.connect((HOST, at.port))
    return caller


def post(session: Session, caller: socket.socket, send: Sender) -> None:
    for datagram, _target in session.outgoing():
        caller.send(datagram)
        send.sent.value += 1


def foreign_hello() -> bytes:
    session = Session(Identity.create("eve"), Peers({"AB" * 32: "op"}), call="op")
    session.poll(0.0)
    return session.outgoing()[0][0]


@dataclass
class Window:
    """What the operator did for some seconds."""

    rate: float
    gap_ms: float
    fades: int
    processor: float
    attack_rate: float
    restarts: int

    def __str__(self) -> str:
        return (
            f"{self.rate:.0f}/s, gap {self.gap_ms:.0f} ms, {self.fades} fades, processor {self.processor:.0f} % "
            f"(attack {self.attack_rate:,.0f}/s)"
        )


def watch(at: Victims, flood: Callable[[Sender, Victims], None] | None, *, as_robot: bool = False) -> Window:
    """Attack for `FLOOD_SECONDS`, and measure what still arrives."""
    watcher, process = at.watcher, psutil.Process(at.operator.pid)
    stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    stranger.connect((HOST, at.port))
    send = Sender(at.operator_side if as_robot else stranger)
    attacker = FORK.Process(target=flood, args=(send, at), daemon=True) if flood else None
    if attacker:
        attacker.start()
    before, processor, begun = watcher.snapshot().counters, sum(process.cpu_times()[:2]), time.monotonic()
    received: set[float] = set()
    while time.monotonic() < begun + FLOOD_SECONDS:
        time.sleep(1.0)
        # The operator's own marks: this process may itself be late.
        received.update(float(each) for each in watcher.marks("received")["time"] if each > begun)
    after, duration = watcher.snapshot().counters, time.monotonic() - begun
    used = math.inf  # if the process has ended; then there is a restart, and the goal is missed
    with suppress(psutil.NoSuchProcess):
        used = 100 * (sum(process.cpu_times()[:2]) - processor) / duration
    if attacker:
        stop_process(attacker)
    stranger.close()
    times = [begun, *sorted(received)]
    return Window(
        (after["packets_received"] - before["packets_received"]) / duration,
        1_000 * max(later - sooner for sooner, later in itertools.pairwise(times)) if received else math.inf,
        after["stale_fades"] - before["stale_fades"],
        used,
        send.sent.value / duration,
        at.operator.restarts + at.robot.restarts,
    )


def floods() -> Iterator[str]:
    """Floods as fast as the machine permits, from a stranger's and from the robot's own address."""
    with victims() as at:
        quiet = watch(at, None)
        yield row("no attack", "", str(quiet))
        for name, flood, as_robot in (
            ("garbage, a stranger", garbage, False),
            ("garbage, the robot's address", garbage, True),
            ("hellos, a stranger", hellos, False),
            ("hellos, the robot's address", hellos, True),
            ("cookie exchanges, new ports", exchanges, False),
        ):
            window = watch(at, flood, as_robot=as_robot)
            met = window.rate >= 190 and window.gap_ms < 100 and window.fades <= 2 and not window.restarts
            thrifty = window.processor <= 1.5 * quiet.processor
            goal = ">= 190/s, gap < 100 ms, <= 2 fades, processor <= 1.5 x"
            yield row(name, goal, str(window), met and thrifty)
            time.sleep(1.0)


# -- replays and forgeries ------------------------------------------------------------------------------------------


def replays() -> Iterator[str]:
    """Captured packets again, and the same with a bit, a number, an SSRC or the end changed: none may be accepted."""
    with victims() as at:
        captured = capture(at)
        for name, change in (("replayed", lambda packet, _: packet), ("forged", forge)):
            before, dice = at.counters(), random.Random(3)
            begun = time.monotonic()
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
                for number in range(10_000):
                    stranger.sendto(change(captured[number % len(captured)], dice), (HOST, at.port))
                    time.sleep(0.0002)
            time.sleep(0.3)
            after, duration = at.counters(), time.monotonic() - begun
            accepted = after["packets_received"] - before["packets_received"] - 200 * duration
            doubled = after["packets_duplicated"] - before["packets_duplicated"]
            # Genuine packets come 200 times a second, give or take a stall; accepted forgeries would be thousands.
            yield row(f"10,000 {name} packets", "0 accepted", f"{max(0.0, accepted - 100):.0f} accepted",
                      accepted < 100 and doubled == 0 and not at.operator.restarts)  # fmt: skip


def capture(at: Victims) -> list[bytes]:
    """Record the robot's packets by taking the relay's place for two seconds."""
    packets: list[bytes] = []
    until = time.monotonic() + 2.0
    while time.monotonic() < until:
        if select.select([at.robot_side], [], [], 0.05)[0]:
            with suppress(OSError):
                # The relay process reads too; whoever is faster passes the datagram on.
                datagram = at.robot_side.recv(2_048, socket.MSG_DONTWAIT)
                at.operator_side.send(datagram)
                packets += [datagram] if 128 <= datagram[0] < 192 else []
    return packets or [bytes(40)]


def forge(packet: bytes, dice: random.Random) -> bytes:
    """Change a packet in one of four ways."""
    match dice.randrange(4):
        case 0:
            return packet[:8] + dice.randbytes(4) + packet[12:]
        case 1:
            return packet[: dice.randrange(len(packet))]
        case 2:
            return packet[:2] + dice.randbytes(2) + packet[4:]
    place = dice.randrange(len(packet))
    return packet[:place] + bytes([packet[place] ^ 1 << dice.randrange(8)]) + packet[place + 1 :]


def handshakes() -> Iterator[str]:
    """Crafted certificates and hellos, then 2,000 mutated flights, from strangers: the operator's process stays."""
    with victims() as at:
        pid = at.operator.pid
        for fault in CERTIFICATE_FAULTS:
            with stranger_at(at) as answer:
                call_with_certificate(fault, answer)
        for high in (0x02, 0x17, 0xFF):
            with stranger_at(at) as answer:
                answer(overlong_hello(answer, high))
        dice = random.Random(4)
        for _ in range(500):
            mutated_handshake(at, dice)
        time.sleep(0.5)
        same = at.operator.pid == pid and not at.operator.restarts
        result = "the same process, vibrating" if same else f"{at.operator.restarts} restarts"
        yield row("odd certificates, overlong hellos, 500 mutated handshakes", "the process stays", result, same)


@contextmanager
def stranger_at(at: Victims) -> Iterator[Callable[[bytes], list[bytes]]]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caller:
        caller.connect((HOST, at.port))

        def answer(datagram: bytes) -> list[bytes]:
            caller.send(datagram)
            replies = []
            with suppress(OSError):
                while select.select([caller], [], [], 0.03)[0]:
                    replies.append(caller.recv(4_096))
            return replies or [bytes(60)]

        yield answer


def mutated_handshake(at: Victims, dice: random.Random) -> None:
    session = Session(Identity.create("eve"), Peers({"AB" * 32: "op"}), call="op")
    session.poll(0.0)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as caller, suppress(OSError):
        caller.connect((HOST, at.port))
        caller.settimeout(0.02)
        for _ in range(4):
            for datagram, _target in session.outgoing():
                place = dice.randrange(13, len(datagram))
                mutated = datagram[:place] + dice.randbytes(dice.randrange(1, 4)) + datagram[place + 1 :]
                caller.send(mutated if dice.random() < 0.4 else datagram)
            session.receive(caller.recv(2_048), source="op", now=0.0)


# -- faulty and second robots ---------------------------------------------------------------------------------------


def alternate(number: int, ssrc: int) -> bytes:
    kind = (PayloadType.L16_MONO, PayloadType.L16_STEREO)[number % 2]
    return bytes(Packet(number % 65_536, ssrc, Payload(kind, 360 * number, b"\1\2\0\0" * 240)))


def jump(number: int, ssrc: int) -> bytes:
    timestamp = 0 if number % 2 else (1 << 32) - 23_000
    return bytes(Packet(number % 65_536, ssrc, Payload(PayloadType.L16_STEREO, timestamp, bytes(960))))


def repeat(number: int, ssrc: int) -> bytes:
    """170 earlier payloads with holes between them."""
    heads = b"".join(
        (1 << 31 | PayloadType.L16_MONO << 24 | (16_383 - 50 * earlier) << 10 | 2).to_bytes(4, "big")
        for earlier in range(170)
    )
    header = bytes([0x80, PayloadType.RED]) + (number % 65_536).to_bytes(2, "big")
    header += (100_000 * number % (1 << 32)).to_bytes(4, "big") + ssrc.to_bytes(4, "big")
    return header + heads + bytes([PayloadType.L16_MONO]) + bytes(380)


def evil_robot() -> Iterator[str]:
    """A paired robot gone wrong, in three ways: the process stays, and processes packets as they come."""
    for name, make in (("alternating channels", alternate), ("jumping timestamps", jump), ("170 repeats", repeat)):
        with victims(second=True) as at:
            at.robot.__exit__(None, None, None)  # the genuine robot leaves; the faulty one calls
            pid, before = at.operator.pid, at.counters()
            sent = faulty_calls(at, make)
            time.sleep(0.3)
            after = at.counters()
            handled = sum(after[key] - before[key] for key in ("packets_received", "packets_broken"))
            same = at.operator.pid == pid and not at.operator.restarts
            result = f"{'the same process' if same else 'restarted'}, {handled} of {sent} packets processed"
            yield row(f"paired robot: {name}", "the process stays, >= 90 %", result, same and handled >= 0.9 * sent)


def faulty_calls(at: Victims, make: Callable[[int, int], bytes]) -> int:
    """Connect as the paired second robot, and send what ``make`` makes; return how many packets."""
    folder = at.folder / "second"
    session = Session(Identity.load(folder), Peers.load(folder), call=(HOST, at.port))
    ssrc = sent = 0
    until = time.monotonic() + 10.0
    with UdpSocket(HOST) as line:
        while time.monotonic() < until:
            now = time.monotonic()
            for datagram, source in line.receive(0.002):
                for event in session.receive(datagram, source=source, now=now):
                    ssrc = getattr(event, "local_ssrc", ssrc)
            session.poll(now)
            if session.peer:
                until = min(until, now + EVIL_SECONDS) if not sent else until
                session.send(make(sent, ssrc))
                sent += 1
            line.send(cast(list[tuple[bytes, tuple[str, int]]], session.outgoing()))
            time.sleep(0.003)
    return sent


def two_robots() -> Iterator[str]:
    """A second trusted robot calls for ten seconds: the first one's sound continues."""
    with victims(second=True) as at:
        before = at.counters()
        faulty_calls(at, alternate)
        after = at.counters()
        shown = any(fault.code == "second_robot" for fault in at.watcher.snapshot().state.faults)
        changes = after["handshakes"] - before["handshakes"]
        result = f"{changes} changes, {after['link_losses'] - before['link_losses']} losses, shown: {shown}"
        yield row("two paired robots", "0 changes, shown on the page", result, changes == 0 and shown)


def connecting() -> Iterator[str]:
    """A robot calls among 1,000 hellos a second from 1,000 addresses, with cookies, at 100 ms round trip (virtual)."""
    robot, operator, eve = (Identity.create(name) for name in ("robot", "operator", "eve"))
    trusting = Peers({operator.fingerprint: "operator"})
    line = DelayedLine(Session(operator, Peers({robot.fingerprint: "robot"})), address="op", delay=0.05)
    numbers = itertools.count()
    genuine = Session(robot, trusting, call="op")
    while genuine.peer is None and line.now < 31.0:
        if line.now > 1.0:
            line.callers["robot"] = genuine
        line.callers[f"stranger {next(numbers) % 1_000}"] = Session(eve, trusting, call="op")
        line.step(0.001)
        # A stranger that is answered has called back by now, and leaves its handshake unfinished.
        for name in [name for name in list(line.callers)[:-250] if name != "robot"]:
            del line.callers[name]
    took = line.now - 1.0
    yield row("connecting among 1,000 foreign hellos/s, 100 ms", "<= 1 s", f"{took:.2f} s", took <= 1.0)


# -- silent connections to a page ------------------------------------------------------------------------------------


def silent_connections() -> Iterator[str]:
    """Compute latency and a viewer's wait without and with a crowd that says nothing to the page, in turn."""
    with victims() as at, watch_page(at.operator.name) as page:
        address = urlsplit(page.url)
        viewer_waits(address)
        delays: dict[bool, list[float]] = {False: [], True: []}
        waits, held = [], FORK.Value("q", 0, lock=False)
        for crowded in (False, True) * 3:
            crowd = FORK.Process(target=hold_connections, args=(address.port, held), daemon=True)
            if crowded:
                crowd.start()
                time.sleep(2.0)
            for _ in range(10):
                time.sleep(1.0)
                delays[crowded] += recent_delays(at)
                waits += [viewer_waits(address)] * crowded
            if crowded:
                stop_process(crowd)
                time.sleep(6.0)  # until the page has given up on the last of them
    (middle, late), (beside, late_beside) = (np.percentile(delays[each], (50, 99)) * 1_000 for each in (False, True))
    ratio = beside / middle
    result = f"{beside:.2f} ms beside {middle:.2f}: x {ratio:.2f} (p99 {late_beside:.1f} beside {late:.1f} ms); "
    result += f"a viewer is in after {statistics.median(waits):.2f} s, at most {max(waits):.2f} s"
    met = ratio < 1.1 and statistics.median(waits) < 1.0 and not at.operator.restarts + at.robot.restarts
    yield row(f"{held.value:,} silent connections to the page", "latency x < 1.1, a viewer in 1 s", result, met)


def hold_connections(port: int, held: "Synchronized[int]") -> None:
    """Keep as many connections open as descriptors allow, at most `CROWD`, and open anew what the page closes."""
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    poll, crowd = select.poll(), dict[int, socket.socket]()
    while True:
        while len(crowd) < min(CROWD, hard - 100):
            silent_one = socket.socket()
            silent_one.setblocking(False)
            with suppress(BlockingIOError):
                silent_one.connect((HOST, port))
            crowd[silent_one.fileno()] = silent_one
            poll.register(silent_one, select.POLLIN)
        held.value = len(crowd)
        for descriptor, _ in poll.poll(100):
            poll.unregister(descriptor)
            crowd.pop(descriptor).close()


def viewer_waits(address: SplitResult) -> float:
    """Return after how many s a viewer has the page."""
    begun = time.monotonic()
    while time.monotonic() < begun + 30.0:
        with suppress(OSError, http.client.HTTPException):
            viewer = http.client.HTTPConnection(HOST, address.port, timeout=5)
            viewer.request("GET", address.path)
            if viewer.getresponse().status == HTTPStatus.OK:
                return time.monotonic() - begun
    return math.inf


def recent_delays(at: Victims) -> list[float]:
    """Return the s from capture to command of the newest blocks."""
    marks = {"rendered": at.watcher.marks("rendered"), "captured": Watcher(at.robot.name).marks("captured")}
    times = follow(marks)
    return list(times["rendered"] - times["captured"])


# -- shared memory, faults ------------------------------------------------------------------------------------------


def shared_memory() -> Iterator[str]:
    """Another user fills /dev/shm, here a private one of 24 MB: both processes stay."""
    name = "a full /dev/shm"
    if os.geteuid():
        yield row(name, "the processes stay", "not measured: needs root for a private /dev/shm")
        return
    script = 'mount -t tmpfs -o size=24M tmpfs /dev/shm && exec "$0" "$@"'
    command = ["unshare", "-m", "sh", "-c", script, sys.executable, __file__, "--only", "inside"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    result = next((line for line in done.stdout.splitlines() if line.startswith("restarts")), "") or done.stderr[-200:]
    yield row(name, "0 restarts", result.strip(), result.strip().startswith("restarts 0"))


def inside() -> Iterator[str]:
    """The part of `shared_memory` that runs where /dev/shm is private."""
    if os.statvfs("/dev/shm").f_blocks * os.statvfs("/dev/shm").f_frsize > 1 << 25:
        raise TactophoneError("only within the private /dev/shm of --only memory")
    with victims() as at:
        with suppress(OSError), open("/dev/shm/filler", "wb", buffering=0) as filler:
            for _ in range(1_000):
                filler.write(bytes(1 << 16))
        before = at.counters()["packets_received"]
        time.sleep(5.0)
        received = at.counters()["packets_received"] - before
        yield f"restarts {at.operator.restarts + at.robot.restarts}, {received / 5:.0f} packets/s"


def faults(count: int) -> Iterator[str]:
    """Kill and freeze either side, on a sound server that repeats the last period of a late client."""
    for end in (kill_robot, freeze_robot, kill_operator, freeze_operator):
        times = []
        with DummyServer(128, synchronous=False) as server:
            settings = change(Settings(), [f"process.name=attack-{os.getpid()}"])
            for _ in range(count):
                with suppress(TactophoneError):  # on a busy machine it may not vibrate when it is to be stopped
                    times.append(1_000 * measure_time_to_silence(settings, Graph(server.name), end))
        late = sum(took > 100 for took in times)
        result = f"{statistics.median(times or [math.nan]):.0f} ms, worst {max(times, default=math.nan):.0f} ms, "
        result += f"{late} of {len(times)} over 100 ms" + f", {count - len(times)} not measured" * (len(times) < count)
        met = not late and len(times) == count
        yield row(f"{end.__name__.replace('_', ', ')}, until -60 dB", "all <= 100 ms (quiet machine)", result, met)


def kills(count: int) -> Iterator[str]:
    """Kill a random process of a demonstration, a loopback, or one of two ends, each with a log, at a random moment."""
    dice, found = random.Random(5), []
    for number in range(count):
        with TemporaryDirectory(prefix="tactophone-attack-") as folder:
            # Every other one at its start, when there is no log yet.
            running = number % 2 == 1
            found.append(kill(Path(folder), KINDS[number // 2 % len(KINDS)], dice, running=running))
    wrong = [line for finding in found for line in finding.wrong]
    result = (
        f"{sum(finding.equal for finding in found):,} predictions replayed to the bit; a killed recorder's log lacks "
    )
    result += f"at most {max(finding.behind for finding in found):.1f} s; wrong: {'; '.join(wrong) or 'nothing'}"
    goal = "every log replays, no process after 5 s, no shared memory"
    yield row(f"{count} SIGKILLs at random moments", goal, result, not wrong)


def clocks() -> Iterator[str]:
    """Set the wall clock by a day and back, then stop both ends for a minute."""
    with TemporaryDirectory(prefix="tactophone-attack-") as text:
        clock = WallClock(Path(text))
        with running_link(Path(text), f"attack-{secrets.token_hex(3)}", clock) as link:
            quiet = link.longest_gap(3.0)
            gaps = []
            for offset in (DAY, 0, -DAY, 0):
                clock.set(offset)
                gaps.append(link.longest_gap(3.0))
            until_fresh, stale = link.stop(60.0)
            restarted, left = link.restarts(), left_by(link.run)
        result = f"longest gap {1_000 * max(gaps):.0f} ms ({1_000 * quiet:.0f} ms before)"
        yield row("wall clock set by a day and back, twice", "gap < 0.3 s", result, max(gaps) < 0.3)
        result = f"fresh after {until_fresh:.1f} s; before that, amplitude {stale:.3f}; {restarted} restarts; "
        result += f"logs: {left.equal} predictions to the bit, wrong: {'; '.join(left.wrong) or 'nothing'}"
        met = until_fresh < 2.5 and stale == 0.0 and not restarted and not left.wrong
        yield row("both ends stopped for 60 s", "fresh within 2.5 s, nothing stale", result, met)


def interfaces() -> Iterator[str]:
    """Take the network interface of a running link away and give it back."""
    if not can_make_networks():
        yield row("the network interface taken away", "", "not measured: needs root and iproute2")
        return
    with ExitStack() as stack:
        folder = Path(stack.enter_context(TemporaryDirectory(prefix="tactophone-attack-")))
        link = stack.enter_context(unpluggable_link(folder, f"attack-{secrets.token_hex(3)}"))
        for outage, (duration, count) in itertools.product(OUTAGES, ((2.0, 5), (8.0, 2))):
            found = [link.unplug(outage, duration) for _ in range(count)]
            silent, felt = ([getattr(each, name) for each in found] for name in ("silent", "felt"))
            stale, restarted = max(each.peak for each in found), link.restarts()
            traces = (folder / "printed").read_text().count("Traceback")
            result = f"silent after at most {1_000 * max(silent):.0f} ms, felt again after "
            result += f"{statistics.median(felt):.1f} s, at most {max(felt):.1f} s; amplitude between {stale:.3f}; "
            result += f"{traces} tracebacks, {restarted} restarts"
            met = max(silent) <= 0.1 and max(felt) < 5.0 and stale <= SILENT and not traces and not restarted
            goal = "silent <= 100 ms, felt < 5 s, nothing stale, no traceback"
            yield row(f"network interface, {outage} for {duration:g} s, {count} times", goal, result, met)


def jack_restarts() -> Iterator[str]:
    """Kill jackd 20 times; each successor has another period, and every other one another rate."""
    periods, rates = itertools.cycle((64, 256, 1_024, 128)), itertools.cycle((48_000, 44_100, 48_000, 96_000))
    server, calls, wrong, times = DummyServer(128, synchronous=False), [0], [], []

    def render(_: object, outputs: list[FloatArray]) -> None:
        calls[0] += 1
        for samples in outputs:
            samples[:] = 0.0

    client = JackClient("restarted", render, inputs={}, outputs={"out": "system:playback_1"}, server=server.name)
    server.start()
    client.open()
    for number in range(20):
        server.kill()
        server.period, server.sample_rate = next(periods), next(rates)
        server.start()
        began, before, works = time.monotonic(), calls[0], server.sample_rate == 48_000
        while time.monotonic() < began + 10.0:
            client.revive()
            if (client.fault == "" and calls[0] > before) if works else ("is needed" in client.fault):
                break
            time.sleep(0.05)
        else:
            wrong.append(f"{number}: {server.sample_rate} Hz, {server.period} samples: {client.fault or 'no callback'}")
        times.append(time.monotonic() - began)
    client.close()
    server.stop()
    result = f"joined, or refused by its rate, after at most {max(times):.1f} s; wrong: {'; '.join(wrong) or 'nothing'}"
    yield row("jackd killed 20 times, back at other rates and periods", "all within 10 s", result, not wrong)


def starved_close() -> Iterator[str]:
    """Close a JACK client while three threads of its process compute without end."""
    times, wrong = [], 0
    for synchronous in (False, True):
        with DummyServer(128, synchronous=synchronous) as server:
            for _ in range(20):
                command = [sys.executable, "-c", STARVED, server.name]
                with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
                    printed, _ = process.communicate(timeout=60)
                    times.append(time.monotonic() - float(printed))
                    wrong += process.returncode != 0
    result = (
        f"ended after {statistics.median(times):.2f} s, at most {max(times):.2f} s; {wrong} of {len(times)} crashed"
    )
    met = max(times) < 2.0 and not wrong
    yield row("a JACK client closed in a starved interpreter", "ends by itself within 2 s, 40 times", result, met)


def restarts(count: int) -> Iterator[str]:
    """Kill the robot again as soon as its sound is back."""
    with victims() as at:
        times = []
        for _ in range(count):
            before, began = at.robot.pid, time.monotonic()
            os.kill(before, signal.SIGKILL)
            await_that(lambda before=before: at.robot.pid != before, "the next process", timeout=30.0)
            received = at.counters()["packets_received"]
            await_that(lambda received=received: at.counters()["packets_received"] > received, "sound", timeout=30.0)
            times.append(time.monotonic() - began)
        result = f"back after {statistics.median(times):.1f} s, at most {max(times):.1f} s; "
        result += f"operator restarted {at.operator.restarts} times"
        yield row(f"the robot killed {count} times", "back each time within 10 s", result, max(times) < 10.0)


def row(attack: str, goal: str, measured: str, met: bool | None = None) -> str:
    verdict = "" if met is None else "met" if met else "missed"
    return f"| {attack} | {goal} | {measured} | {verdict} |"


PARTS: dict[str, Callable[[], Iterator[str]]] = {
    "flood": floods,
    "replay": replays,
    "handshake": handshakes,
    "evil": evil_robot,
    "two": two_robots,
    "connect": connecting,
    "silent": silent_connections,
    "memory": shared_memory,
    "clock": clocks,
    "interface": interfaces,
    "jackd": jack_restarts,
    "starved": starved_close,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--only", choices=[*PARTS, "fault", "kill", "restart", "inside"], action="append", help="run this part alone"
    )
    parser.add_argument("--faults", type=int, default=20, help="times that each side is killed and frozen")
    parser.add_argument("--kills", type=int, default=200, help="random processes to kill, and a quarter of it robots")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="busy processes beside the attacks")
    args = parser.parse_args()
    parts = PARTS | {
        "fault": partial(faults, min(args.faults, 100)),
        "kill": partial(kills, args.kills),
        "restart": partial(restarts, args.kills // 4),
    }
    if args.only == ["inside"]:
        print(*inside(), sep="\n")
        return
    print(f"load of the machine before: {os.getloadavg()[0]:.1f}; {args.busy} busy processes\n")
    print("| attack | goal | measured | |\n|---|---|---|---|")
    with busy_processes(args.busy):
        for name in args.only or parts:
            for line in parts[name]():
                print(line, flush=True)


if __name__ == "__main__":
    main()
