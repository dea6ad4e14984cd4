"""One robot with several operators: its settings, and two at once over the real
loopback network."""

import argparse
import threading
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from uuid import uuid4

import numpy as np
import pytest

from benchmarks.second_operator import with_operator
from tactophone.cli import add_verb, options
from tactophone.cli.verbs import all_verbs
from tactophone.core.errors import ConfigError, DeviceError
from tactophone.core.settings import LinkSettings, Settings, change
from tactophone.live.runtime import robot as robot_side
from tactophone.live.runtime.operator import Operator
from tactophone.live.runtime.robot import Robot
from tactophone.live.runtime.sessions import open_send_group, operators_of
from tactophone.live.runtime.supervisor import ProcessInfo
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.packet import Address
from tests.models import write_tiny_model

from .live_system import LiveSystem, Strokes, eventually, housekept


@pytest.mark.parametrize(
    ("peer", "message"),
    [
        ("", "link.peer is empty"),
        (" , ", "link.peer is empty"),
        ("a,b,c,d,e", "names 5 operators, but a robot sends to at most 4"),
        ("a,b,a", "names a twice"),
        ("a,a:48470", "names a twice"),
        ("a:b", "'b' is no port"),
        ("[::1]:0", "'0' is no port"),
        ("a:70000", "'70000' is no port"),
    ],
)
def test_operators_that_cannot_be_called_are_refused(peer: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        operators_of(LinkSettings(peer=peer))


def test_two_names_of_one_operator_are_refused(tmp_path: Path) -> None:
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    settings = change(system.robot_settings, ["link.peer=127.0.0.1,127.0.0.1 "])
    with pytest.raises(ConfigError, match=r"names 127\.0\.0\.1 twice"):
        open_send_group(settings, 2)
    settings = change(system.robot_settings, ["link.peer=127.0.0.1,127.1"])
    with pytest.raises(
        ConfigError, match=r"two names in link\.peer lead to 127\.0\.0\.1"
    ):
        open_send_group(settings, 2)


def test_a_robot_says_whose_name_it_looks_up_as_that_may_take_too_long(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    at_look_up: list[str] = []

    def look_up(host: str, port: int) -> list[Address]:
        at_look_up.append(told[-1])
        raise DeviceError("no answer")

    monkeypatch.setattr("tactophone.live.runtime.sessions.resolve", look_up)
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    settings = change(system.robot_settings, ["link.peer=operator.local"])
    info = ProcessInfo("test-looks-up", progress=told.append)
    with pytest.raises(DeviceError, match="no answer"):
        Robot(settings, info, open_source=lambda _: Strokes())
    assert at_look_up == ["looking up operator.local"]


def test_the_flag_may_be_given_for_each_operator() -> None:
    parser = argparse.ArgumentParser()
    add_verb(parser, all_verbs()["send"])
    args = parser.parse_args(
        ["--peer", "trainer", "--peer", "trainee:48471", "--set", "link.port=5000"]
    )
    assert operators_of(options.settings_of(args).link) == [
        ("trainer", 5000),
        ("trainee", 48471),
    ]


@pytest.mark.realtime
def test_the_sound_waits_for_eight_datagrams_of_an_operator_at_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken: list[int] = []
    ended = threading.Event()
    group = SimpleNamespace(
        members=[SimpleNamespace(session=None)],
        receive=lambda datagrams, **_: taken.append(len(datagrams)),
        poll=lambda *_, **__: ended.set(),
    )
    sockets = [
        SimpleNamespace(receive=lambda _: [(b"flood", ("192.0.2.1", 5_000))] * 20)
    ]
    monkeypatch.setattr(robot_side, "name_thread", lambda _: None)
    monkeypatch.setattr(robot_side, "prioritize_thread", lambda _: None)
    monkeypatch.setattr(robot_side.sessions, "send_outgoing", lambda *_: None)
    robot: Any = SimpleNamespace(
        _group=group,
        _sockets=sockets,
        _lock=threading.Lock(),
        _settings=Settings(),
        ended=ended,
    )
    Robot._follow_network(robot, 0)
    assert taken == [8, 8, 4]


@pytest.mark.slow
def test_trainer_and_trainee_feel_the_same_robot_each_below_its_own_ceiling(
    tmp_path: Path,
) -> None:
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    name = f"second-{uuid4().hex[:8]}"
    system.robot_settings, second = with_operator(
        system.robot_settings, system.operator_settings, tmp_path, name=name
    )
    second = change(second, ["rendering.ceiling=0.1"])
    with ExitStack() as stack:
        stack.enter_context(system.both())
        robot = Watcher(system.names[0])
        assert eventually(lambda: system.amplitude() > 0.3)
        with Operator(second, ProcessInfo(name)) as operator, housekept(operator):
            watcher = Watcher(name)
            assert eventually(
                lambda: (
                    float(np.abs(watcher.snapshot().vibration[-960:]).max(initial=0.0))
                    > 0.05
                )
            )
            assert eventually(lambda: robot.snapshot().gauges["operators"] == 2)
            assert (
                robot.snapshot().state.link
                == f"connected to operator, {name} (2 of 2 operators)"
            )
            assert float(np.abs(watcher.snapshot().vibration).max()) <= 0.1 + 1e-6
        assert eventually(
            lambda: (
                [fault.code for fault in robot.snapshot().state.faults] == ["link-2"]
            )
        )
        assert robot.snapshot().gauges["operators"] == 1
        assert system.amplitude() > 0.3
        assert system.snapshot().counters["link_losses"] == 0
