"""What a packet, a window and a period cost, by stage and library, in instructions
counted by valgrind.

    python benchmarks/cost.py [--fingers 1,10]         # the table
    python benchmarks/cost.py --check [--counts FILE]  # against benchmarks/cost.json
    python benchmarks/cost.py --write [--counts FILE]  # into it

A count depends neither on the host's speed nor on its load. It leaves out the kernel,
and caches count for nothing: live, a packet finds cold ones, so shares of time differ.
Each stage runs on 0.4 s of sound, after 0.8 s have made it ready. Its bound is what the
C library beneath takes alone (libopus, libsrtp, ONNX Runtime); the rest is Python's,
NumPy's and the C library's. Counts of another Python or another processor's instruction
set are not compared.
"""

import argparse
import ctypes
import json
import mmap
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

COUNTS = Path(__file__).with_suffix(".json")
TOLERANCE = 0.03
LEAST = 200
"""Instructions a unit under which a difference counts for nothing: dictionaries grow at
one run and not at another."""

RATE = 48_000
"""Sample rate in Hz."""

PACKET = 120
"""Samples in a packet: 2.5 ms."""

PERIOD = 128
"""Samples in a period of the sound device."""

WARM_UP = 320
"""Packets before anything is counted: 0.8 s, in which the noise floor becomes known."""

MEASURED = 160
"""Packets that are counted: 0.4 s."""

LIBRARIES = {
    "python": "python|libffi",
    "numpy": "_multiarray_umath|_pocketfft|openblas",
    "opus": "libopus",
    "srtp": "_binding",
    "onnxruntime": "onnxruntime",
}
"""By a pattern of their files' names, the last that fits; everything else is the
system's C library."""


