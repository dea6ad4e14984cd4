"""How the cost grows with fingers: processor time, latency, memory and bitrate of 1, 2,
5 and 10, and equal decisions.

    python benchmarks/scale.py [--fingers 1,5] [--rows 64-pcm]
    python benchmarks/scale.py --operators 1,2,4    # what each costs their robot

Both ends run on this machine at a JACK server without a sound card. Processor time is
of both processes together, in percent of one core, the median of one-second stretches,
with packets of 5 ms and with those of the row. In use, the ports of all microphones
carry strokes and the check of the microphones is on; ``--sounds`` adds columns of 5 ms
packets with background noise alone (``air``) and with exact zeros and the check off
(``silence``), which cost least and tell least. Latency is from an impulse at all
microphones to the vibration of the last finger, with the check on. The operator's
memory is what is resident (RSS) without the memory of the JACK server, which maps and
locks it whole in every client; in brackets with it, and the proportional share (PSS).
`ROWS` holds further settings: add to it what is to be measured by fingers.
"""

import argparse
import os
import statistics
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import NamedTuple

if __name__ == "__main__":  # not in the ends' processes, whose memory is measured
    import numpy as np
    import psutil

    from second_operator import with_operator
    from tactophone.core.hand import with_fingers
    from tactophone.core.settings import Settings, change
    from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, Prediction
    from tactophone.live.audio.dummy import DummyServer
    from tactophone.live.runtime.operator import run_operator
    from tactophone.live.runtime.pairing import pair_on_one_machine, temporary_keys
    from tactophone.live.runtime.robot import run_robot
    from tactophone.live.runtime.supervisor import Supervisor
    from tactophone.live.telemetry.watcher import Watcher
    from tactophone.net.link.codec import Codec
    from tactophone.net.link.identity import Identity, Peers
    from tactophone.net.link.send import SendGroup
    from tactophone.net.link.session import Session
    from tactophone.net.link.udp import UdpSocket
    from tactophone.signal.pipeline import Hand, open_pipeline
    from tactophone_lab.measurement.impulses import (
        Graph,
        ImpulseLatency,
        measure,
        microphone_ports,
        running_sides,
    )
    from tactophone_lab.measurement.port_sounds import PORT_SOUNDS, PortSound, playing

OPUS = ("link.codec=opus", "link.packet_duration=0.0025")
LONG_PACKETS = ("link.codec=opus", "link.packet_duration=0.005")

SHORT_PCM = ("link.codec=pcm16", f"link.packet_duration={32 / 48_000}")
"""Half of a period of 64 samples: a whole one of five fingers does not fit a
datagram."""

