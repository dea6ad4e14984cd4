"""Does anything grow, wrap wrongly or stop in a long run? ``python
benchmarks/endurance.py``, about three minutes.

Three parts. *Nights* (``--seeds 1000``): robot, operator, gate, watchdog, recorder and
log on one virtual clock, over a network that loses, delays, reorders and dies, with
processes that are killed, frozen and restarted, and machines that sleep
(`virtual_night`); each seed is a night of 8 virtual hours, and what fails is printed
with the command that repeats it. *Virtual*: both ends of a link in virtual time,
checked sample by sample, across the wraps of sequence number and RTP timestamp and
through renewed keys; ``--virtual-hours 168 --duty 0.02`` is a week in which the robot
sends 1.2 seconds of each minute and is connected but quiet in the rest, and takes five
minutes of processor time. *Live*: ``tactophone loopback`` with the simulated finger,
its processes measured every few seconds; a start still settles in the first minutes, so
run ``--live-minutes 60`` for the figures of the docs.
"""

import argparse
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
import psutil

from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import RENEW_AFTER, Session
from tactophone.net.link.stream import DecodedAudio
from virtual_link import OPERATOR_ADDRESS, VirtualLink
from virtual_night import BrokenPromiseError, live_through

PACKET = 960
"""Samples that are sent at once: 20 ms, four packets."""

MAX_SLOPE_MB = 1.0
"""Largest growth of each process, in MB an hour."""

BEFORE_WRAP = 30.0
"""Virtual seconds from the start to the wrap of the RTP timestamp, which comes by
itself after up to 24.9 hours."""

MINUTE = 60 * LIVE_SAMPLE_RATE

QUIET_STEP = LIVE_SAMPLE_RATE // 2
"""Samples of virtual time from one poll to the next while the robot sends nothing: half
of what makes it call again."""

SAMPLE_INTERVAL = 3.0
SETTLING = 0.3
"""Seconds between two measurements of the live processes, and the share of the run in
which they still settle."""

Row = tuple[str, str, str, bool]
"""Quantity, limit, value, and whether the value keeps to the limit."""


@dataclass
class Soak:
    """What a virtual run has shown so far."""

    good: int = 0
    wrong: int = 0
    concealed: int = 0
    wraps: int = 0
    memory: list[tuple[float, float]] = field(default_factory=list)


def soak(hours: float, *, duty: float, report: Callable[[str], None]) -> list[Row]:
    """Run both ends for some virtual hours over a link that loses 1 % of the packets.

    Of each minute the robot sends the share ``duty``.
    """
    robot, operator = Identity.create("robot"), Identity.create("operator")
    renew_after = min(RENEW_AFTER, 3600 * hours / 3.5)
    calling = Session(
        robot,
        Peers({operator.fingerprint: "op"}),
        call=OPERATOR_ADDRESS,
        renew_after=renew_after,
    )
    sender = SendGroup([calling], Codec("pcm16", channels=1, packet_size=240))
    receiver = ReceiveSession(Session(operator, Peers({robot.fingerprint: "robot"})))
    link = VirtualLink(
        sender,
        receiver,
        ImpairedLink(NetworkProfile(loss=0.01)),
        ImpairedLink(NetworkProfile()),
    )
    begun = link.connect(1000.0)
    assert sender.members[0].stream is not None
    sender.members[0].stream.encoder.origin = (1 << 32) - round(
        BEFORE_WRAP * LIVE_SAMPLE_RATE
    )
    sound, found, sent = _second_of_noise(), Soak(), 0
    position, number, shown = 0, sender.members[0].stream._sequence, time.monotonic()
    process = psutil.Process()
    while position < hours * 3600 * LIVE_SAMPLE_RATE:
        block = AudioBlock(
            sound[np.arange(position, position + PACKET) % LIVE_SAMPLE_RATE],
            LIVE_SAMPLE_RATE,
            position,
        )
        sender.push(block)
        position += PACKET
        _compare(link.carry(begun + position / LIVE_SAMPLE_RATE), sound, found)
        before, number = number, sender.members[0].stream._sequence
        found.wraps += number < before
        sent += PACKET
        if position % MINUTE >= duty * MINUTE:
            rest = -position % MINUTE
            for step in range(position, position + rest, QUIET_STEP):
                _compare(link.carry(begun + step / LIVE_SAMPLE_RATE), sound, found)
            position += rest
        if position % MINUTE == 0:
            found.memory.append(
                (position / LIVE_SAMPLE_RATE / 3600, process.memory_info().rss / 2**20)
            )
            if time.monotonic() - shown > 30:
                shown = time.monotonic()
                report(f"{found.memory[-1][0]:.2f} of {hours:g} virtual hours")
    handshakes = receiver.counters["handshakes"]
    slope = slope_of(found.memory)
    passed = hours * 3600 * LIVE_SAMPLE_RATE
    timestamps = 1 + int(
        (passed / LIVE_SAMPLE_RATE - BEFORE_WRAP) / ((1 << 32) / LIVE_SAMPLE_RATE)
    )
    expected = float(sent)
    return [
        (
            "samples that differ from those sent",
            "0",
            f"{found.wrong} of {found.good:,}",
            found.wrong == 0,
        ),
        (
            "samples received or concealed",
            "over 99.9 %",
            f"{(found.good + found.concealed) / expected:.2%}",
            found.good + found.concealed > 0.999 * expected,
        ),
        (
            "sequence numbers wrapped",
            f"{int(expected / 240 / 65536)} or more",
            str(found.wraps),
            found.wraps >= int(expected / 240 / 65536),
        ),
        (
            "RTP timestamp wrapped",
            "once or more",
            f"{timestamps} times",
            timestamps >= 1,
        ),
        (
            "handshakes: the first, and keys renewed",
            "3 or more",
            str(handshakes),
            handshakes >= 3,
        ),
        (
            "connections lost",
            "0",
            str(receiver.counters["link_losses"]),
            receiver.counters["link_losses"] == 0,
        ),
        (
            "memory of the process, virtual",
            f"under {MAX_SLOPE_MB:g} MB/h",
            f"{slope:+.2f} MB/h",
            slope < MAX_SLOPE_MB,
        ),
    ]


