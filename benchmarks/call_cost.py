"""What a call costs beside `send` and `receive`: delay and processor time, through
routers that this program makes, of one or several versions in turn.

    python benchmarks/call_cost.py
    python benchmarks/call_cost.py --tree now --tree before=../before/src --rounds 3

As root, with Debian's iproute2, nftables and coturn. Each round runs every version
through every network: ``open`` without routers (`send` and `receive`), ``keeps`` with
routers that keep a port (a direct call), ``changes`` with routers that take another
port for each destination (a call over a relay). The real verbs run; the robot plays a
recording of strokes, with the check of the microphones on. Rounds take turns, because
other work on the machine disturbs neighbours alike; compare versions within a round.

- ``delay``: from microphone to actuator as the operator's run states it, median in ms.
- ``processor``: of all processes of each end, in percent of a core; the process of the
  call, which passes the datagrams on, is told apart.
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
from pathlib import Path
from typing import NamedTuple

import psutil

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "packages" / "tactophone")]

from tactophone.net.link.identity import Identity, Peers  # noqa: E402
from tactophone_lab.simulation.demonstration import write_demonstration  # noqa: E402
from tests.net.call.networks import PYTHONPATH, Nat, Networks  # noqa: E402
from trees import add_trees, in_turn, trees_of  # noqa: E402

KINDS: tuple[Nat, ...] = ("open", "keeps", "changes")

PLACES = ("rob", "ope")

SETTLE = 4.0
"""Seconds before the measurement, in which estimators converge."""

CONNECT_TIMEOUT = 60.0

PROBE = """
import json, sys, time
from tactophone.live.runtime.latency import operator_stages
from tactophone.live.telemetry.watcher import Watcher
operator, robot = map(Watcher.find, sys.argv[1:])
stages = operator_stages(operator, robot, operator.gauge("device_latency"))
counters, _ = operator.totals()
print(json.dumps(dict(stages, lost=counters["packets_lost"])))
"""
"""Reads a run's own figures with the code of its version, as telemetry is laid out
anew now and then."""

WAIT = """
import sys, time
from tactophone.live.telemetry.watcher import Watcher
while (watcher := Watcher.find(sys.argv[1])) is None:
    time.sleep(0.05)
watcher.ask("arm")
while not watcher.totals()[0]["predictions"]:
    time.sleep(0.05)
