"""Latency of the whole system on a JACK server without a sound card: both processes on this machine, encrypted.

Run ``python benchmarks/latency.py``; ``--impulses 300`` for more precise tails. Prints the table of
docs/guide/latency.md.
"""

import argparse
import os
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
from tactophone.measurement import (
    Graph,
    ImpulseLatency,
    Sides,
    freeze_operator,
    kill_robot,
    measure,
    measure_time_to_silence,
    running_sides,
)

OPUS_2_5 = ("link.codec=opus", "link.packet_duration=0.0025")
OPUS_5 = ("link.codec=opus", "link.packet_duration=0.005")
OPUS_10 = ("link.codec=opus", "link.packet_duration=0.01")
PREDICTIONS = ("link.send_predictions=true",)
PCM_128 = ("link.codec=pcm16", f"link.packet_duration={128 / 48_000}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--impulses", type=int, default=80, help="impulses for each row (default: 80, under 3 minutes)")
    impulses = parser.parse_args().impulses
    print("| quantity | goal | measured | |\n|---|---|---|---|")
    row("impulse to first vibration, 128 samples, Opus 2.5 ms", "p50 <= 5.5, p99 <= 9 ms", run(128, OPUS_2_5, impulses))
    row("the same, PCM", "p50 <= 2, p99 <= 4 ms", run(128, PCM_128, impulses))
    predictions = run(128, PREDICTIONS, impulses)
    row("the same, detector on the robot, predictions only", "(for links too slow for sound)", predictions)
    row("512 samples as in the paper, Opus 10 ms", "p50 <= 14, p99 <= 21 ms", run(512, OPUS_10, impulses))
    with busy(2):
        row("128 samples, Opus 2.5 ms, two busy processes", "p99 <= 12 ms", run(128, OPUS_2_5, impulses))
        ordinary = (*OPUS_2_5, "process.priority=0")
        row("the same without real-time priority", "(comparison)", run(128, ordinary, impulses))
    print(f"| robot killed, until -60 dB | <= 100 ms | {times_to_silence(kill_robot)} | 5 times: median, worst |")
    print(f"| operator frozen, until -60 dB | <= 100 ms | {times_to_silence(freeze_operator)} | the same |")
    print(f"| processor time, both ends, 5 ms packets | <= 25 % of a core | {processor_time():.1f} % | over 10 s |")


def row(quantity: str, goal: str, measured: ImpulseLatency) -> None:
    if not len(measured.end_to_end):
        print(f"| {quantity} | {goal} | no vibration | {measured.restarts} restarts |", flush=True)
        return
    p50, p95, p99 = 1000 * np.percentile(measured.end_to_end, (50, 95, 99))
    note = f"{measured.impulses} impulses, {measured.missed} missed"
    note += f"; budget within {1000 * measured.disagreement:.2f} ms"
    note += f"; {measured.restarts} restarts" if measured.restarts else ""
    print(f"| {quantity} | {goal} | p50 {p50:.2f}, p95 {p95:.2f}, p99 {p99:.2f} ms | {note} |", flush=True)


def run(period: int, changes: tuple[str, ...], impulses: int) -> ImpulseLatency:
    with DummyServer(period) as server:
        return measure(settings(*changes), Graph(server.name), impulses=impulses)


def settings(*changes: str) -> Settings:
    return config.change(Settings(), [f"process.name=benchmark-{os.getpid()}", *changes])


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Run ``count`` processes that keep processors busy."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def times_to_silence(stop: Callable[[Sides], None]) -> str:
    """Median and worst, on a sound server that repeats the last period of a late client, as JACK does by default."""
    with DummyServer(128, synchronous=False) as server:
        times = [1000 * measure_time_to_silence(settings(*OPUS_2_5), Graph(server.name), stop) for _ in range(5)]
    return f"{statistics.median(times):.0f}, {max(times):.0f} ms"


def processor_time(duration: float = 10.0) -> float:
    """Percent of one core that both processes take during a stroke."""
    with DummyServer(128) as server, running_sides(settings(*OPUS_5), Graph(server.name)) as sides:
        processes = [psutil.Process(side.pid) for side in (sides.robot, sides.operator)]
        before = sum(sum(process.cpu_times()[:2]) for process in processes)
        time.sleep(duration)
        after = sum(sum(process.cpu_times()[:2]) for process in processes)
    return 100 * (after - before) / duration


if __name__ == "__main__":
    main()
