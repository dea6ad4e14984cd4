"""A robot's further operators on one machine."""

from pathlib import Path

import pytest

from tactophone.core.settings import Settings
from tactophone.live.runtime.pairing import pair_on_one_machine


def test_a_robot_calls_each_further_operator_at_its_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    from second_operator import with_operator

    robot, first = pair_on_one_machine(Settings(), tmp_path, name="first")
    robot, second = with_operator(robot, first, tmp_path, name="second")
    robot, third = with_operator(robot, first, tmp_path, name="third")
    assert robot.link.peer.split(",") == [
        "127.0.0.1",
        f"127.0.0.1:{second.link.port}",
        f"127.0.0.1:{third.link.port}",
    ]
    assert robot.link.port == first.link.port
