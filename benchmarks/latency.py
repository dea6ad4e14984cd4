"""Latency of the whole system on a JACK server without a sound card: both processes on
this machine, encrypted.

Run ``python benchmarks/latency.py``; ``--impulses 300`` for more precise tails,
``--only PART`` for less. Prints the tables of docs/research/latency.md. Rows of short
periods end with their bound: the same impulses through codec, pipeline and renderer in
this process, as if no computation took any time. JackTrip is measured beside it where
it is installed: ``apt install jacktrip``.
"""

import argparse
import os
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

import peers
from cells import in_ms
from failsafe import freeze_operator, kill_robot, measure_time_to_silence
from tactophone.core.settings import Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE as RATE
from tactophone.core.types import AudioBlock
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.runtime.pairing import Sides
from tactophone.net.link.codec import Codec, open_decoder
from tactophone.net.link.stream import BlockEncoder
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.pipeline import open_pipeline
from tactophone_lab.measurement.impulses import (
    Graph,
    ImpulseLatency,
    ImpulsePlayer,
    measure,
)
from tactophone_lab.measurement.port_sounds import Background

OPUS_2_5 = ("link.codec=opus", "link.packet_duration=0.0025")
OPUS_5 = ("link.codec=opus", "link.packet_duration=0.005")
OPUS_10 = ("link.codec=opus", "link.packet_duration=0.01")
PREDICTIONS = ("link.send_predictions=true",)
PARTS = ("delays", "short", "peers", "failures")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--impulses", type=int, default=60, help="impulses for each row (default: 60)"
    )
    parser.add_argument("--only", choices=PARTS, help="one part (default: all)")
    args = parser.parse_args()
    print("| quantity | measured | |\n|---|---|---|")
    if args.only in (None, "delays"):
        print_delays(args.impulses)
    if args.only in (None, "short"):
        print_short_periods(args.impulses)
    if args.only in (None, "peers"):
        print_peers(args.impulses)
    if args.only in (None, "failures"):
        for name, stop in (
            ("robot killed", kill_robot),
            ("operator frozen", freeze_operator),
        ):
            print(f"| {name}, until -60 dB | {times_to_silence(stop)} | |", flush=True)


def print_delays(impulses: int) -> None:
    row(
        "impulse to first vibration, 128 samples, Opus 2.5 ms",
        run(128, OPUS_2_5, impulses),
    )
    row("the same, PCM", run(128, pcm(128), impulses))
    predictions = run(128, PREDICTIONS, impulses)
    row("the same, detector on the robot, predictions only", predictions)
    row("512 samples as in the paper, Opus 10 ms", run(512, OPUS_10, impulses))
    with busy(2):
        row(
            "128 samples, Opus 2.5 ms, two busy processes", run(128, OPUS_2_5, impulses)
        )
        ordinary = (*OPUS_2_5, "process.priority=0")
        row("the same without real-time priority", run(128, ordinary, impulses))


def print_short_periods(impulses: int) -> None:
    for name, period, changes in (
        ("64 samples, PCM", 64, pcm(64)),
        ("64 samples, Opus 2.5 ms", 64, OPUS_2_5),
        ("32 samples, PCM", 32, pcm(32)),
    ):
        row(
            name, run(period, changes, impulses), bound=bound(period, changes, impulses)
        )


def print_peers(impulses: int) -> None:
    """Measure JackTrip with the same impulses on the same server; it sends PCM,
    unencrypted."""
    if not peers.installed():
        print("| JackTrip | not installed: `apt install jacktrip` | |")
        return
    for period, queue in ((64, 4), (64, 2), (128, 4), (128, 2), (512, 4)):
        default = ", its default" if queue == 4 else ""
        found = peers.jacktrip(period, queue=queue, impulses=impulses)
        row(f"JackTrip, {period} samples, queue {queue}{default}", found)
    row("512 samples, PCM of 128", run(512, pcm(128), impulses))


def row(
    quantity: str, measured: ImpulseLatency, *, bound: NDArray[np.float64] | None = None
) -> None:
    if not len(measured.end_to_end):
        print(f"| {quantity} | no vibration | {measured.incidents} |", flush=True)
        return
    p50, p95, p99 = 1000 * np.percentile(measured.end_to_end, (50, 95, 99))
    note = f"{measured.impulses} impulses, {measured.incidents}"
    note += (
        f"; budget within {1000 * measured.disagreement:.2f} ms"
        if measured.disagreement >= 0
        else ""
    )
    if bound is not None:
        note += "; bound p50 {:.2f}, p95 {:.2f}, p99 {:.2f} ms".format(
            *1000 * np.percentile(bound, (50, 95, 99))
        )
    print(
        f"| {quantity} | p50 {p50:.2f}, p95 {p95:.2f}, p99 {p99:.2f} ms | {note} |",
        flush=True,
    )


def run(period: int, changes: tuple[str, ...], impulses: int) -> ImpulseLatency:
    with DummyServer(period) as server:
        return measure(settings(*changes), Graph(server.name), impulses=impulses)


def bound(period: int, changes: tuple[str, ...], impulses: int) -> NDArray[np.float64]:
    """Return the latencies (s) if nothing took any time: what arrives in a period is
    rendered in the next one."""
    link = settings(*changes).link
    player = ImpulsePlayer(impulses)
    background = Background()
    codec = Codec(
        "opus" if link.codec == "opus" else "pcm16",
        packet_size=round(link.packet_duration * RATE),
    )
    encoder, decoder = BlockEncoder(codec, prompt=True), open_decoder(codec.kind)
    pipeline, oscillator, position = (
        open_pipeline(sample_rate=RATE, channels=2),
        Oscillator(),
        0,
    )
    for start in range(0, len(player.vibration) - period, period):
        oscillator.render(player.vibration[start : start + period])
        played = player.played[:, start : start + period].copy()
        for port, sound in enumerate(played):
            background.add(sound, port, start)
        for encoded in encoder.push(AudioBlock(played.T.copy(), RATE, start)):
            step = pipeline.push(
                AudioBlock(decoder.decode(encoded.content), RATE, position)
            )
            position = step.block.end
            if step.command:
                oscillator.submit(step.command)
    return np.array([(onset - impulse) / RATE for impulse, onset in player.onsets()])


def pcm(samples: int) -> tuple[str, ...]:
    return "link.codec=pcm16", f"link.packet_duration={samples / 48_000}"


def settings(*changes: str) -> Settings:
    return change(Settings(), [f"process.name=benchmark-{os.getpid()}", *changes])


@contextmanager
def busy(count: int) -> Iterator[None]:
    """Run ``count`` processes that keep processors busy."""
    others = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"])
        for _ in range(count)
    ]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def times_to_silence(stop: Callable[[Sides], None]) -> str:
    """Median and worst of five, on a sound server that repeats the last period of a
    late client, as JACK does by default."""
    with DummyServer(128, synchronous=False) as server:
        times = [
            1000
            * measure_time_to_silence(settings(*OPUS_2_5), Graph(server.name), stop)
            for _ in range(5)
        ]
    return f"{in_ms(statistics.median(times))}, worst of five {in_ms(max(times))}"


if __name__ == "__main__":
    main()
