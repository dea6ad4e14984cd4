"""Calls between two networks whose routers this program makes: how long until one feels, and what a call costs.

As root, with Debian's iproute2, nftables and coturn:

- `python benchmarks/call.py` makes 20 calls, `--relayed` through routers that allow no direct way. A call counts from
  the start of `tactophone answer`, with everything that a person waits for: imports, mailbox, way, models, handshake.
  The operator's side is armed as soon as it is there.
- `--compare 5` measures five rounds of `send` and `receive` without a router, a direct call and a relayed one, in turn:
  the delay from microphone to actuator, and the processor time of both machines.
- `--stones` feels the demo's two stones with README's two commands, from two fresh clones of this repository behind
  routers that allow no direct way; then `tactophone demo` plays them over a local network, for comparison.
"""

import argparse
import json
import os
import re
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import soundfile

sys.path.insert(0, str(Path(__file__).parents[1]))

from tests.net.call.networks import SOURCES, Nat, Networks

from tactophone.app.vibration_wav import score_run
from tactophone.lab.dataset.read import ground_truth
from tactophone.lab.simulation.demonstration import write_demonstration
from tactophone.live.audio.files import FileSource
from tactophone.live.runtime.latency import operator_stages
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.identity import Identity, Peers

STAGES = ("mailbox", "exchange", "way", "link", "prediction", "vibration")
"""Moments of a call at the answering end, the last two at the caller's finger."""

LINES = {"mailbox": "waiting for", "exchange": " calls, the ", "way": "connected "}
TICK = os.sysconf("SC_CLK_TCK")


@dataclass
class Run:
    """A session between the two homes."""

    operator: Watcher
    robot: Watcher
    times: dict[str, float]
    relayed: bool


class Ends:
    """Two machines with their keys, in networks of one kind."""

    def __init__(self, networks: Networks, folder: Path, source: str) -> None:
        self._networks, self._folder, self._source = networks, folder, source
        self._number = 0
        if not folder.exists():
            ends = {place: Identity.create(place) for place in ("ope", "rob")}
            for place, other in (("ope", "rob"), ("rob", "ope")):
                ends[place].save(folder / place)
                Peers({ends[other].fingerprint: other}).save(folder / place)

    @contextmanager
    def connected(self, *, call: bool = True) -> Iterator[Run]:
        """Connect by call and answer, or by receive and send, and end it after use."""
        self._number += 1
        name = f"bench-{os.getpid()}-{self._folder.name}-{self._number}"
        source = ("--source", self._source, "--name", f"{name}-robot")
        operator = self._start("ope", "call" if call else "receive", "--actuator", "none", "--name", name)
        said = ""
        if call:
            code = _read(operator, "answer (\\S+)")
            time.sleep(3.0)  # a person says the code
        else:
            _watcher(name)
        began = time.monotonic()
        verb = ("answer", code, "--yes") if call else ("send", "--peer", "10.2.0.2")
        robot = self._start("rob", *verb, *source)
        times = {}
        if call:
            for stage, pattern in LINES.items():
                said = _read(robot, f"(.*{pattern}.*)")
                times[stage] = time.monotonic() - began
        try:
            watcher = _watcher(name)
            for stage in _reached(watcher, time.monotonic() + 60.0):
                times[stage] = time.monotonic() - began
            other = _watcher(f"{name}-robot")
            for process in (operator, robot):  # or their pipes would fill
                threading.Thread(target=process.stderr.read, daemon=True).start()  # type: ignore[union-attr]
            yield Run(watcher, other, times, "relay" in said)
        finally:
            for process in (operator, robot):
                process.terminate()
            for process in (operator, robot):
                process.wait(20)

    def processor_time(self) -> float:
        """Return the seconds that all processes in both homes have used."""
        total = 0
        for place in ("ope", "rob"):
            for pid in self._networks.pids(place):
                fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
                total += int(fields[11]) + int(fields[12])
        return total / TICK

    def _start(self, place: str, *words: str) -> "subprocess.Popen[str]":
        calls = self._networks.settings() if words[0] in ("call", "answer") else []
        command = [sys.executable, "-m", "tactophone", *words, *calls]
        command += ["--set", f"link.identity={self._folder / place}"]
        return self._networks.start(place, *command, stderr=subprocess.PIPE)


def _read(process: "subprocess.Popen[str]", pattern: str) -> str:
    assert process.stderr is not None
    said = []
    for line in process.stderr:
        said.append(line)
        if found := re.search(pattern, line):
            return found[1]
    raise SystemExit(f"no {pattern} in:\n{''.join(said)}")


def _watcher(name: str) -> Watcher:
    while (watcher := Watcher.find(name)) is None:
        time.sleep(0.001)
    return watcher


