"""Latency of the whole system on a JACK server without a sound card: both processes on this machine, encrypted.

Run ``python benchmarks/latency.py``; ``--impulses 300`` for more precise tails, ``--only PART`` for less. Prints the
tables of docs/guide/latency.md. JackTrip is measured beside it where it is installed: ``apt install jacktrip``.
"""

import argparse
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

import peers
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
)

OPUS_2_5 = ("link.codec=opus", "link.packet_duration=0.0025")
OPUS_5 = ("link.codec=opus", "link.packet_duration=0.005")
OPUS_10 = ("link.codec=opus", "link.packet_duration=0.01")
PREDICTIONS = ("link.send_predictions=true",)
PARTS = ("delays", "short", "peers", "failures")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--impulses", type=int, default=60, help="impulses for each row (default: 60)")
    parser.add_argument("--only", choices=PARTS)
    args = parser.parse_args()
    print("| quantity | goal | measured | |\n|---|---|---|---|")
    if args.only in (None, "delays"):
        print_delays(args.impulses)
    if args.only in (None, "short"):
        print_short_periods(args.impulses)
    if args.only in (None, "peers"):
        print_peers(args.impulses)
    if args.only in (None, "failures"):
        print(f"| robot killed, until -60 dB | <= 100 ms | {times_to_silence(kill_robot)} | 5 times: median, worst |")
        print(f"| operator frozen, until -60 dB | <= 100 ms | {times_to_silence(freeze_operator)} | the same |")


def print_delays(impulses: int) -> None:
    row("impulse to first vibration, 128 samples, Opus 2.5 ms", "p50 <= 5.5, p99 <= 9 ms", run(128, OPUS_2_5, impulses))
    row("the same, PCM", "p50 <= 2, p99 <= 4 ms", run(128, pcm(128), impulses))
    predictions = run(128, PREDICTIONS, impulses)
    row("the same, detector on the robot, predictions only", "(for links too slow for sound)", predictions)
    row("512 samples as in the paper, Opus 10 ms", "p50 <= 14, p99 <= 18 ms", run(512, OPUS_10, impulses))
    with busy(2):
        row("128 samples, Opus 2.5 ms, two busy processes", "p99 <= 12 ms", run(128, OPUS_2_5, impulses))
        ordinary = (*OPUS_2_5, "process.priority=0")
        row("the same without real-time priority", "(comparison)", run(128, ordinary, impulses))


def print_short_periods(impulses: int) -> None:
    row("64 samples, PCM", "p50 <= 1.0, p99 <= 2.0 ms, 0 missed", run(64, pcm(64), impulses))
    row("64 samples, Opus 2.5 ms", "p50 <= 4.5, p99 <= 6 ms, 0 missed", run(64, OPUS_2_5, impulses))
    row("32 samples, PCM", "p50 <= 0.7, p99 <= 1.5 ms, 0 missed", run(32, pcm(32), impulses))


def print_peers(impulses: int) -> None:
    """Measure JackTrip with the same impulses on the same server; it sends PCM, unencrypted."""
    if not peers.installed():
        print("| JackTrip | (comparison) | not installed: `apt install jacktrip` | |")
        return
    for period, queue in ((64, 4), (64, 2), (128, 4), (128, 2), (512, 4)):
        default = ", its default" if queue == 4 else ""
        found = peers.jacktrip(period, queue=queue, impulses=impulses)
        row(f"JackTrip, {period} samples, queue {queue}{default}", "(comparison)", found)
    row("512 samples, PCM of 128", "p50 <= a quarter of JackTrip's", run(512, pcm(128), impulses))


def row(quantity: str, goal: str, measured: ImpulseLatency) -> None:
    if not len(measured.end_to_end):
        print(f"| {quantity} | {goal} | no vibration | {measured.restarts} restarts |", flush=True)
        return
    p50, p95, p99 = 1000 * np.percentile(measured.end_to_end, (50, 95, 99))
    note = f"{measured.impulses} impulses, {measured.missed} missed"
    note += f"; budget within {1000 * measured.disagreement:.2f} ms" if measured.disagreement >= 0 else ""
    note += f"; {measured.restarts} restarts" if measured.restarts else ""
    print(f"| {quantity} | {goal} | p50 {p50:.2f}, p95 {p95:.2f}, p99 {p99:.2f} ms | {note} |", flush=True)


def run(period: int, changes: tuple[str, ...], impulses: int) -> ImpulseLatency:
    with DummyServer(period) as server:
        return measure(settings(*changes), Graph(server.name), impulses=impulses)


def pcm(samples: int) -> tuple[str, ...]:
    return "link.codec=pcm16", f"link.packet_duration={samples / 48_000}"


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


if __name__ == "__main__":
    main()