class Stage(NamedTuple):
    """What ``run`` does ``count`` times, ``rate`` times a second; ``minus`` names a
    stage that is part of it."""

    side: str
    name: str
    unit: str
    count: float
    run: Callable[[], object]
    bound: str = ""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--fingers", default="1,10", help="numbers of fingers (default: %(default)s)"
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help=f"fail if a stage differs by over {TOLERANCE:.0%}%",
    )
    parser.add_argument("--write", action="store_true", help=f"write {COUNTS.name}")
    parser.add_argument(
        "--counts",
        type=Path,
        default=COUNTS,
        help="another file than benchmarks/cost.json",
    )
    parser.add_argument(
        "--only",
        default="",
        help="names of stages, which are then not taken from each other",
    )
    parser.add_argument("--child", type=int, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child:
        count_stages(args.child, args.only)
        return
    found = {
        fingers: counted(int(fingers), args.only) for fingers in args.fingers.split(",")
    }
    for fingers, rows in found.items():
        print(table(int(fingers), rows))
    totals = {
        fingers: {name: row["total"] for name, row in rows.items()}
        for fingers, rows in found.items()
    }
    if args.write:
        args.counts.write_text(
            json.dumps({"environment": environment(), "counts": totals}, indent=1)
            + "\n"
        )
    if args.check:
        check(totals, args.counts)


def environment() -> dict[str, str]:
    """Return what the counts depend on beside this repository."""
    import numpy
    import onnxruntime

    opus = next((path.name for path in Path("/usr/lib").rglob("libopus.so.0.*")), "")
    return {
        "machine": platform.machine(),
        "python": platform.python_version(),
        "numpy": numpy.__version__,
        "onnxruntime": onnxruntime.__version__,
        "opus": opus,
        "libc": "-".join(platform.libc_ver()),
    }


def check(totals: dict[str, dict[str, int]], path: Path) -> None:
    """End with the stages that cost another number of instructions than the file
    says."""
    kept = json.loads(path.read_text())
    if (here := environment()) != kept["environment"]:
        other = ", ".join(
            f"{name} {value}"
            for name, value in kept["environment"].items()
            if here[name] != value
        )
        print(f"not compared: {path.name} was counted with {other}")
        return
    worse = [
        f"{fingers} fingers, {name}: {now} instructions, {before} in {path.name} "
        f"({now / before - 1:+.1%})"
        for fingers, rows in totals.items()
        for name, now in rows.items()
        if abs(now - (before := kept["counts"].get(fingers, {}).get(name, now)))
        > max(LEAST, TOLERANCE * before)
    ]
    sys.exit(
        "\n".join(
            [
                *worse,
                "say why in the commit, and run: python benchmarks/cost.py --write",
            ]
        )
        if worse
        else 0
    )


def table(fingers: int, rows: dict[str, dict[str, Any]]) -> str:
    each = {
        name: row["total"] * row["rate"] for name, row in rows.items() if row["side"]
    }
    lines = [
        f"\nFingers: {fingers}. Thousand instructions a unit; share of all that both "
        "ends execute in a second.\n",
        "| end | stage | unit | all | share | bound | Python | NumPy | C library |",
        "|---|---|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name, row in rows.items():
        cells = [
            row["total"],
            *(
                row["of"].get(part, 0)
                for part in (row["bound"], "python", "numpy", "other")
            ),
        ]
        thousand = [f"{value / 1000:.1f}" for value in cells]
        share = f"{each[name] / sum(each.values()):.1%}" if row["side"] else ""
        rest = " | ".join([share, *thousand[1:]])
        lines.append(
            f"| {row['side']} | {name} | {row['unit']} | {thousand[0]} | {rest} |"
        )
    for side in ("robot", "operator"):
        total = sum(each[name] for name, row in rows.items() if row["side"] == side)
        share = total / sum(each.values())
        lines.append(
            f"| {side} | all | second | {total / 1000:.0f} | {share:.1%} | | | | |"
        )
    return "\n".join(lines)


def counted(fingers: int, only: str) -> dict[str, dict[str, Any]]:
    """Run the stages under callgrind; return instructions of each, all and by
    library."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        command = [
            "valgrind",
            "--tool=callgrind",
            "--instr-atstart=no",
            f"--callgrind-out-file={out}",
            "--quiet",
        ]
        env = os.environ | {
            "PYTHONHASHSEED": "0",
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }
        done = subprocess.run(
            [
                *command,
                sys.executable,
                __file__,
                "--child",
                str(fingers),
                "--only",
                only,
            ],
            env=env,
            stdout=subprocess.PIPE,
            check=True,
        )
        stages = json.loads(done.stdout.splitlines()[-1])
        dumps = {}
        for path in Path(folder).glob("out.*"):
            text = path.read_text()
            dumps[re.search(r"Client Request: (.*)", text)[1]] = by_library(text)
    rows: dict[str, dict[str, Any]] = {}
    for number, (side, name, unit, count, rate, bound) in enumerate(stages):
        if f"stage {number}" not in dumps:
            continue
        of = {
            library: max(0, round(found / count))
            for library, found in dumps[f"stage {number}"].items()
        }
        rows[name] = {
            "side": side,
            "unit": unit,
            "rate": rate,
            "bound": bound,
            "of": of,
            "total": sum(of.values()),
        }
    return rows if only else subtracted(rows)


def subtracted(rows: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
    """Take from the stages that hold others what those take."""
    for name, parts in PARTS.items():
        row = rows[name]
        for part in parts:
            scale = rows[part]["rate"] / row["rate"]
            for library, value in rows[part]["of"].items():
                row["of"][library] = max(
                    0, row["of"].get(library, 0) - round(scale * value)
                )
        row["total"] = sum(row["of"].values())
    return rows


PARTS = {"receive": ["send"], "order": ["unprotect", "decode"], "decide": ["graph"]}
"""Stages that are measured together with others, which are then taken off."""


def by_library(dump: str) -> Counter[str]:
    """Return the instructions in each library, from a dump of callgrind."""
    found, names, library, called = Counter[str](), dict[str, str](), "other", False
    for line in dump.splitlines():
        if line.startswith("ob="):
            number, _, name = line[3:].partition(" ")
            names[number] = names.get(number) or name
            name = names[number].rpartition("/")[2]
            library = (
                [each for each, files in LIBRARIES.items() if re.search(files, name)]
                or ["other"]
            )[-1]
        # A line of a call: its cost belongs to the object that is called.
        elif line.startswith("cob="):
            number, _, name = line[4:].partition(" ")
            names[number] = names.get(number) or name
        elif line.startswith("calls="):
            called = True
        elif line[:1] in "0123456789+-*" and line:
            found[library] += 0 if called else int(line.split()[1])
            called = False
    return found


def count_stages(fingers: int, only: str) -> None:
    """Run each stage under the counter; print what the stages are."""
    request, stages = requester(), list[tuple[Any, ...]]()
    rates = {"packet": RATE / PACKET, "window": RATE / 512, "period": RATE / PERIOD}
    with ExitStack() as stack:
        for number, stage in enumerate(stages_of(fingers, stack)):
            if not only or stage.name in only:
                request(START)
                request(ZERO)
            stage.run()
            if not only or stage.name in only:
                request(DUMP, f"stage {number}")
                request(STOP)
            stages.append(
                (
                    stage.side,
                    stage.name,
                    stage.unit,
                    stage.count,
                    rates[stage.unit],
                    stage.bound,
                )
            )
    print(json.dumps(stages))


# Requests of Valgrind's ``callgrind.h``, counted from its base.
ZERO = 1
DUMP = 3
START = 4
STOP = 5


def requester() -> Callable[..., int]:
    """Return a function that asks valgrind for something, by instructions that do
    nothing else (``valgrind.h``)."""
    # rax: the address of the request; rdi is turned by 3, 13, 61 and 51 bits, and rbx
    # exchanged with itself.
    code = "4889f8 31d2 48c1c703 48c1c70d 48c1c73d 48c1c733 4887db 4889d0 c3"
    memory = mmap.mmap(
        -1, mmap.PAGESIZE, prot=mmap.PROT_READ | mmap.PROT_WRITE | mmap.PROT_EXEC
    )
    memory.write(bytes.fromhex(code))
    place = ctypes.c_char.from_buffer(memory)
    call = ctypes.CFUNCTYPE(ctypes.c_uint64, ctypes.c_void_p)(ctypes.addressof(place))
    call.memory = place  # which lives as long as the function

    def request(number: int, text: str = "") -> int:
        name = ctypes.create_string_buffer(text.encode())
        words = (ctypes.c_uint64 * 6)(
            (ord("C") << 24 | ord("T") << 16) + number, ctypes.addressof(name)
        )
        return call(ctypes.addressof(words))

    return request


def stages_of(fingers: int, stack: ExitStack) -> Iterator[Stage]:
    """Yield the stages in order, each made ready: what one takes is what the one before
    has made."""
    from tactophone.core.types import AudioBlock
    from tactophone.net.link.codec import Codec
    from tactophone.signal.perception import model_file

    model_file.SLOWEST = model_file.MODEL_PROBE_TIMEOUT = (
        1000  # the counter slows everything down
    )
    sound, codec = (
        strokes(2 * fingers),
        Codec("opus", channels=2 * fingers, packet_size=PACKET),
    )
    blocks = [
        AudioBlock(sound[at : at + PACKET], RATE, at)
        for at in range(0, (WARM_UP + MEASURED) * PACKET, PACKET)
    ]
    yield capturing(fingers, sound, stack)
    encoded, wires, sessions = (
        list[Any](),
        [list[bytes]() for _ in range(3)],
        list[Any](),
    )
    yield from sending(codec, blocks, stack, encoded, wires, sessions)
    heard = list[AudioBlock]()
    yield from receiving(codec, encoded, wires, sessions, heard)
    yield from deciding(fingers, heard, wires[2], sessions[2], stack)


def halves(some: list[Any]) -> tuple[list[Any], list[Any]]:
    return some[:WARM_UP], some[WARM_UP:]


def capturing(fingers: int, sound: Any, stack: ExitStack) -> Stage:
    import numpy as np

    from tactophone.live.audio.sources import LiveSource

    device, periods = FakeDevice(), MEASURED * PACKET // PERIOD
    joined = iter(
        stack.enter_context(LiveSource(device.take, channels=2 * fingers)).joined()
    )
    columns = [
        np.ascontiguousarray(sound[:, channel]) for channel in range(2 * fingers)
    ]

    def capture(first: int, count: int) -> None:
        for start in range(first * PERIOD, (first + count) * PERIOD, PERIOD):
            device.process([column[start : start + PERIOD] for column in columns], [])
            next(joined)

    capture(0, 20)
    return Stage("robot", "capture", "period", periods, lambda: capture(20, periods))


def sending(
    codec: Any,
    blocks: list[Any],
    stack: ExitStack,
    encoded: list[Any],
    wires: list[list[bytes]],
    sessions: list[Any],
) -> Iterator[Stage]:
    """Yield the robot's stages and the socket's; fill what was encoded, the datagrams
    to three operators, and these."""
    from tactophone.net.link.stream import (
        BlockEncoder,
        Packetizer,
        Redundancy,
        RedundancyRule,
    )
    from tactophone.net.link.udp import UdpSocket

    encoder, (early, due) = BlockEncoder(codec), halves(blocks)

    def encode(some: list[Any]) -> None:
        for block in some:
            encoded.extend(encoder.push(block))

    encode(early)
    yield Stage("robot", "encode", "packet", MEASURED, lambda: encode(due), "opus")

    group, found = connected(3, codec)
    sessions += found
    rule, packed = Redundancy(RedundancyRule()), [list[bytes]() for _ in range(3)]
    streams = [
        Packetizer(encoder, ssrc=member.stream.ssrc, redundancy=rule)
        for member in group.members
    ]

    def pack(number: int, some: list[Any]) -> None:
        for each in some:
            packed[number].append(bytes(streams[number].packet(each)))

    pack(0, encoded[:WARM_UP])
    yield Stage(
        "robot", "packet", "packet", MEASURED, lambda: pack(0, encoded[WARM_UP:])
    )
    pack(1, encoded)
    pack(2, encoded)

    def protect(number: int, some: list[bytes]) -> None:
        session = group.members[number].session
        for packet in some:
            session.send(packet)
            wires[number] += [datagram for datagram, _ in session.outgoing()]

    protect(0, packed[0][:WARM_UP])
    yield Stage(
        "robot",
        "protect",
        "packet",
        MEASURED,
        lambda: protect(0, packed[0][WARM_UP:]),
        "srtp",
    )
    protect(1, packed[1])
    protect(2, packed[2])

    here, there = (stack.enter_context(UdpSocket("127.0.0.1")) for _ in range(2))
    there.follow((here.address, frozenset({streams[0].ssrc})))
    sent = wires[0][WARM_UP:]

    def send(some: list[bytes]) -> None:
        for datagram in some:
            here.send([(datagram, there.address)])

    def receive(some: list[bytes]) -> None:
        for datagram in some:
            here.send([(datagram, there.address)])
            there.receive(0.5)

    send(sent[:8])
    yield Stage("robot", "send", "packet", MEASURED, lambda: send(sent))
    while there.receive(0):
        pass
    receive(sent[:8])
    yield Stage("operator", "receive", "packet", MEASURED, lambda: receive(sent))


def receiving(
    codec: Any,
    encoded: list[Any],
    wires: list[list[bytes]],
    sessions: list[Any],
    heard: list[Any],
) -> Iterator[Stage]:
    """Yield the stages from datagram to sound, and fill that."""
    from tactophone.core.types import AudioBlock
    from tactophone.net.link.codec import open_decoder

    def unprotect(some: list[bytes]) -> None:
        for datagram in some:
            sessions[0].session.receive(datagram, source=ROBOT, now=1.0)

    early, due = halves(wires[0])
    unprotect(early)
    yield Stage(
        "operator", "unprotect", "packet", MEASURED, lambda: unprotect(due), "srtp"
    )

    decoder, decoded = open_decoder(codec.kind), list[Any]()

    def decode(some: list[bytes]) -> None:
        for content in some:
            decoded.append(decoder.decode(content))

    contents, later = halves([each.content for each in encoded])
    decode(contents)
    yield Stage("operator", "decode", "packet", MEASURED, lambda: decode(later), "opus")
    heard += [
        AudioBlock(samples, RATE, PACKET * number)
        for number, samples in enumerate(decoded)
    ]

    def order(first: int, some: list[bytes]) -> None:
        for number, datagram in enumerate(some, first):
            sessions[1].receive([(datagram, ROBOT)], now=1 + number / 400)

    early, ordered = halves(wires[1])
    order(0, early)
    yield Stage(
        "operator", "order", "packet", MEASURED, lambda: order(WARM_UP, ordered)
    )


def deciding(
    fingers: int, heard: list[Any], wire: list[bytes], session: Any, stack: ExitStack
) -> Iterator[Stage]:
    """Yield the stages from sound to vibration."""
    import numpy as np

    from tactophone.core.types import HapticCommand
    from tactophone.live.runtime import wiring
    from tactophone.live.runtime.output_gate import FingerOutput
    from tactophone.live.runtime.recorder import SessionRecorder
    from tactophone.live.telemetry.layout import MARKS
    from tactophone.live.telemetry.writer import Telemetry
    from tactophone.net.endpoints import OperatorEndpoint
    from tactophone.signal.haptics.oscillator import Oscillator
    from tactophone.signal.perception.model_file import Engine

    settings = settings_of(fingers)
    alone, whole = (wiring.open_endpoint(settings, session).hand for _ in range(2))
    detector, windows = (
        alone.pipelines[0].detector.main.window_detector,
        MEASURED * PACKET // 512,
    )
    shape = detector.card.channels, detector.card.window_size
    engine = Engine(detector.network.session)
    memory = engine.new_state()
    window = [
        np.random.default_rng(0).normal(0, 0.1, shape).astype(np.float32)
    ] * fingers

    def graph(count: int) -> None:
        for _ in range(count):
            engine.run(window, [True] * fingers, [memory] * fingers)

    graph(3)
    yield Stage(
        "operator", "graph", "window", windows, lambda: graph(windows), "onnxruntime"
    )

    steps = list[list[Any]]()

    def decide(some: list[Any]) -> None:
        for block in some:
            steps.append(list(whole.push(block)))

    early, due = halves(heard)
    decide(early)
    yield Stage("operator", "decide", "packet", MEASURED, lambda: decide(due))

    endpoint, bounded = OperatorEndpoint(session, whole), list[Any]()
    outputs = [
        FingerOutput(settings, Oscillator(), endpoint, index=number)
        for number in range(fingers)
    ]

    def submit(some: list[list[Any]]) -> None:
        for each in some:
            for step in each:
                bounded.append(outputs[step.finger].submit(step))

    submit(steps[WARM_UP - 40 : WARM_UP])
    yield Stage(
        "operator", "command", "packet", MEASURED, lambda: submit(steps[WARM_UP:])
    )

    telemetry = stack.enter_context(Telemetry(f"cost-{os.getpid()}", fingers=fingers))
    recorder = SessionRecorder(telemetry, settings, role="operator")
    logged = [
        session.session.receive(datagram, source=ROBOT, now=1.0) for datagram in wire
    ]

    def record(first: int, count: int) -> None:
        for number in range(first, first + count):
            now = number / 400
            recorder.arrival(now, logged[number], False)
            if steps[number]:
                for name in ("received", "released", "decoded", "detected"):
                    recorder.mark(PACKET * number, (MARKS.index(name), now))
            for step in steps[number]:
                recorder.publish(step, now=now)
            if recorder.due(now):
                recorder.write()

    record(WARM_UP - 40, 40)
    yield Stage(
        "operator", "telemetry", "packet", MEASURED, lambda: record(WARM_UP, MEASURED)
    )

    outs, periods = (
        [np.zeros(PERIOD, np.float32) for _ in range(fingers)],
        MEASURED * PACKET // PERIOD,
    )

    def render(count: int) -> None:
        for number in range(count):
            for finger, (output, out) in enumerate(zip(outputs, outs, strict=True)):
                if number % 4 == 0:
                    output.renderer.submit(
                        HapticCommand(0.1 + 0.05 * (number % 8), 60.0, number / 375)
                    )
                output.renderer.render(out)
                telemetry.rendered(out, finger=finger)

    render(20)
    yield Stage("operator", "render", "period", periods, lambda: render(periods))


ROBOT = ("127.0.0.1", 5000)


class FakeDevice:
    """A sound device whose periods come by a call."""

    xruns = losses = process_faults = 0
    lost = False
    sample_rate, latency, fault = RATE, 0.0, ""
    open = revive = close = lambda self: None

    def take(self, process: Any) -> "FakeDevice":
        self.process = process
        return self


def settings_of(fingers: int) -> Any:
    from tactophone.core.hand import with_fingers
    from tactophone.core.settings import Settings, change

    settings = change(Settings(), ["link.codec=opus", "link.packet_duration=0.0025"])
    return with_fingers(settings, str(fingers)) if fingers > 1 else settings


def strokes(channels: int) -> Any:
    """Return noise, and from the middle on strokes, of shape ``(samples,
    channels)``."""
    import numpy as np

    size = (WARM_UP + MEASURED) * PACKET + PERIOD
    time, gains = np.arange(size) / RATE, np.tile([1, 0.3], channels // 2)
    strength = 0.003 + 0.1 * np.maximum(0, np.sin(2 * np.pi * 2 * (time - 0.9))) * (
        time > 0.9
    )
    return (
        np.random.default_rng(0).standard_normal((size, channels))
        * strength[:, None]
        * gains
    ).astype(np.float32)


def connected(operators: int, codec: Any) -> tuple[Any, list[Any]]:
    """Connect a robot to this number of operators in memory."""
    from tactophone.net.link.identity import Identity, Peers
    from tactophone.net.link.receive import ReceiveSession
    from tactophone.net.link.send import SendGroup
    from tactophone.net.link.session import Session

    robot, identities = (
        Identity.create("robot"),
        [Identity.create(f"operator {n}") for n in range(operators)],
    )
    trusted, trusting = (
        Peers({each.fingerprint: each.name for each in identities}),
        Peers({robot.fingerprint: "robot"}),
    )
    group = SendGroup([Session(robot, trusted, call=ROBOT) for _ in identities], codec)
    sessions = [ReceiveSession(Session(each, trusting)) for each in identities]
    for step in range(20):
        for number, (member, answering) in enumerate(
            zip(group.members, sessions, strict=True)
        ):
            group.poll(step / 100, operator=number)
            for datagram, _ in member.session.outgoing():
                answering.receive([(datagram, ROBOT)], now=step / 100)
            group.receive(
                [(d, ROBOT) for d, _ in answering.session.outgoing()],
                now=step / 100,
                operator=number,
            )
    assert len(group.connected) == operators
    return group, sessions


if __name__ == "__main__":
    main()
