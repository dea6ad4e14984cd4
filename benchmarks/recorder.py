"""What `--record` costs: processor time of the recorder, and the run's latency with and without it, in turns.

``python benchmarks/recorder.py [TURNS]``: a loopback of the simulated finger, two microphones as Opus; about 80 s.
"""

import os
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np

from page import tactophone
from tactophone.bridges import BridgeProcess, McapLog
from tactophone.telemetry import Watcher

SECONDS = 6.0
TICKS = os.sysconf("SC_CLK_TCK")
NAME = "bench-recorder"


def processor_time(pid: int) -> float:
    """Seconds that a process has used, of the kernel's clock."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def latencies(seconds: float) -> list[float]:
    """End-to-end latency in ms, twice a second."""
    found, until = [], time.monotonic() + seconds
    while time.monotonic() < until:
        time.sleep(0.5)
        found.append(1000 * Watcher(NAME).gauge("latency_total"))
    return found


def main() -> None:
    turns = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    without, within, used = [], [], []
    arguments = ("loopback", "--source", "finger", "--actuator", "none", "--dashboard", "--name", NAME)
    with tempfile.TemporaryDirectory() as folder, tactophone(*arguments):
        time.sleep(8)
        for turn in range(turns):
            without += latencies(SECONDS)
            with BridgeProcess(partial(McapLog, NAME, Path(folder) / f"{turn}.mcap")) as log:
                time.sleep(1)  # not the start of the process, which costs a second of its own, once
                begun = processor_time(log.pid)
                within += latencies(SECONDS)
                used.append((processor_time(log.pid) - begun) / SECONDS)
    print(f"recorder: {100 * np.median(used):.1f} % of a core (median of {turns}; greatest {100 * max(used):.1f} %)")
    for name, found in (("without", without), ("with", within)):
        p50, p95 = np.percentile(found, [50, 95])
        print(f"latency {name:7} p50 {p50:.2f} ms, p95 {p95:.2f} ms, {len(found)} readings")


if __name__ == "__main__":
    main()