def _reached(watcher: Watcher, until: float) -> Iterator[str]:
    """Arm the operator's side, and yield each stage when it is reached."""
    watcher.ask("arm")
    reached = {
        "link": lambda: watcher.totals()[0]["handshakes"] > 0,
        "prediction": lambda: watcher.totals()[0]["predictions"] > 0,
        "vibration": lambda: watcher.gauge("output_amplitude") > 0.0,
    }
    for stage, there in reached.items():
        while not there():
            if time.monotonic() > until:
                raise SystemExit(f"no {stage}: {watcher.snapshot().state}")
            time.sleep(0.001)
        yield stage


def calls(folder: Path, source: str, number: int, listen: float, kind: Nat) -> None:
    every = []
    with Networks(kind, kind) as networks:
        ends = Ends(networks, folder / kind, source)
        for _ in range(number):
            with ends.connected() as run:
                time.sleep(listen)
                counters, _ = run.operator.totals()
                trip = run.robot.gauge("round_trip")
            every.append(run.times)
            print(
                json.dumps({stage: round(at, 3) for stage, at in run.times.items()}),
                "relayed" * run.relayed,
                f"lost {counters['packets_lost']} of {counters['packets_received']}, {1000 * trip:.1f} ms",
                flush=True,
            )
    print(f"{'s after the code is typed':26} {'p50':>6} {'p90':>6}")
    for stage in STAGES:
        values = [each[stage] for each in every]
        print(f"{stage:26} {statistics.median(values):6.2f} {np.quantile(values, 0.9):6.2f}")


def compare(folder: Path, source: str, rounds: int, listen: float) -> None:
    kinds: dict[str, Nat] = {"no router": "open", "direct call": "keeps", "relayed call": "changes"}
    found: dict[str, list[list[float]]] = {kind: [] for kind in kinds}
    for _ in range(rounds):
        for kind, nat in kinds.items():
            with Networks(nat, nat) as networks:
                ends = Ends(networks, folder / nat, source)
                with ends.connected(call=nat != "open") as run:
                    time.sleep(2.0)
                    used = ends.processor_time()
                    time.sleep(listen)
                    used = ends.processor_time() - used
                    delay = operator_stages(run.operator, run.robot, run.operator.gauge("device_latency"))["total"]
                    trip = run.robot.gauge("round_trip")
            found[kind].append([1000 * delay, 1000 * trip, 100 * used / listen])
            print(kind, *(f"{value:.2f}" for value in found[kind][-1]), flush=True)
    print(f"{'':14} {'microphone to actuator, ms':>28} {'there and back, ms':>20} {'processor time, %':>20}")
    for kind, rows in found.items():
        delay, trip, used = (statistics.median(column) for column in zip(*rows, strict=True))
        print(f"{kind:14} {delay:28.2f} {trip:20.2f} {used:20.1f}")


def stones(folder: Path) -> None:
    (sound,) = write_demonstration(folder, seed=0)
    with FileSource(sound) as source:
        truth = ground_truth(source.path, duration=source.duration)
    with Networks("changes", "changes") as networks:

        def start(place: str, *words: str) -> "subprocess.Popen[str]":
            clone = folder / place
            subprocess.run(["git", "clone", "-q", str(SOURCES), str(clone)], check=True)
            command = [sys.executable, "-m", "tactophone", *words, *networks.settings()]
            environment = {"HOME": str(clone), "PYTHONPATH": str(clone / "src")}
            return networks.start(place, *command, stderr=subprocess.PIPE, env={**os.environ, **environment})

        name, felt = f"bench-{os.getpid()}-stones", folder / "felt.csv"
        operator = start("ope", "call", "--actuator", "none", "--record", str(felt), "--name", name)
        code = _read(operator, "answer (\\S+)")
        robot = start("rob", "answer", code, "--yes", "--source", f"file:{sound}", "--set", "capture.loop=false",
                      "--name", f"{name}-robot")  # fmt: skip
        print(_read(robot, "(.*connected .*)"))
        said = operator.communicate(timeout=120)[1].splitlines(), robot.communicate(timeout=20)[1].splitlines()
        print(said[0][-1], operator.returncode, robot.returncode)
    print("called:", asdict(score_run(read_timeline(felt), truth)))
    subprocess.run(
        [sys.executable, "-m", "tactophone", "demo", "--out", str(folder / "lan"), "--network", "lan"], check=True
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=20)
    parser.add_argument("--relayed", action="store_true", help="through routers that allow no direct way")
    parser.add_argument("--listen", type=float, default=1.0, help="how long each call lasts, in s")
    parser.add_argument("--source", default="", help="of the robot (default: a recording of noise)")
    parser.add_argument("--compare", type=int, metavar="ROUNDS", default=0)
    parser.add_argument("--stones", action="store_true")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder, source = Path(name), args.source
        if not source:
            soundfile.write(folder / "noise.wav", np.random.default_rng(1).normal(0.0, 0.1, (960_000, 2)), 48_000)
            source = f"file:{folder / 'noise.wav'}"
        if args.stones:
            stones(folder)
        elif args.compare:
            compare(folder / "keys", source, args.compare, max(args.listen, 10.0))
        else:
            calls(folder / "keys", source, args.calls, args.listen, "changes" if args.relayed else "keeps")


if __name__ == "__main__":
    main()
