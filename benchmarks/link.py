"""The line under loss, jitter, stalls, skewed clocks and attack, in virtual time: ``python benchmarks/link.py``.

Takes about two minutes. Figures in virtual time do not depend on the machine; only processor time does.
"""

import argparse
import random
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from tactophone.endpoints import OperatorEndpoint, RobotEndpoint, open_pipeline
from tactophone.errors import ModelError
from tactophone.haptics import Oscillator
from tactophone.link import Codec, DecodedAudio, PacketReceived, Playout, ReceiveSession, SendSession
from tactophone.link.packet import parse
from tactophone.link.playout_clock import PlayoutController
from tactophone.simulation import TAKES, SimulatedFinger, find, single, take_moves
from tactophone.simulation.network.impairments import ImpairedLine, NetworkProfile
from tactophone.simulation.network.virtual_link import ROBOT_ADDRESS, VirtualLine, paired_ends
from tactophone.types import AudioBlock, FloatArray, PipelineStep, Touch

RATE = 48_000
HOP = 512 / RATE
OPUS = Codec("opus", packet_size=240)
THINGS = ("smooth competition stone", "20", "whiteboard", "lava stone")


@dataclass(frozen=True)
class Row:
    what: str
    goal: str
    figure: str
    against: str = ""

    def __str__(self) -> str:
        return f"| {self.what} | {self.goal} | {self.figure} | {self.against} |"


def noise(duration: float) -> FloatArray:
    return np.random.default_rng(0).normal(0, 0.05, (round(duration * RATE), 2)).astype(np.float32)


# -- delay, lasting or not ---------------------------------------------------------------------------------------------


def delay_after_loss() -> Iterator[Row]:
    """Ten clean seconds and sixty at 5 % loss: the delay just before and at the end, judged and played."""
    line, playout = VirtualLine(*paired_ends(OPUS)), Playout(block_size=240)
    begun, sound = line.connect(0.0), noise(1)
    judged: list[tuple[float, float]] = []
    played: list[tuple[float, float]] = []
    tap(line, playout)
    for step in range(75 * 200):
        if step in (0, 2_000, 14_000):
            line.there = ImpairedLine(NetworkProfile(loss=0.05 if step == 2_000 else 0.0, delay=0.002), seed=1)
        now = begun + (step + 1) * 0.005
        line.robot.push(AudioBlock(sound[step * 240 % RATE :][:240], RATE, step * 240))
        heard = [one for one in line.carry(now) + line.carry(now + 0.002) if isinstance(one, DecodedAudio)]
        judged += [(step * 0.005, now + 0.002 - begun - one.block.end / RATE) for one in heard]
        playout.pull(now=now + 0.002)
        played.append((step * 0.005, playout.pace.delay(now)))
    for name, delays, goal in (("judged", judged, "+ <= 1 ms"), ("played", played, "+ <= 10 ms, back within 5 s")):
        before, during, after = (median(delays, span) for span in ((5, 10), (65, 70), (74, 75)))
        worst = float(np.quantile([delay for when, delay in delays if 60 <= when < 70], 0.99))
        yield Row(
            f"delay at the end of 60 s at 5 % loss against before, {name}",
            goal,
            f"{1e3 * (during - before):+.2f} ms (p99 {1e3 * (worst - before):+.1f}), "
            f"{1e3 * (after - before):+.2f} ms 5 s later",
            "aiortc +200 ms, never back",
        )


def tap(line: VirtualLine, playout: Playout) -> None:
    """Let a playout have every packet that the operator's session opens."""
    opened = line.operator.session.receive

    def receive(datagram: bytes, *, source: object, now: float) -> list:
        events = opened(datagram, source=source, now=now)
        for event in events:
            if isinstance(event, PacketReceived) and not event.report:
                playout.push(parse(event.packet), now=now)
        return events

    line.operator.session.receive = receive  # type: ignore[method-assign]


def median(delays: list[tuple[float, float]], span: tuple[float, float]) -> float:
    return float(np.median([delay for when, delay in delays if span[0] <= when < span[1]]))


# -- playout -----------------------------------------------------------------------------------------------------------