def _second_of_noise() -> FloatArray:
    """Return noise that 16-bit samples hold exactly, shape ``(samples, 1)``."""
    numbers = np.random.default_rng(0).integers(-20_000, 20_000, (LIVE_SAMPLE_RATE, 1))
    return (numbers / 32_768).astype(np.float32)


def _compare(events: Iterable[object], sound: FloatArray, found: Soak) -> None:
    for block in (event.block for event in events if isinstance(event, DecodedAudio)):
        if block.concealed:
            found.concealed += block.size
            continue
        same = np.array_equal(
            block.samples, sound[np.arange(block.start, block.end) % LIVE_SAMPLE_RATE]
        )
        found.good += block.size * same
        found.wrong += block.size * (not same)


def slope_of(points: list[tuple[float, float]]) -> float:
    """Return the slope of values over hours, without the first third; 0 for fewer than
    four points.

    >>> slope_of([(k / 10, 5.0 + k / 5) for k in range(12)])
    2.0
    """
    settled = points[len(points) // 3 :]
    return (
        round(statistics.linear_regression(*zip(*settled, strict=True)).slope, 6)
        if len(settled) > 3
        else 0.0
    )


@dataclass
class ProcessTrace:
    """Measurements of one live process: memory in MB over hours, what of it is its own,
    descriptors, threads."""

    name: str
    memory: list[tuple[float, float]] = field(default_factory=list)
    private: list[tuple[float, float]] = field(default_factory=list)
    descriptors: list[int] = field(default_factory=list)
    threads: list[int] = field(default_factory=list)


def live(minutes: float, *, report: Callable[[str], None]) -> list[Row]:
    """Run robot and operator as processes, and measure both and their parent."""
    name = f"endurance-{os.getpid()}"
    command = [
        sys.executable,
        "-m",
        "tactophone",
        "loopback",
        "--source",
        "finger",
        "--actuator",
        "none",
    ]
    command += ["--network", "wifi", "--name", name, "--duration", str(60 * minutes)]
    traces: dict[int, ProcessTrace] = {}
    begun = shown = time.monotonic()
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as loopback:
        while loopback.poll() is None:
            time.sleep(SAMPLE_INTERVAL)
            passed = time.monotonic() - begun
            if passed > 60 * minutes * SETTLING:
                _measure(loopback.pid, name, traces, passed / 3600)
            if time.monotonic() - shown > 30:
                shown = time.monotonic()
                report(f"{passed / 60:.1f} of {minutes:g} minutes live")
    rows = [
        (
            "exit of the live run",
            "0",
            str(loopback.returncode),
            loopback.returncode == 0,
        )
    ]
    for trace in (trace for trace in traces.values() if len(trace.memory) > 5):
        for quantity, points in (
            ("memory", trace.memory),
            ("memory without shared pages", trace.private),
        ):
            slope = slope_of(points)
            rows.append(
                (
                    f"{quantity}, {trace.name}",
                    f"under {MAX_SLOPE_MB:g} MB/h",
                    f"{slope:+.1f} MB/h",
                    slope < MAX_SLOPE_MB,
                )
            )
        for quantity, counts in (
            ("descriptors", trace.descriptors),
            ("threads", trace.threads),
        ):
            steady = max(counts) - min(counts) <= 2
            rows.append(
                (
                    f"{quantity}, {trace.name}",
                    "steady",
                    f"{min(counts)} to {max(counts)}",
                    steady,
                )
            )
    return rows


def _measure(
    pid: int, name: str, traces: dict[int, ProcessTrace], hours: float
) -> None:
    roles = {pid: "parent"}
    for role, run in (("operator", name), ("robot", f"{name}-robot")):
        if watcher := Watcher.find(run):
            roles[watcher.pid] = role
    try:
        processes = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
    except psutil.NoSuchProcess:
        return
    for process in processes:
        try:
            with process.oneshot():
                if process.status() == psutil.STATUS_ZOMBIE or not process.num_fds():
                    continue  # it is just ending
                role = roles.get(process.pid, f"process {process.pid}")
                trace = traces.setdefault(process.pid, ProcessTrace(role))
                memory = process.memory_info()
                trace.memory.append((hours, memory.rss / 2**20))
                # Telemetry's rings are allocated at the start, but a page counts from
                # its first use.
                trace.private.append((hours, (memory.rss - memory.shared) / 2**20))
                trace.descriptors.append(process.num_fds())
                trace.threads.append(process.num_threads())
        except psutil.Error:
            continue


def nights(
    seeds: Iterable[int], *, hours: float, sound: float, report: Callable[[str], None]
) -> list[Row]:
    """Live through the night of each seed; print how to repeat one that breaks a
    promise."""
    count = failed = events = compared = felt = 0
    for seed in seeds:
        count += 1
        try:
            night = live_through(seed, hours=hours, sound=sound)
        except BrokenPromiseError as error:
            failed += 1
            how = (
                f"--seeds 1 --first {seed} --night-hours {hours} --night-sound {sound}"
            )
            report(f"{error}\n  python benchmarks/endurance.py {how}")
            continue
        events, compared, felt = (
            events + night.events,
            compared + night.compared,
            felt + night.felt,
        )
        if count % 10 == 0:
            report(f"{count} nights, {failed} failed")
    return [
        (
            f"nights of {hours:g} h that broke a promise",
            "0",
            f"{failed} of {count}",
            failed == 0,
        ),
        ("events in them", "over 0", str(events), events > 0),
        (
            "predictions that the replay computed alike",
            "all",
            str(compared),
            compared > 0,
        ),
        ("periods of 5 ms with vibration", "over 0", str(felt), felt > 0),
    ]


def main() -> int:
    """Run the parts and print the table; exit 1 where a value is beyond its limit."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--virtual-hours",
        type=float,
        default=0.25,
        metavar="H",
        help="0: none; default 0.25",
    )
    parser.add_argument(
        "--duty",
        type=float,
        default=1.0,
        metavar="SHARE",
        help="of the virtual time with sound",
    )
    parser.add_argument(
        "--live-minutes",
        type=float,
        default=2.0,
        metavar="MIN",
        help="0: none; default 2",
    )
    parser.add_argument(
        "--seeds",
        type=int,
        default=0,
        metavar="N",
        help="nights, and nothing else; default 0",
    )
    parser.add_argument(
        "--first",
        type=int,
        default=1,
        metavar="SEED",
        help="of the first night; default 1",
    )
    parser.add_argument(
        "--night-hours",
        type=float,
        default=8.0,
        metavar="H",
        help="of a night; default 8",
    )
    parser.add_argument(
        "--night-sound",
        type=float,
        default=30.0,
        metavar="S",
        help="seconds in a night; default 30",
    )
    args = parser.parse_args()
    rows: list[Row] = []
    if args.seeds:
        args.virtual_hours = args.live_minutes = 0
        seeds = range(args.first, args.first + args.seeds)
        rows += nights(
            seeds,
            hours=args.night_hours,
            sound=args.night_sound,
            report=lambda line: print(line, file=sys.stderr),
        )
    if args.virtual_hours:
        rows += soak(
            args.virtual_hours,
            duty=args.duty,
            report=lambda line: print(line, file=sys.stderr),
        )
    if args.live_minutes:
        rows += live(
            args.live_minutes, report=lambda line: print(line, file=sys.stderr)
        )
    print("| quantity | limit | value | within the limit |\n|---|---|---|---|")
    for quantity, limit, value, kept in rows:
        print(f"| {quantity} | {limit} | {value} | {'yes' if kept else 'NO'} |")
    return 0 if all(kept for *_, kept in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
