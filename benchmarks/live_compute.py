"""Processor cost of detection and rendering: one paced update, the speed of `feel`,
memory, import time.

    python benchmarks/live_compute.py [--model NAME|FILE] [--fingers N]

Each figure is measured in its own process, on one thread, without torch. An update is
the work of the operator's side in one hop: resampling, features, network, contact gate,
decision, command, and rendering of one hop of vibration, for all fingers together. It
is *paced*: the process sleeps between updates, so that its caches are as cold as in
live use (a loop without pauses is several times faster). Wall clock and processor time
are printed side by side; the difference is other load on the machine. The speed of the
machine varies by a third within minutes, so updates are given as the median of several
runs, with their range in brackets.
"""

import argparse
import json
import math
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

RATE = 48_000
HOP_SIZE = 512
UPDATES = 2_000
RUNS = 7
FEEL_DURATION = 120
IMPORTS = 9
CLOCKS = "wall", "processor"
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--model", default="paper", help="a two-channel model; default: %(default)s"
    )
    parser.add_argument(
        "--fingers", type=int, default=1, help="in one batch; default: 1"
    )
    parser.add_argument(
        "--runs", type=int, default=RUNS, help="of 21 s each; default: %(default)s"
    )
    parser.add_argument("--child", choices=("paced", "import"), help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child == "paced":
        print(json.dumps(paced(args.model, args.fingers)))
    elif args.child == "import":
        print(json.dumps(import_once()))
    else:
        print_table(args.model, args.fingers, args.runs)


def print_table(model: str, fingers: int, runs: int) -> None:
    updates = [
        child("--child", "paced", "--model", model, "--fingers", str(fingers))
        for _ in range(runs)
    ]
    imports = [child("--child", "import") for _ in range(IMPORTS)]
    speed = feel_speed(model)
    rows = [
        ("update, p50", *(over_runs(updates, clock, 50) for clock in CLOCKS)),
        ("update, p99", *(over_runs(updates, clock, 99) for clock in CLOCKS)),
        (
            "`feel`, two channels at 48 kHz",
            f"{speed['wall']:.0f} x real time",
            f"{speed['processor']:.0f} x real time",
        ),
        (
            "memory, live side",
            f"{max(update['memory_mb'] for update in updates):.0f} MB",
            "",
        ),
        (
            "`import tactophone`",
            f"{statistics.median(once['wall'] for once in imports):.3f} s",
            f"{statistics.median(once['processor'] for once in imports):.3f} s",
        ),
    ]
    hop_ms = 1000 * HOP_SIZE / RATE
    print(
        f"Model `{model}` on ONNX Runtime, fingers: {fingers}, {runs} x {UPDATES} "
        f"updates at a hop of {hop_ms:.2f} ms, "
        "torch loaded: no.\n"
    )
    print("| quantity | wall clock | processor time |\n|---|--:|--:|")
    for row in rows:
        print(f"| {' | '.join(row)} |")


def over_runs(updates: list[dict], clock: str, percentile: int) -> str:
    """Format the median of a percentile over the runs, and its range."""
    found = [update[clock][percentile] for update in updates]
    return f"{statistics.median(found):.2f} ms ({min(found):.2f}-{max(found):.2f})"


def child(*arguments: str) -> dict:
    """Run this script in a child process, on one thread."""
    command = [sys.executable, __file__, *arguments]
    done = subprocess.run(
        command, env=os.environ | ONE_THREAD, stdout=subprocess.PIPE, check=True
    )
    return json.loads(done.stdout)


def paced(model: str, fingers: int = 1) -> dict:
    import numpy as np

    from tactophone.core.types import AudioBlock
    from tactophone.signal.haptics.oscillator import Oscillator
    from tactophone.signal.pipeline import Hand, open_pipeline

    # On one core: a process that moves between cores finds colder caches.
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    hand = Hand(
        [open_pipeline(model, sample_rate=RATE, channels=2) for _ in range(fingers)]
    )
    oscillators = [Oscillator() for _ in range(fingers)]
    out = np.empty(HOP_SIZE, np.float32)
    wall, processor = np.empty(UPDATES), np.empty(UPDATES)
    due = time.perf_counter()
    for n, samples in enumerate(strokes(UPDATES, fingers)):
        block = AudioBlock(samples, RATE, n * HOP_SIZE)
        due += HOP_SIZE / RATE
        time.sleep(max(0.0, due - time.perf_counter()))
        began, worked = time.perf_counter(), time.thread_time()
        for step in hand.push(block):  # none where the sound waits for more
            for command in step.commands:
                oscillators[step.finger].submit(command)
        for oscillator in oscillators:
            oscillator.render(out)
        wall[n], processor[n] = time.perf_counter() - began, time.thread_time() - worked
    if "torch" in sys.modules:
        raise SystemExit(
            "torch was loaded, so the figures would not hold for the live system"
        )
    return {
        "wall": percentiles(wall[50:]),  # the first half second has no full window
        "processor": percentiles(processor[50:]),
        "memory_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3,
    }


def percentiles(times: Any) -> list[float]:
    """Return the percentiles 0 to 100, in ms."""
    import numpy as np

    return [float(value) for value in np.percentile(times, range(101)) * 1e3]


def import_once() -> dict:
    began, worked = time.perf_counter(), time.process_time()
    import tactophone  # noqa: F401

    return {
        "wall": time.perf_counter() - began,
        "processor": time.process_time() - worked,
    }


def feel_speed(model: str) -> dict:
    """Measure `feel` on a recording; processor time includes the start of the process,
    wall clock does not."""
    import soundfile

    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / "strokes.wav"
        with soundfile.SoundFile(recording, "w", samplerate=RATE, channels=2) as file:
            for samples in strokes(FEEL_DURATION * RATE // HOP_SIZE):
                file.write(samples)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        done = subprocess.run(
            [
                sys.executable,
                "-m",
                "tactophone",
                "feel",
                str(recording),
                "--model",
                model,
                "--out",
                folder,
                "--json",
            ],
            stdout=subprocess.PIPE,
            check=True,
            env=os.environ | ONE_THREAD,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    worked = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {
        "wall": json.loads(done.stdout)[0]["speed"],
        "processor": FEEL_DURATION / worked,
    }


def strokes(count: int, fingers: int = 1) -> Iterator[Any]:
    """Yield blocks of noise modulated like strokes, contact and air of each finger."""
    import numpy as np

    rng, levels = np.random.default_rng(0), np.float32([1, 0.1] * fingers)
    for n in range(count):
        strength = 0.1 * max(0.0, math.sin(2 * math.pi * n * HOP_SIZE / RATE))
        yield rng.standard_normal((HOP_SIZE, 2 * fingers), np.float32) * (
            strength * levels
        )


if __name__ == "__main__":
    main()