def arrived_but_not_used() -> Iterator[Row]:
    """A minute of sound through the clocked buffer, over a line with 5 % loss and 0 to 30 ms of jitter."""
    line, playout = VirtualLine(*paired_ends(OPUS)), Playout(block_size=128)
    begun, sound = line.connect(0.0), noise(60)
    line.there = ImpairedLine(NetworkProfile(loss=0.05, spread=0.03, overtaking=True), seed=1)
    tap(line, playout)
    for step in range(60 * 375):
        now = begun + (step + 1) * 128 / RATE
        line.robot.push(AudioBlock(sound[step * 128 :][:128], RATE, step * 128))
        line.carry(now)
        playout.pull(now=now)
    stats = playout.reception.stats
    share = stats.packets_late / stats.packets_received
    yield Row(
        "arrived but not used, 5 % loss, 0-30 ms jitter, playout",
        "<= 0.5 %",
        f"{share:.2%} at {1e3 * playout.pace.delay(now):.0f} ms of delay",
        "aiortc 21 %",
    )


def skewed_clocks() -> Iterator[Row]:
    """Eight hours of 20 ms packets with 2 ms of exponential jitter, by times alone."""
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
            "no under- or overrun, delay within 2 ms",
            f"delay within {1e3 * np.ptp(settled):.2f} ms; {late} of {count} packets late ({late / count:.3%})",
            "zita-style loop: unstable",
        )


# -- decisions ---------------------------------------------------------------------------------------------------------


def strokes(duration: float) -> FloatArray:
    """Smooth and rough things stroked in turn."""
    sounds = []
    for seed, name in enumerate(THINGS):
        scene = single(find(name))
        moves = take_moves(TAKES[4], scene.placed[0], duration=duration / 4, rng=np.random.default_rng(seed))
        finger = SimulatedFinger(scene, moves, seed=seed, duration=duration / 4, block_size=RATE, place=(0.04, 0.035))
        sounds += [block.samples for block in finger]
    return np.concatenate(sounds)


def walked(
    sound: FloatArray, profile: NetworkProfile, model: str
) -> tuple[list[tuple[float, PipelineStep]], VirtualLine]:
    line = VirtualLine(*paired_ends(OPUS))
    sender = RobotEndpoint(line.robot)
    receiver = OperatorEndpoint(line.operator, open_pipeline(model, sample_rate=RATE, channels=2))
    begun, ticks = line.connect(0.0), []
    line.there = ImpairedLine(profile, seed=7)
    for start in range(0, len(sound) - 119, 120):
        now = (start + 120) / RATE
        sender.push(AudioBlock(sound[start : start + 120], RATE, start))
        ticks += [(now, tick) for news in line.carry(begun + now) if (tick := receiver.take(news))]
    return ticks, line


def decisions(ticks: list[tuple[float, PipelineStep]], duration: float) -> np.ndarray:
    """What is believed at each moment of the operator's time, a hop apart."""
    beliefs = [(when, tick.predictions[-1].touch) for when, tick in ticks if tick.predictions and tick.commands]
    times = np.array([when for when, _ in beliefs])
    touches = np.array([Touch.NONE, *(touch for _, touch in beliefs)])
    return touches[np.searchsorted(times, np.arange(0.5, duration, HOP), side="right")]


def same_decisions(sound: FloatArray, model: str) -> Iterator[Row]:
    duration = len(sound) / RATE
    clean = decisions(walked(sound, NetworkProfile(), model)[0], duration)
    lines = [(f"{loss:.0%} random loss", NetworkProfile(loss=loss), goal) for loss, goal in LOSSES.items()]
    lines.append(("bursts (Gilbert-Elliott, mean 5 packets, 5 %)", NetworkProfile(loss=0.05, burst=5), 95.0))
    for name, profile, goal in lines:
        ticks, line = walked(sound, profile, model)
        same = float((decisions(ticks, duration) == clean).mean())
        counters = line.operator.counters
        mended = counters["packets_recovered"] / max(1, counters["packets_lost"])
        yield Row(f"same decisions, {name}", f">= {goal:g} %", f"{same:.1%} ({mended:.0%} of the lost mended)")


LOSSES = {0.01: 99.5, 0.05: 98.0, 0.1: 95.0, 0.2: 90.0}


def stall_and_clump(sound: FloatArray, model: str) -> Iterator[Row]:
    """All is held back for 200 ms, in each tenth of the sound; what follows, and what the finger feels of it."""
    line = VirtualLine(*paired_ends(OPUS))
    receiver = OperatorEndpoint(line.operator, open_pipeline(model, sample_rate=RATE, channels=2))
    oscillator, out, begun = Oscillator(), np.zeros(120, np.float32), line.connect(0.0)
    waits, steepest, last, stalled_until = [], 0.0, 0.0, 0.0
    for start in range(0, len(sound) - 119, 120):
        now = (start + 120) / RATE
        line.robot.push(AudioBlock(sound[start : start + 120], RATE, start))
        held = now > 1 and now % 2 < 0.2
        if held:
            stalled_until = now
        else:
            ticks = [tick for news in line.carry(begun + now) if (tick := receiver.take(news))]
            commands = [command for tick in ticks for command in tick.commands]
            if commands:
                oscillator.submit(commands[-1])
                if stalled_until:
                    waits.append(now - stalled_until)
                    stalled_until = 0.0
        oscillator.render(out)
        steepest = max(steepest, float(np.abs(np.diff(out, prepend=last)).max()))
        last = float(out[-1])
    yield Row(
        "200 ms stall, then a clump",
        "normal in <= 150 ms, no step > 0.02",
        f"normal in {1e3 * max(waits):.0f} ms at worst ({len(waits)} stalls), largest step {steepest:.4f}",
    )


