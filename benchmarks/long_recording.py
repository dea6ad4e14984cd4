"""How much memory ``tactophone feel`` takes for recordings of several lengths.

    python benchmarks/long_recording.py                # three lengths and their slope
    python benchmarks/long_recording.py --hours 10     # ten hours: an hour and a half

The recordings are simulated strokes, repeated. Each one is processed by the verb in a
process of its own, whose greatest resident memory is read at its end. With two lengths
or more, the slope over them says what another hour adds.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
import soundfile

from tactophone_lab.simulation.demonstration import demonstration

RATE = 48_000
"""Hz, as microphones deliver."""

LIMIT_MB = 300
"""Memory that no length may need."""


FEEL = """
import sys, time
from tactophone.cli import main
if code := main(sys.argv[1:]):
    sys.exit(code)
[peak] = [line.split()[1] for line in open("/proc/self/status") if "VmHWM" in line]
print(peak, time.process_time())
"""
"""Runs a verb and prints its peak memory in kB and its processor time in s. A parent
would read the peak of its own memory too, as a child begins with a copy."""


class Run(NamedTuple):
    """What the verb took for one recording."""

    hours: float
    megabytes: float
    processor_seconds: float
    seconds: float


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--hours",
        default="0.1,0.2,0.4",
        help="lengths of the recordings, in hours (default: %(default)s)",
    )
    parser.add_argument(
        "--folder", type=Path, help="where 0.8 GB an hour of sound may be written"
    )
    args = parser.parse_args()
    strokes = np.concatenate([block.samples for block in demonstration(0)])
    with tempfile.TemporaryDirectory(dir=args.folder) as folder:
        runs = [
            measured(strokes, float(hours), Path(folder))
            for hours in args.hours.split(",")
        ]
    print("| hours | peak memory, MB | processor time, s | time, s |")
    print("|--:|--:|--:|--:|")
    for run in runs:
        print(
            f"| {run.hours:g} | {run.megabytes:.0f} | {run.processor_seconds:.0f} "
            f"| {run.seconds:.0f} |"
        )
    if len(runs) > 1:
        slope = np.polyfit(
            [run.hours for run in runs], [run.megabytes for run in runs], 1
        )[0]
        print(f"\n{slope:.1f} MB for each hour more")
    if (most := max(run.megabytes for run in runs)) > LIMIT_MB:
        sys.exit(f"{most:.0f} MB, where {LIMIT_MB} are allowed")


def measured(strokes: np.ndarray, hours: float, folder: Path) -> Run:
    """Write a recording as long as ``hours``, and run the verb on it."""
    path = folder / "long.flac"
    samples = int(hours * 3600 * RATE)
    with soundfile.SoundFile(path, "w", RATE, strokes.shape[1], "PCM_24") as file:
        while samples:
            part = strokes[:samples]
            file.write(part)
            samples -= len(part)
    began = time.perf_counter()
    process = subprocess.run(
        [sys.executable, "-c", FEEL, "feel", str(path), "--out", str(folder)],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
    )
    kilobytes, processor_seconds = process.stdout.splitlines()[-1].split()
    return Run(
        hours,
        int(kilobytes) / 1024,
        float(processor_seconds),
        time.perf_counter() - began,
    )


if __name__ == "__main__":
    main()
