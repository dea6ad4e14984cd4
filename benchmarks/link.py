"""The link under loss, jitter, stalls, clock skew and attack, in virtual time.

    python benchmarks/link.py

Takes about two minutes. Prints the table of docs/research/attack.md. Only processor
time depends on the machine.
"""

import argparse
import random
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactophone.core.errors import ModelError
from tactophone.core.types import AudioBlock, FloatArray, PipelineStep, Touch
from tactophone.net.endpoints import OperatorEndpoint, RobotEndpoint
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.events import PacketReceived
from tactophone.net.link.packet import parse_packet
from tactophone.net.link.playout import Playout, PlayoutController
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.send import SendGroup
from tactophone.net.link.stream import DecodedAudio
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.pipeline import open_pipeline
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES
from virtual_link import ROBOT_ADDRESS, VirtualLink, paired_sessions

RATE = 48_000
HOP = 512 / RATE
OPUS = Codec("opus", packet_size=240)
OBJECTS = ("smooth competition stone", "20", "whiteboard", "lava stone")


@dataclass(frozen=True)
class Row:
    quantity: str
    measured: str
    other_systems: str = ""

    def __str__(self) -> str:
        return f"| {self.quantity} | {self.measured} | {self.other_systems} |"


def noise(duration: float) -> FloatArray:
    return (
        np.random.default_rng(0)
        .normal(0, 0.05, (round(duration * RATE), 2))
        .astype(np.float32)
    )


# -- delay after loss ---------------------------------------------------------


def delay_after_loss() -> Iterator[Row]:
    """Delay before and at the end of 60 s at 5 % loss, for predictions and for
    playout."""
    link, playout = VirtualLink(*paired_sessions(OPUS)), Playout(block_size=240)
    start_time, sound = link.connect(0.0), noise(1)
    predicted: list[tuple[float, float]] = []
    played: list[tuple[float, float]] = []
    tap(link, playout)
    for step in range(75 * 200):
        if step in (0, 2_000, 14_000):
            link.to_operator = ImpairedLink(
                NetworkProfile(loss=0.05 if step == 2_000 else 0.0, delay=0.002), seed=1
            )
        now = start_time + (step + 1) * 0.005
        link.robot.push(AudioBlock(sound[step * 240 % RATE :][:240], RATE, step * 240))
        decoded = [
            event
            for event in link.carry(now) + link.carry(now + 0.002)
            if isinstance(event, DecodedAudio)
        ]
        predicted += [
            (step * 0.005, now + 0.002 - start_time - event.block.end / RATE)
            for event in decoded
        ]
        playout.pull(now=now + 0.002)
        played.append((step * 0.005, delay_of(playout.controller, now)))
    for name, delays in (("predictions", predicted), ("playout", played)):
        before, during, after = (
            median(delays, span) for span in ((5, 10), (65, 70), (74, 75))
        )
        worst = float(
            np.quantile([delay for when, delay in delays if 60 <= when < 70], 0.99)
        )
        yield Row(
            f"change of delay after 60 s at 5 % loss, {name}",
            f"{1e3 * (during - before):+.2f} ms (p99 {1e3 * (worst - before):+.1f}), "
            f"{1e3 * (after - before):+.2f} ms 5 s later",
            "aiortc +200 ms, permanent",
        )


def delay_of(controller: PlayoutController, now: float) -> float:
    """Return the seconds from a sample's arrival over the empty network to its
    playout."""
    return now - controller._min_transit - controller.position / RATE


def tap(link: VirtualLink, playout: Playout) -> None:
    """Pass every packet that the operator's session decrypts to a playout as well."""
    opened = link.operator.session.receive

    def receive(datagram: bytes, *, source: object, now: float) -> list:
        events = opened(datagram, source=source, now=now)
        for event in events:
            if isinstance(event, PacketReceived) and not event.report:
                playout.push(parse_packet(event.packet), now=now)
        return events

    link.operator.session.receive = receive  # type: ignore[method-assign]


def median(delays: list[tuple[float, float]], span: tuple[float, float]) -> float:
    return float(
        np.median([delay for when, delay in delays if span[0] <= when < span[1]])
    )


# -- playout ------------------------------------------------------------------


def received_but_not_used() -> Iterator[Row]:
    """Late packets in a minute of clocked playout, at 5 % loss and 0 to 30 ms of
    jitter."""
    link, playout = VirtualLink(*paired_sessions(OPUS)), Playout(block_size=128)
    start_time, sound = link.connect(0.0), noise(60)
    link.to_operator = ImpairedLink(
        NetworkProfile(loss=0.05, spread=0.03, overtaking=True), seed=1
    )
    tap(link, playout)
    for step in range(60 * 375):
        now = start_time + (step + 1) * 128 / RATE
        link.robot.push(AudioBlock(sound[step * 128 :][:128], RATE, step * 128))
        link.carry(now)
        playout.pull(now=now)
    stats = playout.reception.stats
    share = stats.packets_late / stats.packets_received
    yield Row(
        "received but not used, 5 % loss, 0-30 ms jitter, playout",
        f"{share:.2%} at {1e3 * delay_of(playout.controller, now):.0f} ms of delay",
        "aiortc 21 %",
    )


