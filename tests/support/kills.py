"""Kills a random process of a short run at a random moment, stops all of them, or sets
their clock.

Its log replays, nothing stale vibrates, and no process or file is left. Each run is
started by the command line and found again by a mark in its environment, because a
process whose parent was killed belongs to nobody.
"""

import contextlib
import itertools
import os
import random
import secrets
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import psutil
import pytest
import soundfile

from tactophone.app.replay import Replay
from tactophone.core.errors import DatasetError, TactophoneError
from tactophone.core.settings import Settings
from tactophone.live.log.mcap import read_log
from tactophone.live.runtime.pairing import pair_on_one_machine
from tactophone.live.telemetry.memory import folder as memory_folder
from tactophone.live.telemetry.records import EventBatch
from tactophone.live.telemetry.watcher import Watcher

MARK = "TACTOPHONE_KILLED_RUN"

SOUND = 5.0
"""Seconds of sound of a demonstration, so that some end by themselves."""

LONGEST_WAIT = 8.0
"""Seconds after the start within which the kill comes: a start takes a few of them."""

ORPHAN = 5.0
"""Seconds after the end of a run in which its last process has to end."""

TACTOPHONE = (sys.executable, "-m", "tactophone")


@dataclass
class KilledRun:
    """A run while it lasts.

    ``commands`` belong together, such as send and receive.
    """

    name: str
    commands: Sequence[Sequence[str]]
    logs: Sequence[Path]
    environment: Mapping[str, str] = field(default_factory=dict)
    """More variables of its processes."""
    output: Path = Path(os.devnull)
    """Where they print."""
    started: "list[subprocess.Popen[bytes]]" = field(default_factory=list)

    def __enter__(self) -> "KilledRun":
        environment = os.environ | {MARK: self.name} | dict(self.environment)
        with self.output.open("ab") as output:
            for command in self.commands:
                printed = {"stdout": output, "stderr": subprocess.STDOUT}
                self.started.append(
                    subprocess.Popen(
                        command, env=environment, start_new_session=True, **printed
                    )
                )
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes():
            with contextlib.suppress(psutil.Error):
                process.kill()
        for each in self.started:
            each.wait()

    def processes(self) -> list[psutil.Process]:
        """Return every living process of the run, orphans included, except
        multiprocessing's own."""
        living = []
        for process in psutil.process_iter():
            with contextlib.suppress(psutil.Error):
                marked = (
                    process.environ().get(MARK) == self.name
                    and process.status() != psutil.STATUS_ZOMBIE
                )
                if marked and not any(
                    "resource_tracker" in word for word in process.cmdline()
                ):
                    living.append(process)
        return living

    def await_predictions(self, count: int, *, timeout: float = 60.0) -> None:
        """Wait for that number of predictions, and for the log to begin."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            time.sleep(0.05)
            with contextlib.suppress(TactophoneError):
                begun = all(
                    log.exists() and log.stat().st_size > 30_000 for log in self.logs
                )
                if begun and Watcher(self.name).totals()[0]["predictions"] >= count:
                    return
        raise TimeoutError(
            f"{self.name} made fewer than {count} predictions in {timeout:g} s"
        )

    def terminate(self) -> None:
        for each in self.started:
            each.poll()
            each.terminate()

    def leftovers(self) -> list[str]:
        """Wait up to `ORPHAN` s for the end of all processes; return those that live,
        and files in shared memory."""
        end = time.monotonic() + ORPHAN
        while (alive := self.processes()) and time.monotonic() < end:
            time.sleep(0.1)
        left = []
        for process in alive:
            with contextlib.suppress(psutil.Error):
                left.append(f"process {' '.join(process.cmdline())[-60:]}")
        return left + [
            path.name for path in memory_folder().iterdir() if self.name in path.name
        ]


def demonstration(folder: Path, name: str) -> KilledRun:
    log, command = (
        folder / "run.mcap",
        [*TACTOPHONE, "demo", "--out", str(folder / "demo"), "--set"],
    )
    command += [
        f"process.name={name}",
        "--recording",
        str(_noise(folder, SOUND)),
        "--record",
        str(log),
    ]
    return KilledRun(name, [command], [log])


def loopback(folder: Path, name: str) -> KilledRun:
    log, command = (
        folder / "run.mcap",
        [*TACTOPHONE, "loopback", "--actuator", "none", "--name", name],
    )
    return KilledRun(
        name,
        [[*command, "--source", f"file:{_noise(folder, 20.0)}", "--record", str(log)]],
        [log],
    )


def both_ends(folder: Path, name: str) -> KilledRun:
    """`send` and `receive`, each with a log."""
    sound = _noise(folder, 20.0)
    robot, operator = pair_on_one_machine(Settings(), folder, name=name)
    commands, logs = [], [folder / "receive.mcap", folder / "send.mcap"]
    for verb, side, more in (
        ("receive", operator, ["--actuator", "none"]),
        ("send", robot, ["--source", f"file:{sound}", "--set", "link.peer=127.0.0.1"]),
    ):
        link = [
            "--set",
            f"link.identity={side.link.identity}",
            "--set",
            f"link.port={side.link.port}",
        ]
        record = ["--record", str(folder / f"{verb}.mcap")]
        commands.append(
            [*TACTOPHONE, verb, "--name", side.process.name, *link, *more, *record]
        )
    return KilledRun(name, commands, logs)


def _noise(folder: Path, duration: float) -> Path:
    noise = np.random.default_rng(0).normal(0, 0.05, (round(48_000 * duration), 2))
    soundfile.write(folder / "noise.wav", noise, 48_000)
    return folder / "noise.wav"


@dataclass
class Finding:
    """What a killed run left: in ``wrong`` what should not be."""

    victim: str = ""
    empty: int = 0
    """Logs that hold no beginning of a run yet."""
    equal: int = 0
    behind: float = 0.0
    """Seconds of the end that a log lacks, where its recorder or everything was
    killed."""
    wrong: list[str] = field(default_factory=list)


def kill(
    folder: Path,
    kind: Callable[[Path, str], KilledRun],
    dice: random.Random,
    *,
    running: bool = False,
    victim: str = "",
) -> Finding:
    """Kill a process of a run, or ``everything``; ``running``: only once its log has
    begun."""
    finding = Finding()
    with kind(folder, f"kill-{secrets.token_hex(4)}") as run:
        if running:
            run.await_predictions(30)
        time.sleep(dice.uniform(0.0, 1.0 if running else LONGEST_WAIT))
        processes = run.processes()
        roles = [_role(process, run) for process in processes]
        finding.victim = victim or (
            dice.choice(roles) if roles else "nothing: it had ended"
        )
        for process, role in zip(processes, roles, strict=True):
            if victim == "everything" or role == finding.victim:
                with contextlib.suppress(psutil.Error):
                    process.kill()
        killed = time.monotonic()
        time.sleep(dice.uniform(0.0, 3.0))
        run.terminate()
        left = run.leftovers()
        # When all of a run's processes are dead, the next run removes its memory.
        finding.wrong += left if victim != "everything" else []
    for log in run.logs:
        check_log(log, finding, killed)
    return finding


def _role(process: psutil.Process, run: KilledRun) -> str:
    if process.pid in (each.pid for each in run.started):
        return f"command {[each.pid for each in run.started].index(process.pid) + 1}"
    for which, name in (("operator", run.name), ("robot", f"{run.name}-robot")):
        with contextlib.suppress(TactophoneError):
            if Watcher(name).pid == process.pid:
                return which
    return f"another {process.pid}"  # a recorder, or what starts


def check_log(log: Path, finding: Finding, killed: float) -> None:
    """Replay a log, and note in the finding what it holds; ``killed``: when that came
    to its run."""
    if not log.exists():
        finding.empty += 1
        return
    last, entries = 0.0, []
    try:
        for entry in read_log(log):
            entries.append(entry)
            last = entry.time if isinstance(entry, EventBatch) else last
        replay = Replay(iter(entries))
        for _ in replay.steps():
            pass
    except DatasetError as error:
        if "holds no run" in str(error) or log.stat().st_size == 0:
            finding.empty += 1
        else:
            finding.wrong.append(str(error))
        return
    finding.equal += replay.comparison.equal
    if replay.comparison.different:
        finding.wrong.append(
            f"{log.name}: {replay.comparison.different} predictions differ from "
            f"{finding.victim}"
        )
    if not replay.complete and last:
        finding.behind = max(finding.behind, killed - last)
        if finding.victim.startswith(("robot", "operator", "command")):
            finding.wrong.append(
                f"{log.name} has no end, though {finding.victim} was killed and not "
                "its recorder"
            )


DAY = 86_400

FADE = 46
"""Periods of 128 samples in 0.12 s, after which only what is fresh may vibrate."""

SHIM = r"""
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/time.h>
#include <time.h>
static volatile long long *offset;
static int (*real)(clockid_t, struct timespec *);
__attribute__((constructor)) static void begin(void) {
    offset = mmap(0, 8, PROT_READ, MAP_SHARED, open(getenv("WALL_CLOCK"), O_RDONLY), 0);
    real = (int (*)(clockid_t, struct timespec *))dlsym(RTLD_NEXT, "clock_gettime");
}
int clock_gettime(clockid_t clock, struct timespec *at) {
    int code = real(clock, at);
    if (!code && clock == CLOCK_REALTIME) at->tv_sec += *offset;
    return code;
}
int gettimeofday(struct timeval *restrict at, void *restrict zone) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    at->tv_sec = now.tv_sec;
    at->tv_usec = now.tv_nsec / 1000;
    return 0;
}
time_t time(time_t *at) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    if (at) *at = now.tv_sec;
    return now.tv_sec;
}
"""


needs_compiler = pytest.mark.skipif(
    shutil.which("cc") is None, reason="WallClock needs a C compiler: apt install gcc"
)


class WallClock:
    """A wall clock that can be set, for processes with its `environment`; ``folder``
    holds its files.

    libfaketime 0.9.10 will not do: under Python 3.11 it also changes the monotonic
    clock, or each sleep is an error.
    """

    def __init__(self, folder: Path) -> None:
        self._offset, library = folder / "offset", folder / "clock.so"
        self.set(0)
        (folder / "clock.c").write_text(SHIM)
        subprocess.run(
            [
                "cc",
                "-shared",
                "-fPIC",
                "-O2",
                "-o",
                library,
                folder / "clock.c",
                "-ldl",
            ],
            check=True,
        )
        self.environment = {"LD_PRELOAD": str(library), "WALL_CLOCK": str(self._offset)}

    def set(self, offset: int) -> None:
        """Set it to ``offset`` seconds after the machine's."""
        with open(self._offset, "r+b" if self._offset.exists() else "wb") as file:
            file.write(offset.to_bytes(8, "little", signed=True))


