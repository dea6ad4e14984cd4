"""A robot and an operator in one process, over the real loopback network, for tests."""

import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Self
from uuid import uuid4

import numpy as np

from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings, change
from tactophone.core.types import AudioBlock
from tactophone.live.runtime.operator import Operator
from tactophone.live.runtime.robot import Robot
from tactophone.live.runtime.supervisor import ProcessInfo
from tactophone.live.telemetry.watcher import Snapshot, Watcher
from tactophone.net.link.identity import Identity, Peers


class Strokes:
    """A source that is rough (a strong tone at 400 Hz) while ``touching`` is set, and
    silent otherwise."""

    sample_rate, channels = 48_000, 2

    def __init__(self) -> None:
        self.touching = True
        self.closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.closed = True

    def __iter__(self) -> Iterator[AudioBlock]:
        position = 0
        while not self.closed:
            phase = 2 * np.pi * 400 / 48_000 * np.arange(position, position + 128)
            tone = (0.5 * np.sin(phase) * self.touching).astype(np.float32)
            yield AudioBlock(
                np.stack([tone, 0.1 * tone], axis=1)[:, : self.channels],
                48_000,
                position,
            )
            position += 128


class LiveSystem:
    """Settings and names of both sides, and the sides while they run."""

    def __init__(self, folder: Path, model: Path, *changes: str) -> None:
        robot, operator = Identity.create("robot"), Identity.create("operator")
        robot.save(folder / "robot")
        operator.save(folder / "operator")
        Peers({operator.fingerprint: "operator"}).save(folder / "robot")
        Peers({robot.fingerprint: "robot"}).save(folder / "operator")
        common = [
            f"link.port={free_port()}",
            f"detector.model={model}",
            "link.peer=127.0.0.1",
            "output.actuator=none",
        ]
        settings = change(
            Settings(),
            [
                *common,
                "link.host=127.0.0.1",
                "detector.check_microphones=false",
                *changes,
            ],
        )
        self.robot_settings = change(settings, [f"link.identity={folder / 'robot'}"])
        self.operator_settings = change(
            settings, [f"link.identity={folder / 'operator'}"]
        )
        self.names = (
            f"test-robot-{uuid4().hex[:8]}",
            f"test-operator-{uuid4().hex[:8]}",
        )
        self.source = Strokes()

    @contextmanager
    def robot(self) -> Iterator[Robot]:
        self.source.closed = False
        robot = Robot(
            self.robot_settings,
            ProcessInfo(self.names[0]),
            open_source=lambda _: self.source,
        )
        with robot, housekept(robot):
            yield robot

    @contextmanager
    def operator(self, *, restarts: int = 0) -> Iterator[Operator]:
        operator = Operator(
            self.operator_settings, ProcessInfo(self.names[1], restarts=restarts)
        )
        with operator, housekept(operator):
            yield operator

    @contextmanager
    def both(self) -> Iterator[Operator]:
        with ExitStack() as stack:
            operator = stack.enter_context(self.operator())
            stack.enter_context(self.robot())
            yield operator

    def snapshot(self) -> Snapshot:
        return Watcher(self.names[1]).snapshot()

    def amplitude(self) -> float:
        """Largest of the newest 20 ms of vibration."""
        return float(np.abs(self.snapshot().vibration[-960:]).max(initial=0.0))


@contextmanager
def housekept(side: Robot | Operator) -> Iterator[None]:
    """Do the housekeeping of the side's main thread."""
    ended = threading.Event()

    def work() -> None:
        while not ended.wait(0.02):
            side.housekeep(time.monotonic())

    thread = threading.Thread(target=work, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def eventually(condition: Callable[[], bool], *, timeout: float = 5.0) -> bool:
    until = time.monotonic() + timeout
    while time.monotonic() < until:
        if condition():
            return True
        time.sleep(0.01)
    return False


def writer_of(name: str) -> int:
    """Return the process that writes a run's telemetry; 0 while there is no such
    process.

    Whoever starts a run removes the memory of dead processes, so the memory of a
    process just killed may be gone.
    """
    with suppress(TactophoneError):
        return Watcher(name).pid
    return 0


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
