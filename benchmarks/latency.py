"""Latency of the whole chain on a JACK server without a card: both processes on this machine, sealed, loopback.

Run ``python benchmarks/latency.py``; ``--clicks 300`` for firmer tails. Prints the table of docs/latency.md.
"""

import argparse
import os
import shutil
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import psutil

from tactophone import config
from tactophone.config import Settings
from tactophone.devices import DummyServer
from tactophone.measurement.failsafe_timing import outlive
from tactophone.measurement.impulse_latency import Measured
from tactophone.measurement.latency import Graph, Sides, measure, running_sides

OPUS_2_5 = ("link.codec=opus", "link.packet_duration=0.0025")
OPUS_5 = ("link.codec=opus", "link.packet_duration=0.005")
OPUS_10 = ("link.codec=opus", "link.packet_duration=0.01")
JUDGED = ("link.judge=true",)
PCM_128 = ("link.codec=pcm16", f"link.packet_duration={128 / 48_000}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--clicks", type=int, default=80, help="clicks a row (default: 80, in all under three minutes)")
    clicks = parser.parse_args().clicks
    print("| what | goal | measured | |\n|---|---|---|---|")
    row("click to first vibration, 128 samples, Opus 2.5 ms", "p50 <= 5.5, p99 <= 9 ms", run(128, OPUS_2_5, clicks))
    row("the same, PCM", "p50 <= 2, p99 <= 4 ms", run(128, PCM_128, clicks))
    row("the same, judged on the robot, belief alone", "(for lines that cannot carry sound)", run(128, JUDGED, clicks))
    row("512 samples as in the paper, Opus 10 ms", "p50 <= 14, p99 <= 21 ms", run(512, OPUS_10, clicks))
    with busy(2):
        row("128 samples, Opus 2.5 ms, two busy processes", "p99 <= 12 ms", run(128, OPUS_2_5, clicks))
        ordinary = (*OPUS_2_5, "process.priority=0")
        row("the same without real-time priority", "(against)", run(128, ordinary, clicks))
    jacktrip()
    print(f"| robot killed until -60 dB | <= 100 ms | {outlived(kill_robot)} | 5 times: median, worst |")
    print(f"| operator frozen until -60 dB | <= 100 ms | {outlived(freeze_operator)} | 5 times: median, worst |")
    print(f"| processor time, both ends, 5 ms packets | <= 25 % of a core | {processor_time():.1f} % | over 10 s |")


def row(what: str, goal: str, measured: Measured) -> None:
    if not len(measured.end_to_end):
        print(f"| {what} | {goal} | nothing was felt | {measured.restarts} restarts |", flush=True)
        return
    p50, p95, p99 = 1000 * np.percentile(measured.end_to_end, (50, 95, 99))
    note = f"{measured.clicks} clicks, {measured.missed} missed; budget within {1000 * measured.disagreement:.2f} ms"
    note += f"; {measured.restarts} restarts" if measured.restarts else ""
    print(f"| {what} | {goal} | p50 {p50:.2f}, p95 {p95:.2f}, p99 {p99:.2f} ms | {note} |", flush=True)


def run(period: int, changes: tuple[str, ...], clicks: int) -> Measured:
    with DummyServer(period) as server:
        return measure(settings(*changes), Graph(server.name), clicks=clicks)


def settings(*changes: str) -> Settings:
    return config.change(Settings(), [f"process.name=benchmark-{os.getpid()}", *changes])


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Keep so many processors busy with other processes."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def kill_robot(sides: Sides) -> None:
    os.kill(sides.robot.pid, signal.SIGKILL)


def freeze_operator(sides: Sides) -> None:
    os.kill(sides.operator.pid, signal.SIGSTOP)


def outlived(end: Callable[[Sides], None]) -> str:
    """On a sound server that goes on without who is late and repeats his last period, as JACK does by default."""
    with DummyServer(128, synchronous=False) as server:
        times = [1000 * outlive(settings(*OPUS_2_5), Graph(server.name), end) for _ in range(5)]
    return f"{statistics.median(times):.0f}, {max(times):.0f} ms"


def processor_time(duration: float = 10.0) -> float:
    """Percent of one core that both processes take, while a stroke is felt."""
    with DummyServer(128) as server, running_sides(settings(*OPUS_5), Graph(server.name)) as sides:
        processes = [psutil.Process(side.pid) for side in (sides.robot, sides.operator)]
        before = sum(sum(process.cpu_times()[:2]) for process in processes)
        time.sleep(duration)
        after = sum(sum(process.cpu_times()[:2]) for process in processes)
    return 100 * (after - before) / duration


def jacktrip() -> None:
    if shutil.which("jacktrip") is None:
        print("| JackTrip, PCM, 128 samples, queue 4 | (against) | not installed here | field.md: 8.0 ms |")


if __name__ == "__main__":
    main()
