"""Robot and operator on one machine: two fresh identities, paired for one run, and the
two processes."""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

from tactophone.core.processes import hold
from tactophone.core.settings import LinkSettings, Settings
from tactophone.core.types import ignore
from tactophone.live.audio.sources import open_device
from tactophone.live.runtime.operator import run_operator
from tactophone.live.runtime.robot import run_robot
from tactophone.live.runtime.supervisor import Supervisor, supervised
from tactophone.live.runtime.wiring import OpenSource
from tactophone.live.telemetry.memory import is_alive
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.udp import UdpSocket

_KEYS = "tactophone-keys-"
"""Begin of the name of a folder for keys; the number of its process follows."""


def pair_on_one_machine(
    settings: Settings, folder: Path, *, name: str
) -> tuple[Settings, Settings]:
    """Return the robot's and the operator's settings: keys in ``folder``, and a free
    port of the loopback.

    The operator's run is named ``name``, the robot's ``name-robot``.
    """
    robot = Identity.create("robot")
    operator = Identity.create("operator")
    robot.save(folder / "robot")
    operator.save(folder / "operator")
    Peers({operator.fingerprint: "operator"}).save(folder / "robot")
    Peers({robot.fingerprint: "robot"}).save(folder / "operator")
    with UdpSocket("127.0.0.1") as probe:
        port = probe.address[1]
    link = replace(settings.link, peer="127.0.0.1", host="127.0.0.1", port=port)
    robot_link = replace(link, identity=str(folder / "robot"))
    operator_link = replace(link, identity=str(folder / "operator"))
    return (
        _side(settings, robot_link, f"{name}-robot"),
        _side(settings, operator_link, name),
    )


@contextmanager
def temporary_keys() -> Iterator[Path]:
    """Yield a private folder for the keys of one run. Folders that killed runs of this
    user left behind are removed first."""
    for left in Path(tempfile.gettempdir()).glob(f"{_KEYS}*"):
        pid = left.name.removeprefix(_KEYS).partition("-")[0]
        with suppress(OSError):
            own = left.lstat().st_uid == os.getuid()
            if own and pid.isdecimal() and not is_alive(int(pid)):
                with _open_folder(left) as descriptor:
                    if hold(descriptor):
                        shutil.rmtree(left, ignore_errors=True)
    with (
        tempfile.TemporaryDirectory(prefix=f"{_KEYS}{os.getpid()}-") as folder,
        _open_folder(Path(folder)) as descriptor,
    ):
        hold(descriptor)
        yield Path(folder)


@contextmanager
def _open_folder(folder: Path) -> Iterator[int]:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


class Sides(NamedTuple):
    """Operator and robot while they run."""

    operator: Supervisor
    robot: Supervisor


@contextmanager
def both_sides(
    settings: Settings,
    *,
    name: str,
    open_source: OpenSource = open_device,
    between: Callable[[Settings], AbstractContextManager[int]] | None = None,
    report: Callable[[str], None] = ignore,
) -> Iterator[Sides]:
    """Run operator and robot, each in its process.

    - ``between``: opens what stands between the two, by the operator's settings, and
      yields the port that the robot calls.
    - ``report``: see `Supervisor`.
    """
    with temporary_keys() as folder, ExitStack() as stack:
        robot, operator = pair_on_one_machine(settings, folder, name=name)
        if between:
            port = stack.enter_context(between(operator))
            robot = replace(robot, link=replace(robot.link, port=port))
        receive = partial(run_operator, robot=robot.process.name)
        send = partial(run_robot, open_source=open_source)
        receiving = Supervisor(receive, operator, name=name, report=report)
        sending = Supervisor(send, robot, name=robot.process.name, report=report)
        yield Sides(*stack.enter_context(supervised(receiving, sending)))


def _side(settings: Settings, link: LinkSettings, name: str) -> Settings:
    return replace(settings, link=link, process=replace(settings.process, name=name))
