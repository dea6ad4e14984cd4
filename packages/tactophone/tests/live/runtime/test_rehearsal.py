"""Nothing is imported, compiled or opened once a side has reported that it runs."""

import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from benchmarks.failsafe import EndlessStroke
from tactophone.core.settings import Settings, change
from tactophone.live.runtime.operator import run_operator
from tactophone.live.runtime.pairing import pair_on_one_machine
from tactophone.live.runtime.robot import run_robot
from tactophone.live.runtime.supervisor import Main, ProcessInfo, Supervisor, supervised
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry
from tests.live.runtime.live_system import eventually

pytestmark = pytest.mark.realtime


def audited(main: Main, path: Path, settings: Settings, info: ProcessInfo) -> None:
    """Run a side, and write what it loads after its first heartbeat to a file."""
    log, running = path.open("w", buffering=1), False

    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if running and event in (
            "import",
            "compile",
            "open",
            "ctypes.dlopen",
            "subprocess.Popen",
        ):
            log.write(f"{event} {str(arguments)[:100]}\n")

    sys.addaudithook(note)
    update = Telemetry.update

    def first_update(*arguments: Any, **options: Any) -> None:
        nonlocal running
        update(*arguments, **options)
        running = running or options["now"] > 0  # at 0 it is still starting

    Telemetry.update = first_update  # type: ignore[method-assign]
    main(settings, info)


@pytest.mark.parametrize("profile", ["paper", "direct"])
def test_a_run_loads_nothing(profile: str, tmp_path: Path) -> None:
    name = f"test-rehearsal-{os.getpid()}-{profile}"
    changes = ["output.actuator=none", f"rendering.profile={profile}"]
    robot, operator = pair_on_one_machine(
        change(Settings(), changes), tmp_path, name=name
    )
    send = partial(run_robot, open_source=EndlessStroke)
    with supervised(
        Supervisor(
            partial(audited, run_operator, tmp_path / "operator.txt"),
            operator,
            name=name,
        ),
        Supervisor(
            partial(audited, send, tmp_path / "robot.txt"),
            robot,
            name=robot.process.name,
        ),
    ):
        assert eventually(
            lambda: Watcher(name).snapshot().counters["packets_received"] > 200
        )
    for side in ("operator", "robot"):
        assert (tmp_path / f"{side}.txt").read_text() == "", side
