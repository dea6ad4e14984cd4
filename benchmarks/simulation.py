"""Speed of the simulated finger: offline, live, and at start.

python benchmarks/simulation.py
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.motion import five_stones, single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES, shuffled

OFFLINE = 30.0
"""Seconds of sound rendered at once, as for a data set."""

LIVE = 20.0
"""Seconds of sound rendered block by block, as live."""

BLOCK = 128

_START = (
    "from tactophone_lab.simulation.demonstration import demonstration; "
    "demonstration().render(128)"
)


def offline(name: str) -> float:
    """Speed of rendering a take of an object, as a multiple of real time on one core
    (processor time)."""
    scene = single(find(name))
    moves = take_moves(
        TAKES[1], scene.placed[0], duration=OFFLINE, rng=np.random.default_rng(1)
    )
    finger = SimulatedFinger(scene, moves, place=scene.placed[0].centre)
    finger.render(480)
    began = time.process_time()
    finger.render(round(OFFLINE * finger.sample_rate))
    return OFFLINE / (time.process_time() - began)


def live() -> tuple[float, float]:
    """Share of a core for five stones in blocks of 128, and p99 of the time for a block
    in ms."""
    finger = SimulatedFinger(five_stones(shuffled(1)), place=(0.04, 0.035))
    finger.render(BLOCK)
    times, began = [], time.process_time()
    for k in range(round(LIVE * finger.sample_rate / BLOCK)):
        finger.move(0.04 + 0.03 * np.sin(k / 60), 0.035, 1.2)
        start = time.perf_counter()
        finger.render(BLOCK)
        times.append(time.perf_counter() - start)
    return (time.process_time() - began) / LIVE, 1000 * float(np.quantile(times, 0.99))


def start(cache: str) -> float:
    """Seconds until a new process has rendered its first block."""
    began = time.perf_counter()
    subprocess.run(
        [sys.executable, "-c", _START],
        check=True,
        env={**os.environ, "NUMBA_CACHE_DIR": cache},
    )
    return time.perf_counter() - began


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    print("| quantity | measured |\n|---|--:|")
    for name in ("lava stone", "screen", "smooth competition stone"):
        print(f"| offline, one core: {name} | {offline(name):.0f} x real time |")
    share, slowest = live()
    print(f"| live, five stones, blocks of {BLOCK} | {share:.1%} of a core |")
    print(
        f"| ... time for a block of {1000 * BLOCK / 48_000:.2f} ms, p99 | "
        f"{slowest:.2f} ms |"
    )
    with tempfile.TemporaryDirectory() as cache:
        print(
            f"| first block of a new process, nothing compiled | {start(cache):.1f} s |"
        )
        print(f"| ... any time after | {start(cache):.1f} s |")


if __name__ == "__main__":
    main()