class RunningLink:
    """`send` and `receive` with a log of each, and what the operator's telemetry
    says."""

    def __init__(self, run: KilledRun) -> None:
        self.run, self._watcher = run, Watcher(run.name)

    def longest_gap(self, duration: float) -> float:
        """Return the longest time between two predictions in the next seconds."""
        begun = now = time.monotonic()
        made = [begun]
        while now < begun + duration:
            time.sleep(0.2)
            now = time.monotonic()
            made += [
                float(row["made"])
                for row in self._watcher.predictions()[0]
                if row["made"] > made[-1]
            ]
        return max(later - sooner for sooner, later in itertools.pairwise([*made, now]))

    def stop(self, duration: float) -> tuple[float, float]:
        """Stop every process for a while; return seconds until the next prediction, and
        what vibrated before it."""
        processes = self.run.processes()
        for process in processes:
            process.suspend()
        time.sleep(duration)
        last, begun = (
            float(self._watcher.predictions()[0]["made"][-1]),
            time.monotonic(),
        )
        rendered = self._watcher.totals()[0]["callbacks"]
        for process in processes:
            process.resume()
        peak = 0.0
        while time.monotonic() < begun + 10.0:
            time.sleep(0.02)
            # What was rendered last may fade for 0.1 s of periods, and lie in the
            # newest 20 ms for as long again. It is read before the predictions, so that
            # the vibration of a new one is not taken for what was left.
            faded = self._watcher.totals()[0]["callbacks"] > rendered + FADE
            level = float(
                np.abs(self._watcher.snapshot().vibration[-960:]).max(initial=0.0)
            )
            made = self._watcher.predictions()[0]["made"]
            fresh = made[made > max(last, begun)]
            if len(fresh):
                return float(fresh[0]) - begun, peak
            if faded:
                peak = max(peak, level)
        return 10.0, peak

    def restarts(self) -> int:
        return int(self._watcher.totals()[0]["process_restarts"])


@contextlib.contextmanager
def running_link(
    folder: Path, name: str, clock: WallClock | None = None
) -> Iterator[RunningLink]:
    run = both_ends(folder, name)
    run.environment = clock.environment if clock else {}
    with run:
        run.await_predictions(50)
        yield RunningLink(run)


def left_by(run: KilledRun) -> Finding:
    """End a run in order, and check its logs."""
    finding = Finding()
    run.terminate()
    finding.wrong += run.leftovers()
    for log in run.logs:
        check_log(log, finding, 0.0)
    return finding
