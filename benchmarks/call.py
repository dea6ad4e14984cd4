"""Calls between two networks whose routers this program makes: how long from a code to the first prediction.

`python benchmarks/call.py --calls 20` (direct) and `--relayed`; as root, with Debian's iproute2, nftables and coturn.
The answering robot is the simulated finger. A call counts from the start of `tactophone answer`, with everything that a
person waits for: imports, mailbox, way, models, handshake.
"""

import argparse
import json
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.call.networks import Networks

from tactophone.telemetry.watcher import Watcher


def tactophone(networks: Networks, place: str, *words: str) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "tactophone", *words, *networks.settings()]
    return networks.start(place, *command, stderr=subprocess.PIPE)


def read_until(process: "subprocess.Popen[str]", pattern: str) -> str:
    assert process.stderr is not None
    for line in process.stderr:
        if found := re.search(pattern, line):
            return found[1]
    raise SystemExit(f"no {pattern}")


def one_call(networks: Networks, folder: Path, number: int, listen: float) -> dict[str, float]:
    name = f"bench-call-{number}"
    options = ("--set", f"link.identity={folder / 'ope'}", "--actuator", "none", "--name", name)
    operator = tactophone(networks, "ope", "call", *options)
    code = read_until(operator, "answer (\\S+)")
    began = time.monotonic()
    robot = tactophone(
        networks, "rob", "answer", code, "--yes", "--source", "finger", "--name", f"{name}-robot",
        "--set", f"link.identity={folder / 'rob'}",
    )  # fmt: skip
    way = read_until(robot, "connected (over the relay|directly)")
    found = time.monotonic() - began
    watcher = None
    while time.monotonic() - began < 60:
        watcher = watcher or Watcher.find(name)
        if watcher and watcher.snapshot().counters["predictions"]:
            break
        time.sleep(0.01)
    felt = time.monotonic() - began
    time.sleep(listen)
    assert watcher is not None
    last = watcher.snapshot()
    for process in (operator, robot):
        process.terminate()
        process.wait(10)
    counters = last.counters
    return {
        "relayed": float(way == "over the relay"), "found": found, "felt": felt,
        "received": counters["packets_received"], "lost": counters["packets_lost"], "losses": counters["link_losses"],
        "round_trip_ms": 1000 * float(last.gauges["round_trip"]),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=20)
    parser.add_argument("--relayed", action="store_true", help="through routers that allow no direct way")
    parser.add_argument("--listen", type=float, default=1.0, help="how long each call lasts, in s")
    args = parser.parse_args()
    kind = "changes" if args.relayed else "keeps"
    with tempfile.TemporaryDirectory() as folder, Networks(kind, kind) as networks:
        calls = [one_call(networks, Path(folder), number, args.listen) for number in range(args.calls)]
    for each in calls:
        print(json.dumps({key: round(value, 3) for key, value in each.items()}))
    for key in ("found", "felt"):
        values = [each[key] for each in calls]
        print(f"{key}: p50 {statistics.median(values):.2f} s, p90 {np.quantile(values, 0.9):.2f} s")
    print(f"relayed: {sum(each['relayed'] for each in calls):.0f} of {len(calls)}; lost packets", end=" ")
    print(f"{sum(each['lost'] for each in calls):.0f} of {sum(each['received'] for each in calls):.0f}")


if __name__ == "__main__":
    main()
