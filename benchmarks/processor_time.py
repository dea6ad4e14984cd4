"""Processor time and wake-ups of every thread of a live run, and processor time of a packet from socket to command.

    python benchmarks/processor_time.py [--packet-ms 5] [--period 128]

Both ends run as processes of their own on a JACK server without a sound card, with noise like a stroke at the
microphones. The second table runs the operator in this process, fed by a robot in another over a real socket at the
pace of its packets, so that caches are as cold as in live use; a packet's cost is the processor time of the network
thread from one read of the socket to the next.
"""

import argparse
import multiprocessing
import os
import time
from pathlib import Path
from typing import Any

import numpy as np

from tactophone import config
from tactophone.config import Settings
from tactophone.devices import DummyServer, JackClient
from tactophone.link import UdpSocket
from tactophone.measurement import Graph, running_sides
from tactophone.runtime import Operator, ProcessInfo, operator, pair_on_one_machine, run_robot, temporary_keys
from tactophone.types import AudioBlock

DURATION = 10.0
PACKETS = 4_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--packet-ms", type=float, default=5.0)
    parser.add_argument("--period", type=int, default=128, help="samples of a period of the sound server")
    parser.add_argument("--codec", choices=("opus", "pcm16"), default="opus")
    parser.add_argument("--only", choices=("threads", "packets"))
    args = parser.parse_args()
    settings = config.change(Settings(), [f"link.packet_duration={args.packet_ms / 1000}", f"link.codec={args.codec}"])
    if args.only != "packets":
        print_threads(settings, args.period)
    if args.only != "threads":
        print_packets(settings)


def print_threads(settings: Settings, period: int) -> None:
    settings = config.change(settings, [f"process.name=processor-{os.getpid()}"])
    with DummyServer(period) as server, running_sides(settings, Graph(server.name)) as sides:
        robot = sides.robot.name
        sound = {"contact": f"{robot}:contact", "air": f"{robot}:air"}
        player = JackClient("player", Noise(), inputs={}, outputs=sound, server=server.name)
        player.open()
        time.sleep(2.0)
        before = {side: threads(each.pid) for side, each in (("robot", sides.robot), ("operator", sides.operator))}
        time.sleep(DURATION)
        after = {side: threads(each.pid) for side, each in (("robot", sides.robot), ("operator", sides.operator))}
        player.close()
    print(f"\n| end | thread | % of a core, {period} samples | wake-ups a second |\n|---|---|--:|--:|")
    totals = np.zeros(2)
    for side, found in after.items():
        for name, now in found.items():
            share, wake_ups = rates = (now - before[side].get(name, np.zeros(2))) / DURATION * (100, 1)
            totals += rates
            if share >= 0.1:
                print(f"| {side} | {name} | {share:.1f} | {wake_ups:.0f} |")
    print(f"| both | all | {totals[0]:.1f} | {totals[1]:.0f} |", flush=True)


class Noise:
    """Plays noise like a stroke: the process of a JACK client."""

    def __init__(self) -> None:
        self._noise = np.random.default_rng(0).standard_normal(1 << 16, np.float32)
        self._position = 0

    def __call__(self, _: list[np.ndarray], outputs: list[np.ndarray]) -> None:
        size = len(outputs[0])
        self._position = (self._position + size) % (len(self._noise) - 2 * size)
        outputs[0][:] = 0.1 * self._noise[self._position : self._position + size]
        outputs[1][:] = 0.01 * self._noise[self._position + size : self._position + 2 * size]


def threads(pid: int) -> dict[str, np.ndarray]:
    """Return processor time in s and wake-ups of each thread of a process, by its name in the kernel."""
    found: dict[str, np.ndarray] = {}
    for folder in sorted(Path(f"/proc/{pid}/task").iterdir()):
        name = (folder / "comm").read_text().strip()
        priority = int((folder / "stat").read_text().rpartition(")")[2].split()[37])
        if folder.name == str(pid):
            name = "main"
        elif not name.startswith("tactophone"):
            name = "JACK's callback" if priority > 60 else "others"
        nanoseconds = int((folder / "schedstat").read_text().split()[0])
        slept = (folder / "status").read_text().partition("\nvoluntary_ctxt_switches:")[2].split()[0]
        found[name] = found.get(name, np.zeros(2)) + np.array((nanoseconds / 1e9, int(slept)))
    return found


class MeteredSocket(UdpSocket):
    """Notes the processor time of the thread that reads, and how many datagrams each read returned."""

    reads: list[tuple[int, int]]

    def receive(self, timeout: float) -> list[Any]:
        datagrams = super().receive(timeout)
        self.reads.append((time.thread_time_ns(), len(datagrams)))
        return datagrams


def print_packets(settings: Settings) -> None:
    MeteredSocket.reads = reads = []
    operator.UdpSocket = MeteredSocket  # type: ignore[attr-defined]
    settings = config.change(settings, ["output.actuator=none", "detector.check_microphones=false"])
    with temporary_keys() as folder:
        robot_settings, operator_settings = pair_on_one_machine(settings, folder, name=f"packets-{os.getpid()}")
        context = multiprocessing.get_context("spawn")
        robot = context.Process(target=send, args=(robot_settings,), daemon=True)
        with Operator(operator_settings, ProcessInfo(operator_settings.process.name)) as side:
            windows: list[int] = []
            side._endpoint.pipeline.detector.detector.trace = lambda *_: windows.append(len(reads))  # type: ignore
            robot.start()
            while sum(count > 0 for _, count in reads[:]) < PACKETS and robot.is_alive():
                side.housekeep(time.monotonic())
                time.sleep(0.02)
            done = len(reads) - 1
        robot.terminate()
        robot.join()
    costs = np.diff([moment for moment, _ in reads[: done + 1]]) / 1e6
    counts = np.array([count for _, count in reads[:done]])
    with_window = np.isin(np.arange(1, done + 1), windows)
    alone = (counts == 1) & (np.arange(done) > done // 4)
    duration = 1000 * settings.link.packet_duration
    print(f"\n| a packet of {duration:g} ms ({settings.link.codec}), socket to command | goal | mean | p50 | p95 |")
    print("|---|--:|--:|--:|--:|")
    for name, goal, chosen in (
        ("no window falls due", "0.15 ms", alone & ~with_window),
        ("a window falls due", "0.5 ms", alone & with_window),
    ):
        found = costs[chosen]
        if len(found):
            p50, p95 = np.percentile(found, (50, 95))
            print(f"| {name} ({len(found)}) | {goal} | {found.mean():.2f} | {p50:.2f} | {p95:.2f} |", flush=True)


def send(settings: Settings) -> None:
    run_robot(settings, ProcessInfo(settings.process.name), open_source=open_noise)


def open_noise(_: Settings) -> "NoiseSource":
    return NoiseSource()


class NoiseSource:
    """Endless noise like a stroke, in blocks of 128 samples."""

    sample_rate, channels = 48_000, 2

    def __enter__(self) -> "NoiseSource":
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def __iter__(self) -> Any:
        rng, scale, start = np.random.default_rng(0), np.float32([0.1, 0.01]), 0
        while True:
            yield AudioBlock(rng.standard_normal((128, 2), np.float32) * scale, 48_000, start)
            start += 128


if __name__ == "__main__":
    main()
