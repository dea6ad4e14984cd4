"""One run of `versions.py`: prints the processor time of both ends, in percent of a
core.

It runs in the environment of the version that is measured, so it uses only what all
versions have, and makes its own sound.

    python benchmarks/version_cost.py SOUND FINGERS PACKET_MS SECONDS PERIOD
"""

import argparse
import json
import os
import time
from contextlib import closing
from dataclasses import replace

import numpy as np
import psutil
from numpy.typing import NDArray

from tactophone.core.hand import names_of, with_fingers
from tactophone.core.microphones import MICROPHONES
from tactophone.core.settings import Settings, change
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient
from tactophone.live.runtime.pairing import both_sides
from tactophone.live.telemetry.watcher import Watcher

RATE = 48_000

LOOP = 4
"""Seconds after which the sound repeats."""

BACKGROUND = 5e-4
"""RMS of a microphone at rest."""

STROKE = 0.1
"""Highest RMS of a stroke at the contact microphone; a third at the air microphone."""

SETTLE = 3.0
"""Seconds before the measurement."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sound", choices=("silence", "air", "strokes"))
    parser.add_argument("fingers", type=int)
    parser.add_argument("packet_ms", type=float)
    parser.add_argument("seconds", type=int)
    parser.add_argument("period", type=int)
    args = parser.parse_args()
    name = f"versions-{os.getpid()}"
    with DummyServer(args.period) as server:
        settings = settings_of(args, name, server.name)
        with both_sides(settings, name=name) as sides:
            await_connection(Watcher(sides.operator.name))
            ports = [
                f"{finger}-{microphone}".lstrip("-")
                for finger in names_of(settings)
                for microphone in MICROPHONES
            ]
            player = Player(sound_of(args.sound, len(ports)))
            client = JackClient(
                f"{name}-player",
                player.process,
                inputs={},
                outputs={port: f"{sides.robot.name}:{port}" for port in ports},
                server=server.name,
            )
            with closing(client):
                client.open()
                time.sleep(SETTLE)
                pids = {"robot": sides.robot.pid, "operator": sides.operator.pid}
                print(json.dumps(shares(pids, args.seconds)))


def settings_of(args: argparse.Namespace, name: str, server: str) -> Settings:
    free = dict.fromkeys(("capture.contact", "capture.air", "output.port"), "-")
    settings = change(
        Settings(),
        [
            f"process.name={name}",
            f"process.jack_server={server}",
            "link.codec=opus",
            f"link.packet_duration={args.packet_ms / 1_000}",
            f"detector.check_microphones={str(args.sound != 'silence').lower()}",
            "capture.source=jack",
            "output.actuator=jack",
        ],
    )
    if args.fingers == 1:
        return change(settings, [f"{key}={value}" for key, value in free.items()])
    settings = with_fingers(settings, str(args.fingers))
    fingers = tuple(
        type(each)(each.name, tuple((dict(each.settings) | free).items()))
        for each in settings.fingers
    )
    return replace(settings, fingers=fingers)


def await_connection(operator: Watcher) -> None:
    for _ in range(1_000):
        if operator.snapshot().counters["packets_received"] > 10:
            return
        time.sleep(0.02)
    raise SystemExit("the two ends did not connect within 20 s")


def sound_of(kind: str, ports: int) -> NDArray[np.float32]:
    """Return `LOOP` seconds, ``(ports, samples)``."""
    size = LOOP * RATE
    if kind == "silence":
        return np.zeros((ports, size), np.float32)
    strength = np.full((ports, size), BACKGROUND)
    if kind == "strokes":
        shares = np.tile([1.0, 0.3], ports // 2)[:, None]
        swell = np.maximum(0.0, np.sin(np.pi * np.arange(size) / RATE))
        strength += STROKE * shares * swell
    noise = np.random.default_rng(0).standard_normal((ports, size))
    return (strength * noise).astype(np.float32)


class Player:
    """Plays a sound over and over; ``process`` is for a JACK client."""

    def __init__(self, sound: NDArray[np.float32]) -> None:
        self._sound = sound
        self._position = 0

    def process(
        self, inputs: list[NDArray[np.float32]], outputs: list[NDArray[np.float32]]
    ) -> None:
        size = len(outputs[0])
        if self._position + size > self._sound.shape[1]:
            self._position = 0
        for row, output in zip(self._sound, outputs, strict=True):
            output[:] = row[self._position : self._position + size]
        self._position += size


def shares(pids: dict[str, int], seconds: int) -> dict[str, float]:
    """Return the percent of a core that each process takes, the median of stretches of
    a second."""
    processes = {name: psutil.Process(pid) for name, pid in pids.items()}
    found: dict[str, list[float]] = {name: [] for name in pids}
    for _ in range(seconds):
        began = time.monotonic()
        before = {name: sum(each.cpu_times()[:2]) for name, each in processes.items()}
        time.sleep(1.0)
        elapsed = time.monotonic() - began
        for name, process in processes.items():
            used = sum(process.cpu_times()[:2]) - before[name]
            found[name].append(100 * used / elapsed)
    return {name: float(np.median(each)) for name, each in found.items()}


if __name__ == "__main__":
    main()
