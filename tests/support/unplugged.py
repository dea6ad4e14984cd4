"""The network interface of a running link is taken away and given back, in network
namespaces of this machine.

`send` and `receive` run in a namespace each, with a virtual cable between them. Needs
root and Debian's iproute2.
"""

import contextlib
import itertools
import math
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np
import psutil
import soundfile

from benchmarks.failsafe import ENDLESS_TONE, SILENT
from tactophone.core.settings import Settings
from tactophone.live.runtime.pairing import pair_on_one_machine
from tactophone.live.telemetry.watcher import Watcher
from tests.support.kills import TACTOPHONE, KilledRun

ADDRESSES = {"robot": "10.77.0.2", "operator": "10.77.0.1"}
PORT = 4_000

OUTAGES = ("robot down", "operator down", "both deleted")
"""The interface that is taken away, and how."""

FELT = 0.05
"""Amplitude above which the endless stroke is felt."""

LONGEST_SILENCE = 30.0
"""Seconds within which it has to be felt again."""

_PREFIX = "tp"
_numbers = itertools.count()


def can_make_networks() -> bool:
    return os.name == "posix" and os.geteuid() == 0 and shutil.which("ip") is not None


def prefix_of_networks() -> str:
    """Return a new prefix for the names of namespaces; those that killed processes left
    are removed."""
    listed = subprocess.run(
        ["ip", "netns", "list"], capture_output=True, text=True, check=True
    ).stdout
    for name, pid in re.findall(rf"^({_PREFIX}(\d+)-\S+)", listed, re.MULTILINE):
        if not psutil.pid_exists(int(pid)):
            remove_network(name)
    return f"{_PREFIX}{os.getpid()}-{next(_numbers)}"


def remove_network(name: str) -> None:
    """End the processes of a namespace, and delete it."""
    pids = subprocess.run(
        ["ip", "netns", "pids", name], check=False, capture_output=True, text=True
    ).stdout
    for pid in pids.split():
        with contextlib.suppress(psutil.Error):
            psutil.Process(int(pid)).kill()
    subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)


class Cable:
    """Two namespaces with an interface each; a context manager."""

    def __init__(self) -> None:
        prefix = prefix_of_networks()
        self.namespaces = {side: prefix + side for side in ADDRESSES}

    def __enter__(self) -> Self:
        for namespace in self.namespaces.values():
            subprocess.run(["ip", "netns", "add", namespace], check=True)
        self._plug()
        return self

    def __exit__(self, *_: object) -> None:
        for namespace in self.namespaces.values():
            remove_network(namespace)

    def take_away(self, outage: str) -> None:
        side, how = outage.split()
        self._ip(
            *(
                ("robot", "link del eth0")
                if how == "deleted"
                else (side, "link set eth0 down")
            )
        )

    def give_back(self, outage: str) -> None:
        side, how = outage.split()
        if how == "deleted":
            self._plug()
        else:
            self._ip(side, "link set eth0 up")

    def _plug(self) -> None:
        self._ip(
            "robot",
            "link add eth0 type veth peer name eth0 netns "
            f"{self.namespaces['operator']}",
        )
        for side, address in ADDRESSES.items():
            self._ip(side, f"addr add {address}/24 dev eth0", "link set eth0 up")

    def _ip(self, side: str, *commands: str) -> None:
        command = ["ip", "-n", self.namespaces[side], "-batch", "-"]
        subprocess.run(command, input="\n".join(commands), text=True, check=True)


@dataclass
class Outage:
    """What the operator's telemetry showed.

    ``silent`` is from when the interface was taken away, ``felt`` from when it was
    given back, both in s and infinite where it did not come; ``peak`` is the largest
    amplitude between the two.
    """

    silent: float
    felt: float
    peak: float


class UnpluggableLink:
    """`send` and `receive` at the ends of a cable, while an endless stroke is felt."""

    def __init__(self, run: KilledRun, cable: Cable) -> None:
        self.run, self._cable, self._watcher = run, cable, Watcher(run.name)

    def unplug(self, outage: str, duration: float) -> Outage:
        """Take an interface away for so long, in s, and give it back."""
        self._until(FELT, math.inf, LONGEST_SILENCE)
        begun = time.monotonic()
        self._cable.take_away(outage)
        silent, _ = self._until(0.0, SILENT, duration)
        _, peak = self._until(FELT, math.inf, begun + duration - time.monotonic())
        back = time.monotonic()
        self._cable.give_back(outage)
        felt, _ = self._until(FELT, math.inf, LONGEST_SILENCE)
        return Outage(silent - begun, felt - back, peak)

    def restarts(self) -> int:
        return int(self._watcher.totals()[0]["process_restarts"])

    def _until(self, least: float, most: float, timeout: float) -> tuple[float, float]:
        """Wait for an amplitude between the two; return when it came, and the largest
        one until then."""
        end, peak = time.monotonic() + timeout, 0.0
        while (now := time.monotonic()) < end:
            amplitude = self._watcher.pulse().amplitude
            peak = max(peak, amplitude)
            if least <= amplitude <= most:
                return now, peak
            time.sleep(0.001)
        return math.inf, peak


@contextlib.contextmanager
def unpluggable_link(folder: Path, name: str) -> Iterator[UnpluggableLink]:
    """Run both ends for a minute or two; what they print is in the file ``printed`` of
    the folder."""
    times = np.arange(120 * 48_000) / 48_000
    tone = (0.3 * np.sin(2 * np.pi * 250 * times)).astype(np.float32)
    soundfile.write(folder / "stroke.wav", np.stack([tone, tone], axis=1), 48_000)
    robot, operator = pair_on_one_machine(Settings(), folder, name=name)
    with Cable() as cable:
        commands = []
        for verb, side, settings, more in (
            ("receive", "operator", operator, ["--actuator", "none"]),
            ("send", "robot", robot, ["--source", f"file:{folder / 'stroke.wav'}"]),
        ):
            changes = [
                f"link.identity={settings.link.identity}",
                f"link.port={PORT}",
                *ENDLESS_TONE,
            ]
            changes += [
                f"link.peer={ADDRESSES['operator']}",
                "detector.check_microphones=false",
            ]
            enter = ["ip", "netns", "exec", cable.namespaces[side], *TACTOPHONE]
            options = [word for change in changes for word in ("--set", change)]
            commands.append(
                [*enter, verb, "--name", settings.process.name, *more, *options]
            )
        with KilledRun(name, commands, [], output=folder / "printed") as run:
            run.await_predictions(50)
            yield UnpluggableLink(run, cable)