def skewed_clocks() -> Iterator[Row]:
    """Delay over eight hours of 20 ms packets with 2 ms of exponential jitter, without
    sound."""
    for ppm in (200, -200):
        generator, speed = np.random.default_rng(0), RATE * (1 + ppm * 1e-6)
        pace, count = PlayoutController(block_size=512), (8 * 3600 * 50)
        sent = (np.arange(count) + 1) * 960 / speed
        came = sent + 0.001 + generator.exponential(0.002, count)
        order = np.argsort(came, kind="stable").tolist()
        times, late, following, delays = came.tolist(), 0, 0, []
        for block in range(int(8 * 3600 * RATE / 512)):
            now = block * 512 / RATE
            while following < count and times[order[following]] <= now:
                start = 960 * order[following]
                late += start < pace.position
                pace.push(start, 960, now=times[order[following]])
                following += 1
            pace.step(512, now=now)
            if not block % 100:
                delays.append(now - pace.position / speed)
        settled = np.array(delays[len(delays) // 100 :])
        yield Row(
            f"clock skew {ppm:+d} ppm over 8 h, 2 ms jitter",
            f"delay within {1e3 * np.ptp(settled):.2f} ms; {late} of {count} packets "
            f"late ({late / count:.3%})",
            "zita-style loop: unstable",
        )


# -- decisions ----------------------------------------------------------------


def strokes(duration: float) -> FloatArray:
    """Sound of strokes over smooth and rough objects in turn."""
    sounds = []
    for seed, name in enumerate(OBJECTS):
        scene = single(find(name))
        moves = take_moves(
            TAKES[4],
            scene.placed[0],
            duration=duration / 4,
            rng=np.random.default_rng(seed),
        )
        finger = SimulatedFinger(
            scene,
            moves,
            seed=seed,
            duration=duration / 4,
            block_size=RATE,
            place=(0.04, 0.035),
        )
        sounds += [block.samples for block in finger]
    return np.concatenate(sounds)


def run_link(
    sound: FloatArray, profile: NetworkProfile, model: str
) -> tuple[list[tuple[float, PipelineStep]], ReceiveSession]:
    robot, operator = paired_sessions(OPUS)
    sender = RobotEndpoint(robot)
    link = VirtualLink(
        robot,
        OperatorEndpoint(operator, open_pipeline(model, sample_rate=RATE, channels=2)),
    )
    start_time, steps = link.connect(0.0), []
    link.to_operator = ImpairedLink(profile, seed=7)
    for start in range(0, len(sound) - 119, 120):
        now = (start + 120) / RATE
        sender.push(AudioBlock(sound[start : start + 120], RATE, start))
        steps += [(now, step) for _, step in link.carry(start_time + now) if step]
    return steps, operator


def decisions(steps: list[tuple[float, PipelineStep]], duration: float) -> np.ndarray:
    """The newest touch at each hop of the operator's time."""
    predictions = [
        (when, step.predictions[-1].touch)
        for when, step in steps
        if step.predictions and step.commands
    ]
    times = np.array([when for when, _ in predictions])
    touches = np.array([Touch.NONE, *(touch for _, touch in predictions)])
    return touches[np.searchsorted(times, np.arange(0.5, duration, HOP), side="right")]


def equal_decisions(sound: FloatArray, model: str) -> Iterator[Row]:
    duration = len(sound) / RATE
    clean = decisions(run_link(sound, NetworkProfile(), model)[0], duration)
    lines = [
        (f"{loss:.0%} random loss", NetworkProfile(loss=loss))
        for loss in (0.01, 0.05, 0.1, 0.2)
    ]
    lines.append(
        (
            "bursts (Gilbert-Elliott, mean 5 packets, 5 %)",
            NetworkProfile(loss=0.05, burst=5),
        )
    )
    for name, profile in lines:
        steps, operator = run_link(sound, profile, model)
        same = float((decisions(steps, duration) == clean).mean())
        counters = operator.counters
        recovered = counters["packets_recovered"] / max(1, counters["packets_lost"])
        measured = f"{same:.1%} ({recovered:.0%} of the lost packets recovered)"
        yield Row(f"equal decisions, {name}", measured)


def stall(sound: FloatArray, model: str) -> Iterator[Row]:
    """Recovery after stalls of 200 ms every 2 s, and the steepest step of the
    waveform."""
    robot, operator = paired_sessions(OPUS)
    link = VirtualLink(
        robot,
        OperatorEndpoint(operator, open_pipeline(model, sample_rate=RATE, channels=2)),
    )
    oscillator, out, start_time = (
        Oscillator(),
        np.zeros(120, np.float32),
        link.connect(0.0),
    )
    waits, steepest, last, stalled_until = [], 0.0, 0.0, 0.0
    for start in range(0, len(sound) - 119, 120):
        now = (start + 120) / RATE
        link.robot.push(AudioBlock(sound[start : start + 120], RATE, start))
        held = now > 1 and now % 2 < 0.2
        if held:
            stalled_until = now
        else:
            steps = [step for _, step in link.carry(start_time + now) if step]
            commands = [command for step in steps for command in step.commands]
            if commands:
                oscillator.submit(commands[-1])
                if stalled_until:
                    waits.append(now - stalled_until)
                    stalled_until = 0.0
        oscillator.render(out)
        steepest = max(steepest, float(np.abs(np.diff(out, prepend=last)).max()))
        last = float(out[-1])
    yield Row(
        "stall of 200 ms",
        f"normal in {1e3 * max(waits):.0f} ms at worst ({len(waits)} stalls), largest "
        f"step {steepest:.4f}"
        if waits
        else "not measured: the first stall comes after 2 s of sound",
    )


def processor_time(sound: FloatArray, model: str) -> Iterator[Row]:
    duration = len(sound) / RATE
    start_time = time.process_time()
    run_link(sound, NetworkProfile(), model)
    share = (time.process_time() - start_time) / duration
    yield Row(
        "processor time, both ends together, 5 ms packets, without pauses",
        f"{share:.1%} of one core",
    )


# -- attack -------------------------------------------------------------------


def hostile(count: int) -> Iterator[Row]:
    """Forged, truncated, bit-flipped, replayed and reordered datagrams against a
    running session."""
    link = VirtualLink(*paired_sessions(Codec("pcm16", packet_size=120)))
    now, sound = link.connect(0.0), noise(1)
    for start in range(0, RATE // 2, 120):
        link.robot.push(AudioBlock(sound[start : start + 120], RATE, start))
    genuine = [datagram for datagram, _ in link.robot.members[0].session.outgoing()]
    link.operator.receive([(datagram, ROBOT_ADDRESS) for datagram in genuine], now=now)
    before, accepted = state(link.operator), 0
    hello = untrusted_hello()
    start_time = time.perf_counter()
    for datagram in attacks(genuine, hello, count):
        accepted += len(link.operator.receive([(datagram, ROBOT_ADDRESS)], now=now))
    spent = time.perf_counter() - start_time
    unchanged = state(link.operator) == before
    link.robot.push(AudioBlock(sound[:120], RATE, RATE // 2))
    lives = any(isinstance(event, DecodedAudio) for event in link.carry(now))
    yield Row(
        f"{count:,} hostile datagrams",
        f"{accepted} accepted, state {'unchanged' if unchanged else 'CHANGED'}, "
        f"session {'lives on' if lives else 'DEAD'}; {1e6 * spent / count:.1f} us each",
        "JackTrip: one ends the session",
    )


def state(end: ReceiveSession) -> tuple[object, ...]:
    counters = {
        name: total
        for name, total in end.counters.items()
        if name != "packets_rejected"
    }
    return end.session.peer, counters, end.origin, repr(end.stats)


def untrusted_hello() -> bytes:
    robot: SendGroup
    robot, _ = paired_sessions(OPUS)
    robot.poll(0.0)
    return robot.members[0].session.outgoing()[0][0]


def attacks(genuine: list[bytes], hello: bytes, count: int) -> Iterator[bytes]:
    dice = random.Random(1)
    for number in range(count):
        packet = genuine[dice.randrange(len(genuine))]
        place = dice.randrange(len(packet))
        match number % 100:
            case 0:
                yield hello[:27] + dice.randbytes(32) + hello[59:]
            case 1:
                yield bytes([dice.randrange(20, 64)]) + dice.randbytes(
                    dice.randrange(100)
                )
            case low if low < 25:
                yield struct.pack("!BBH", 0x80, 98, number % 65_536) + dice.randbytes(
                    dice.randrange(4, 600)
                )
            case low if low < 45:
                yield packet[:place]
            case low if low < 75:
                yield (
                    packet[:place]
                    + bytes([packet[place] ^ 1 << dice.randrange(8)])
                    + packet[place + 1 :]
                )
            case _:
                yield packet  # replayed, in any order


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--model", default="", help="model of the detector; default: the shipped one"
    )
    parser.add_argument(
        "--seconds", type=float, default=40.0, help="seconds of sound for the decisions"
    )
    parser.add_argument(
        "--datagrams", type=int, default=1_000_000, help="number of hostile datagrams"
    )
    args = parser.parse_args()
    print("| quantity | measured | other systems |\n|---|---|---|")
    for rows in (
        delay_after_loss(),
        received_but_not_used(),
        decided(args),
        skewed_clocks(),
        hostile(args.datagrams),
    ):
        for row in rows:
            print(row, flush=True)


def decided(args: argparse.Namespace) -> Iterator[Row]:
    sound = strokes(args.seconds)
    try:
        for rows in (equal_decisions, stall, processor_time):
            yield from rows(sound, args.model)
    except ModelError as error:
        yield Row("decisions", f"not measured: {error}")


if __name__ == "__main__":
    main()