"""
"""Arms an operator and waits for its first prediction."""


class Row(NamedTuple):
    """One run of one version through one network."""

    delay_ms: float
    network_ms: float
    robot: float
    operator: float
    passing: float
    lost: int

    @property
    def processor(self) -> float:
        return self.robot + self.operator


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add_trees(parser)
    parser.add_argument("--rounds", type=int, default=2, help="default: %(default)s")
    parser.add_argument(
        "--seconds", type=float, default=15.0, help="of each run (default: %(default)s)"
    )
    parser.add_argument(
        "--kinds", default=",".join(KINDS), help="networks (default: %(default)s)"
    )
    args = parser.parse_args()
    trees = trees_of(args)
    kinds = [kind for kind in KINDS if kind in args.kinds.split(",")]
    found: dict[tuple[Nat, str], list[Row]] = {}
    os.environ["PYTHONPATH"] = PYTHONPATH  # for the mailbox, which the tests bring
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (sound,) = write_demonstration(folder, seed=0)
        for number in range(args.rounds):
            for kind in kinds:
                for tree in in_turn(trees, number):
                    row = measured(kind, trees[tree], folder, sound, args.seconds)
                    found.setdefault((kind, tree), []).append(row)
                    load = os.getloadavg()[0]
                    print(number, kind, tree, row, f"load {load:.1f}", file=sys.stderr)
    print_table(found)


def print_table(found: dict[tuple[Nat, str], list[Row]]) -> None:
    print(
        "| network | version | delay, ms | of it network, ms | processor time, both "
        "ends | robot, % | operator, % | passing datagrams on, % | packets lost |"
    )
    print("|---|---|--:|--:|--:|--:|--:|--:|--:|")
    for (kind, tree), rows in found.items():
        median = Row(*(statistics.median(column) for column in zip(*rows, strict=True)))
        every = ", ".join(f"{row.processor:.1f}" for row in rows)
        print(
            f"| {kind} | {tree} | {median.delay_ms:.2f} | {median.network_ms:.2f} "
            f"| {median.processor:.1f} % ({every}) | {median.robot:.1f} "
            f"| {median.operator:.1f} | {median.passing:.1f} | {median.lost:g} |"
        )


def measured(kind: Nat, paths: str, folder: Path, sound: Path, seconds: float) -> Row:
    with Networks(kind, kind) as networks:
        ends = Ends(networks, paths, folder / kind, f"file:{sound}")
        with ends.connected(call=kind != "open"):
            time.sleep(SETTLE)
            before = ends.processor_times()
            time.sleep(seconds)
            after = ends.processor_times()
            stages = ends.stages()
    used = {key: 100 * (after[key] - before.get(key, 0.0)) / seconds for key in after}
    return Row(
        1_000 * stages["total"],
        1_000 * stages["network"],
        sum(used[key] for key in used if key[0] == "rob"),
        sum(used[key] for key in used if key[0] == "ope"),
        sum(used[key] for key in used if key[1] == "call"),
        int(stages["lost"]),
    )


class Ends:
    """Two machines of one version with their keys, in networks of one kind."""

    def __init__(
        self, networks: Networks, paths: str, folder: Path, source: str
    ) -> None:
        self._networks, self._folder, self._source = networks, folder, source
        self._environment = {**os.environ, "PYTHONPATH": paths}
        self._name = f"bench-{os.getpid()}"
        if folder.exists():
            return
        ends = {place: Identity.create(place) for place in PLACES}
        for place, other in (PLACES, PLACES[::-1]):
            ends[place].save(folder / place)
            Peers({ends[other].fingerprint: other}).save(folder / place)

    @contextmanager
    def connected(self, *, call: bool) -> Iterator[None]:
        """Connect by call and answer, or by receive and send, and end it after use."""
        verb = "call" if call else "receive"
        operator = self._start("ope", verb, "--actuator", "none", "--name", self._name)
        words: tuple[str, ...] = ("send", "--peer", "10.2.0.2")
        if call:
            words = ("answer", _read(operator, r"answer (\S+)"), "--yes")
        robot = self._start(
            "rob", *words, "--source", self._source, "--name", f"{self._name}-robot"
        )
        try:
            for process in (operator, robot):
                _drain(process)
            self._run(WAIT, self._name)
            yield
        finally:
            for process in (operator, robot):
                process.terminate()
            for process in (operator, robot):
                process.wait(20)

    def stages(self) -> dict[str, float]:
        """Return the delays of each stage, in s, and the packets lost."""
        said = self._run(PROBE, self._name, f"{self._name}-robot")
        return dict(json.loads(said))

    def processor_times(self) -> dict[tuple[str, str, int], float]:
        """Return the seconds that each process of an end has used, by place, kind and
        number."""
        found = {}
        for place in PLACES:
            for pid in self._networks.pids(place):
                process = psutil.Process(pid)
                kind = "call" if _passes_on(process) else ""
                found[place, kind, pid] = sum(process.cpu_times()[:2])
        return found

    def _run(self, program: str, *words: str) -> str:
        return subprocess.run(
            [sys.executable, "-c", program, *words],
            env=self._environment,
            check=True,
            stdout=subprocess.PIPE,
            text=True,
            timeout=CONNECT_TIMEOUT,
        ).stdout

    def _start(self, place: str, *words: str) -> "subprocess.Popen[str]":
        calls = self._networks.settings() if words[0] in ("call", "answer") else []
        command = [sys.executable, "-m", "tactophone", *words, *calls]
        command += ["--set", f"link.identity={self._folder / place}"]
        return self._networks.start(
            place, *command, stderr=subprocess.PIPE, env=self._environment
        )


def _passes_on(process: psutil.Process) -> bool:
    """Whether this is the process of a call, which alone speaks with a mailbox: under
    keys of libsodium."""
    return any("_sodium" in part.path for part in process.memory_maps())


def _read(process: "subprocess.Popen[str]", pattern: str) -> str:
    assert process.stderr is not None
    said = []
    for line in process.stderr:
        said.append(line)
        if found := re.search(pattern, line):
            return found[1]
    raise SystemExit(f"no {pattern} in:\n{''.join(said)}")


def _drain(process: "subprocess.Popen[str]") -> None:
    """Read what a process says from now on, or its pipe would fill."""
    assert process.stderr is not None
    threading.Thread(target=process.stderr.read, daemon=True).start()


if __name__ == "__main__":
    main()
