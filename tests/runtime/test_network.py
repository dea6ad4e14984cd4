"""Both families of addresses, and two robots at once, over the real loopback network."""

import dataclasses
import socket
from contextlib import ExitStack
from pathlib import Path

import pytest

from tactophone.link import Identity, Peers
from tactophone.runtime import ProcessInfo, Robot
from tactophone.telemetry import Watcher

from ..models import write_tiny_model
from .live_system import LiveSystem, Strokes, eventually, housekept

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize(("host", "peer"), [("::1", "::1"), ("", "::1"), ("", "127.0.0.1"), ("", "localhost")])
def test_the_robot_reaches_its_operator_by_either_family(tmp_path: Path, host: str, peer: str) -> None:
    if ":" in peer and not _has_ipv6():
        pytest.skip("this machine has no IPv6")
    model = write_tiny_model(tmp_path / "tiny.onnx", gain=1e3)
    system = LiveSystem(tmp_path, model, f"link.host={host}", f"link.peer={peer}")
    with system.both():
        assert eventually(lambda: system.amplitude() > 0.3)


def test_a_second_robot_is_sent_away_and_both_sides_show_it(tmp_path: Path) -> None:
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    second = Identity.create("second")
    second.save(tmp_path / "second")
    Peers.load(tmp_path / "robot").save(tmp_path / "second")
    Peers.load(tmp_path / "operator").trusting("second", second.fingerprint).save(tmp_path / "operator")
    link = dataclasses.replace(system.robot_settings.link, identity=str(tmp_path / "second"))
    settings = dataclasses.replace(system.robot_settings, link=link)
    info = ProcessInfo(system.names[0] + "-second")
    with ExitStack() as stack:
        stack.enter_context(system.both())
        assert eventually(lambda: system.amplitude() > 0.3)
        robot = stack.enter_context(Robot(settings, info, open_source=lambda _: Strokes()))
        stack.enter_context(housekept(robot))
        assert eventually(lambda: any(fault.code == "second_robot" for fault in system.snapshot().state.faults))
        assert eventually(lambda: "takes one at a time" in str(Watcher(info.name).snapshot().state.faults))
        assert system.snapshot().state.link == "connected to robot"
        assert system.snapshot().counters["link_losses"] == 0


def _has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True
