"""Does the demonstration give the same result every time? ``python benchmarks/demo_series.py``, ten minutes.

Runs ``tactophone demo`` twenty times in a row, with seed 0: the same sound over the same simulated line. Each run is
compared with the median of three over ``lan``; the goal is that none lies more than 3 points from it. ``--empty-home``
gives each run a new home folder, so that nothing is compiled or cached; ``--busy 2`` runs two busy processes beside it;
``--stop robot:5:0.7`` stops a side 5 s after the link is connected, for 0.7 s.
"""

import argparse
import json
import multiprocessing
import os
import signal
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tactophone.errors import TactophoneError
from tactophone.telemetry import Watcher

MARGIN = 0.03
"""Goal: the greatest difference from the reference in the share of right predictions, on either stone."""

LONGEST = 300.0
"""Seconds after which a run counts as hanging; the first one in an empty home compiles for a minute."""

SHARES = ("smooth_right", "rough_right")
COUNTS = ("packets_received", "packets_lost", "packets_skipped", "handshakes", "stale_fades", "process_restarts")

Stop = tuple[str, float, float]
"""Side, seconds after the first packets at which it is stopped, and for how many."""


def run(network: str, *, empty_home: bool, stops: Sequence[Stop] = ()) -> dict[str, Any]:
    """Run the demonstration once; return its scores and counts."""
    name = f"series-{os.getpid()}"
    with TemporaryDirectory(prefix="tactophone-series-") as folder:
        command = [sys.executable, "-m", "tactophone", "demo", "--json", "--network", network, "--out", f"{folder}/out"]
        home = {"HOME": folder, "XDG_CACHE_HOME": f"{folder}/.cache", "NUMBA_CACHE_DIR": f"{folder}/numba"}
        environment = os.environ | (home if empty_home else {})
        begun = time.monotonic()
        with subprocess.Popen(
            [*command, "--set", f"process.name={name}"],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=Path(folder, "log").open("wb"),
        ) as demo:
            try:
                if stops:
                    stop_sides(name, stops)
                output = demo.communicate(timeout=LONGEST)[0]
            except BaseException:
                demo.terminate()
                raise
        if demo.returncode:
            raise TactophoneError(f"exit {demo.returncode}: {Path(folder, 'log').read_text()[-500:]}")
    result = json.loads(output)
    return {key: result[key] for key in SHARES} | {
        "false_bumps": result["false_bumps"],
        **{key: result["counters"][key] for key in COUNTS},
        "seconds": time.monotonic() - begun,
    }


def stop_sides(name: str, stops: Sequence[Stop]) -> None:
    """Stop each side in turn, counted from the moment at which sound arrives."""
    while True:
        with suppress(TactophoneError):
            if Watcher(name).snapshot().counters["packets_received"] > 0:
                break
        time.sleep(0.02)
    begun = time.monotonic()
    for side, at, duration in sorted(stops, key=lambda stop: stop[1]):
        time.sleep(max(0.0, begun + at - time.monotonic()))
        pid = Watcher(name if side == "operator" else f"{name}-robot").pid
        os.kill(pid, signal.SIGSTOP)
        time.sleep(duration)
        os.kill(pid, signal.SIGCONT)


@contextmanager
def busy_processes(count: int) -> Iterator[None]:
    """Keep so many processes computing."""
    processes = [multiprocessing.Process(target=_compute, args=(os.getpid(),), daemon=True) for _ in range(count)]
    for process in processes:
        process.start()
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.join()


def _compute(parent: int) -> None:
    while os.getppid() == parent:
        sum(range(100_000))


def line(number: object, network: str, found: dict[str, Any], verdict: str) -> str:
    counts = " | ".join(str(found[key]) for key in ("false_bumps", *COUNTS))
    shares = " | ".join(f"{100 * found[key]:.1f} %" for key in SHARES)
    rest = f"{found['seconds']:.0f} | {os.getloadavg()[0]:.1f} | {verdict}"
    return f"| {number} | {network} | {shares} | {counts} | {rest} |"


def main() -> int:
    """Print one line for each run; exit 1 where one missed the goal."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--network", default="wifi-busy")
    parser.add_argument("--empty-home", action="store_true")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="busy processes beside the runs")
    parser.add_argument(
        "--reference", metavar="SMOOTH,ROUGH", help="percent; without it, the median of three runs over lan is taken"
    )
    parser.add_argument("--stop", action="append", default=[], metavar="SIDE:AT:SECONDS", help="may be repeated")
    args = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that the demonstration ends with this process
    stops = [(side, float(at), float(took)) for side, at, took in (stop.split(":") for stop in args.stop)]
    columns = ("run", "network", "smooth", "rough", "false_bumps", *COUNTS, "s", "load", "")
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)
    if args.reference:
        reference = [float(share) / 100 for share in args.reference.split(",")]
    else:
        quiet = [run("lan", empty_home=False) for _ in range(3)]
        for each in quiet:
            print(line("reference", "lan", each, ""), flush=True)
        reference = [statistics.median(each[share] for each in quiet) for share in SHARES]
    missed = 0
    with busy_processes(args.busy):
        for number in range(1, args.runs + 1):
            found = run(args.network, empty_home=args.empty_home, stops=stops)
            worst = max(abs(found[share] - right) for share, right in zip(SHARES, reference, strict=True))
            missed += worst > MARGIN
            print(line(number, args.network, found, "met" if worst <= MARGIN else "MISSED"), flush=True)
    goal = f"{100 * MARGIN:g} points of {reference[0]:.1%} and {reference[1]:.1%}"
    print(f"\n{args.runs - missed} of {args.runs} within {goal}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