def processor_time(sound: FloatArray, model: str) -> Iterator[Row]:
    duration = len(sound) / RATE
    begun = time.process_time()
    walked(sound, NetworkProfile(), model)
    share = (time.process_time() - begun) / duration
    yield Row("processor time, both ends together, 5 ms packets, hot", "<= 25 % of one core", f"{share:.1%}")


# -- attack ------------------------------------------------------------------------------------------------------------


def hostile(count: int) -> Iterator[Row]:
    """Forged, truncated, bit-flipped, replayed and reordered datagrams against a running session."""
    line = VirtualLine(*paired_ends(Codec("pcm16", packet_size=120)))
    now, sound = line.connect(0.0), noise(1)
    for start in range(0, RATE // 2, 120):
        line.robot.push(AudioBlock(sound[start : start + 120], RATE, start))
    genuine = [datagram for datagram, _ in line.robot.outgoing()]
    line.operator.receive([(datagram, ROBOT_ADDRESS) for datagram in genuine], now=now)
    before, accepted = state(line.operator), 0
    hello = stranger_hello()
    begun = time.perf_counter()
    for datagram in attacks(genuine, hello, count):
        accepted += len(line.operator.receive([(datagram, ROBOT_ADDRESS)], now=now))
    spent = time.perf_counter() - begun
    unchanged = state(line.operator) == before
    line.robot.push(AudioBlock(sound[:120], RATE, RATE // 2))
    lives = any(isinstance(one, DecodedAudio) for one in line.carry(now))
    yield Row(
        f"hostile datagrams, {count:,}",
        "none accepted, none crashes, none changes state",
        f"{accepted} accepted, state {'unchanged' if unchanged else 'CHANGED'}, "
        f"session {'lives on' if lives else 'DEAD'}; {1e6 * spent / count:.1f} us each",
        "JackTrip: one ends the session",
    )


def state(end: ReceiveSession) -> tuple[object, ...]:
    counters = {name: total for name, total in end.counters.items() if name != "packets_rejected"}
    return end.session.peer, counters, end.origin, repr(end.stats)


def stranger_hello() -> bytes:
    robot: SendSession
    robot, _ = paired_ends(OPUS)
    robot.poll(0.0)
    return robot.outgoing()[0][0]


def attacks(genuine: list[bytes], hello: bytes, count: int) -> Iterator[bytes]:
    dice = random.Random(1)
    for number in range(count):
        packet = genuine[dice.randrange(len(genuine))]
        place = dice.randrange(len(packet))
        match number % 100:
            case 0:
                yield hello[:27] + dice.randbytes(32) + hello[59:]
            case 1:
                yield bytes([dice.randrange(20, 64)]) + dice.randbytes(dice.randrange(100))
            case low if low < 25:
                yield struct.pack("!BBH", 0x80, 98, number % 65_536) + dice.randbytes(dice.randrange(4, 600))
            case low if low < 45:
                yield packet[:place]
            case low if low < 75:
                yield packet[:place] + bytes([packet[place] ^ 1 << dice.randrange(8)]) + packet[place + 1 :]
            case _:
                yield packet  # again, and in any order


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--model", default="", help="model to judge with; default: the shipped one")
    parser.add_argument("--seconds", type=float, default=40.0, help="sound for the decisions, s")
    parser.add_argument("--datagrams", type=int, default=1_000_000, help="hostile datagrams")
    args = parser.parse_args()
    print("| what | goal | figure | against |\n|---|---|---|---|")
    for rows in (delay_after_loss(), arrived_but_not_used(), decided(args), skewed_clocks(), hostile(args.datagrams)):
        for row in rows:
            print(row, flush=True)


def decided(args: argparse.Namespace) -> Iterator[Row]:
    sound = strokes(args.seconds)
    try:
        for rows in (same_decisions, stall_and_clump, processor_time):
            yield from rows(sound, args.model)
    except ModelError as error:
        yield Row("decisions", "", f"left out: {error}")


if __name__ == "__main__":
    main()