ROWS: dict[str, tuple[int, tuple[str, ...]]] = {
    "128-opus": (128, OPUS),
    "128-opus-5ms": (128, LONG_PACKETS),
    "64-pcm": (64, SHORT_PCM),
}
"""Name, period in samples, and settings."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--fingers", default="1,2,5,10", help="numbers of fingers (default: 1,2,5,10)"
    )
    parser.add_argument(
        "--rows",
        default="128-opus",
        help=f"settings, of {', '.join(ROWS)} (default: %(default)s)",
    )
    parser.add_argument(
        "--operators",
        help="numbers of operators of one robot with one finger, in place of fingers",
    )
    parser.add_argument(
        "--sounds",
        default="silence,air,strokes",
        help="that the ports carry while processor time is measured, of "
        f"{', '.join(PORT_SOUNDS)} (default: %(default)s)",
    )
    parser.add_argument(
        "--impulses", type=int, default=60, help="for the latency (default: 60)"
    )
    parser.add_argument(
        "--seconds", type=int, default=10, help="of processor time (default: 10)"
    )
    args = parser.parse_args()
    if args.operators:
        numbers = list(map(int, args.operators.split(",")))
        each = packet_costs(numbers)
        print(
            "| operators | settings | processor time of the robot | connected | to "
            "encode, seal and send a packet |"
        )
        print("|--:|---|--:|--:|--:|")
        for name in args.rows.split(","):
            for operators in numbers:
                print(
                    robot_row(name, operators, each[operators], seconds=args.seconds),
                    flush=True,
                )
        return
    sounds = [sound for sound in PORT_SOUNDS if sound in args.sounds.split(",")]
    shares = [f"5 ms packets, {sound}" for sound in sounds]
    print("Processor time is of both ends, of one core; memory is the operator's.\n")
    print(
        f"| fingers | settings | {' | '.join(shares)} | as settings, {sounds[-1]} "
        "| latency, p50 / p99 | impulses missed | memory | Mbit/s "
        "| decisions as alone | load |"
    )
    print(f"|--:|---|{'--:|' * (len(sounds) + 5)}---|--:|")
    for name in args.rows.split(","):
        for fingers in map(int, args.fingers.split(",")):
            print(
                row(
                    name,
                    fingers,
                    sounds,
                    impulses=args.impulses,
                    seconds=args.seconds,
                ),
                flush=True,
            )


def row(
    name: str,
    fingers: int,
    sounds: "Sequence[PortSound]",
    *,
    impulses: int,
    seconds: int,
) -> str:
    period, changes = ROWS[name]
    settings = settings_of(fingers, changes)
    with DummyServer(period) as server:
        with_long_packets = [
            running_cost(
                settings_of(fingers, LONG_PACKETS), server.name, seconds, sound
            )
            for sound in sounds
        ]
        cost = running_cost(settings, server.name, seconds, sounds[-1])
        measured = measure(settings, Graph(server.name), impulses=impulses)
    cells = [
        str(fingers),
        name,
        *(found.shares for found in with_long_packets),
        cost.shares,
        latency(measured),
        measured.incidents,
        cost.memory,
        f"{cost.bitrate:.2f}",
        "equal" if decisions_equal(fingers) else "DIFFERENT",
        f"{os.getloadavg()[0]:.0f}",
    ]
    return f"| {' | '.join(cells)} |"


def packet_costs(numbers: list[int], *, packets: int = 1500) -> dict[int, float]:
    """Return the median processor time (µs) of sending a packet of 2.5 ms, for each
    number of operators; packets are paced, so caches are cold."""
    sound = np.random.default_rng(0).normal(0, 0.05, (120, 2)).astype(np.float32)
    costs: dict[int, list[float]] = {number: [] for number in numbers}
    with ExitStack() as stack:
        sink = stack.enter_context(UdpSocket("127.0.0.1"))
        sockets = [stack.enter_context(UdpSocket()) for _ in range(max(numbers))]
        groups = {number: connected_group(number) for number in numbers}
        for packet in range(packets):
            for number, group in groups.items():
                time.sleep(0.0025)
                begun = time.thread_time()
                group.push(AudioBlock(sound, LIVE_SAMPLE_RATE, 120 * packet))
                for member, socket in zip(group.members, sockets, strict=False):
                    socket.send(
                        [
                            (datagram, sink.address)
                            for datagram, _ in member.session.outgoing()
                        ]
                    )
                costs[number].append(1e6 * (time.thread_time() - begun))
    return {
        number: statistics.median(found[packets // 5 :])
        for number, found in costs.items()
    }


def connected_group(operators: int) -> "SendGroup":
    """Connect a robot to operators in memory, who then stay silent."""
    robot, identities = (
        Identity.create("robot"),
        [Identity.create(f"operator {n}") for n in range(operators)],
    )
    trusted, trusting = (
        Peers({each.fingerprint: each.name for each in identities}),
        Peers({robot.fingerprint: "robot"}),
    )
    calling = [Session(robot, trusted, call=("192.0.2.1", 6000)) for _ in identities]
    answering = [Session(each, trusting) for each in identities]
    group = SendGroup(calling, Codec("opus", packet_size=120))
    for step in range(20):
        for number, (member, answerer) in enumerate(
            zip(group.members, answering, strict=True)
        ):
            group.poll(step / 100, operator=number)
            for datagram, _ in member.session.outgoing():
                answerer.receive(datagram, source=("192.0.2.2", 5000), now=step / 100)
            replies = [
                (datagram, ("192.0.2.1", 6000)) for datagram, _ in answerer.outgoing()
            ]
            group.receive(replies, now=step / 100, operator=number)
    assert len(group.connected) == operators
    return group


def robot_row(name: str, operators: int, packet_cost: float, *, seconds: int) -> str:
    """Measure the robot alone, sending to operators without actuators, each in a
    process of its own."""
    period, changes = ROWS[name]
    free = [
        "capture.contact=-",
        "capture.air=-",
        "capture.source=jack",
    ]
    with ExitStack() as stack:
        server = stack.enter_context(DummyServer(period))
        settings = change(
            settings_of(1, changes), [*free, f"process.jack_server={server.name}"]
        )
        folder = stack.enter_context(temporary_keys())
        robot, first = pair_on_one_machine(
            change(settings, ["output.actuator=none"]),
            folder,
            name=f"scale-{os.getpid()}-1",
        )
        receiving = [first]
        for number in range(2, operators + 1):
            robot, another = with_operator(
                robot, first, folder, name=f"scale-{os.getpid()}-{number}"
            )
            receiving.append(another)
        for each in receiving:
            stack.enter_context(Supervisor(run_operator, each, name=each.process.name))
        side = stack.enter_context(
            Supervisor(run_robot, robot, name=robot.process.name)
        )
        process, watcher, shares = psutil.Process(side.pid), Watcher(side.name), []
        stack.enter_context(
            playing(
                "strokes",
                microphone_ports(settings),
                robot=side.name,
                server=server.name,
            )
        )
        time.sleep(3)
        for _ in range(seconds):
            before, begun = sum(process.cpu_times()[:2]), time.monotonic()
            time.sleep(1)
            shares.append(
                100
                * (sum(process.cpu_times()[:2]) - before)
                / (time.monotonic() - begun)
            )
        connected = watcher.snapshot().gauges["operators"]
    return (
        f"| {operators} | {name} | {statistics.median(shares):.1f} % | "
        f"{connected:.0f} | {packet_cost:.0f} µs |"
    )


def settings_of(fingers: int, changes: tuple[str, ...]) -> "Settings":
    settings = change(Settings(), [f"process.name=scale-{os.getpid()}", *changes])
    return with_fingers(settings, str(fingers)) if fingers > 1 else settings


class RunningCost(NamedTuple):
    """Percent of a core of each end, the operator's memory in words, and Mbit/s on the
    wire."""

    robot: float
    operator: float
    memory: str
    bitrate: float

    @property
    def shares(self) -> str:
        return (
            f"{self.robot + self.operator:.1f} % (robot {self.robot:.1f}, operator "
            f"{self.operator:.1f})"
        )


def running_cost(
    settings: "Settings", server: str, seconds: int, sound: "PortSound"
) -> RunningCost:
    if sound == "silence":
        # Of exact zeros, the check says that the microphones are dead.
        settings = change(settings, ["detector.check_microphones=false"])
    with (
        running_sides(settings, Graph(server)) as sides,
        playing(
            sound, microphone_ports(settings), robot=sides.robot.name, server=server
        ),
    ):
        processes = [psutil.Process(side.pid) for side in (sides.robot, sides.operator)]
        time.sleep(2)
        shares: list[list[float]] = [[], []]
        for _ in range(seconds):
            before, begun = (
                [sum(process.cpu_times()[:2]) for process in processes],
                time.monotonic(),
            )
            time.sleep(1)
            for share, process, earlier in zip(shares, processes, before, strict=True):
                share.append(
                    100
                    * (sum(process.cpu_times()[:2]) - earlier)
                    / (time.monotonic() - begun)
                )
        bitrate = Watcher(sides.operator.name).totals()[1]["bitrate_bps"]
        memory = memory_of(processes[1])
    robot, operator = map(statistics.median, shares)
    return RunningCost(robot, operator, memory, bitrate / 1e6)


def memory_of(process: "psutil.Process") -> str:
    whole = process.memory_full_info()
    server = sum(
        part.rss for part in process.memory_maps() if "/dev/shm/jack-" in part.path
    )
    own, rss, pss = (
        (size + 5e5) // 1e6 for size in (whole.rss - server, whole.rss, whole.pss)
    )
    return f"{own:.0f} MB ({rss:.0f}, PSS {pss:.0f})"


def latency(measured: "ImpulseLatency") -> str:
    if not len(measured.end_to_end):
        return "no vibration"
    p50, p99 = 1000 * np.percentile(measured.end_to_end, (50, 99))
    return f"{p50:.2f} / {p99:.2f} ms"


def decisions_equal(fingers: int, *, size: int = 120, duration: float = 1.0) -> bool:
    """Compare each finger's predictions in a hand with what its pipeline alone
    predicts: classes, and P(rough) to 1e-5."""
    random = np.random.default_rng(0)
    strength = (
        0.1
        * (1 + np.sin(np.arange(round(duration * LIVE_SAMPLE_RATE)) / 9000))[:, None]
    )
    noise = random.standard_normal((len(strength), 2 * fingers))
    samples = (strength * noise).astype(np.float32)
    hand = Hand(
        [
            open_pipeline(sample_rate=LIVE_SAMPLE_RATE, channels=2)
            for _ in range(fingers)
        ]
    )
    together: list[list[Prediction]] = [[] for _ in range(fingers)]
    for start in range(0, len(samples), size):
        for step in hand.push(
            AudioBlock(samples[start : start + size], LIVE_SAMPLE_RATE, start)
        ):
            together[step.finger] += step.predictions
    for finger, found in enumerate(together):
        pipeline = open_pipeline(sample_rate=LIVE_SAMPLE_RATE, channels=2)
        own = np.ascontiguousarray(samples[:, 2 * finger : 2 * finger + 2])
        alone: list[Prediction] = []
        for start in range(0, len(own), size):
            alone += pipeline.push(
                AudioBlock(own[start : start + size], LIVE_SAMPLE_RATE, start)
            ).predictions
        if [item.touch for item in alone] != [
            item.touch for item in found
        ] or not alone:
            return False
        if not np.allclose(
            [item.roughness for item in alone],
            [item.roughness for item in found],
            rtol=0,
            atol=1e-5,
        ):
            return False
    return True


if __name__ == "__main__":
    main()
