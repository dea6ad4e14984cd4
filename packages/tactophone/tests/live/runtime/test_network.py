"""Both families of addresses, and two robots at once, over the real loopback
network."""

import dataclasses
import shutil
import socket
import statistics
import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import pytest

from benchmarks.failsafe import SILENT
from tactophone.live.runtime.robot import Robot
from tactophone.live.runtime.supervisor import ProcessInfo
from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.udp import UdpSocket
from tests.models import write_tiny_model
from tests.support.unplugged import OUTAGES, can_make_networks, unpluggable_link

from .live_system import LiveSystem, Strokes, eventually, housekept

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize(
    ("host", "peer"),
    [("::1", "::1"), ("", "::1"), ("", "127.0.0.1"), ("", "localhost")],
)
def test_the_robot_reaches_its_operator_by_either_family(
    tmp_path: Path, host: str, peer: str
) -> None:
    if ":" in peer and not _has_ipv6():
        pytest.skip("this machine has no IPv6")
    model = write_tiny_model(tmp_path / "tiny.onnx", gain=1e3)
    system = LiveSystem(tmp_path, model, f"link.host={host}", f"link.peer={peer}")
    with system.both():
        assert eventually(lambda: system.amplitude() > 0.3)


@pytest.mark.parametrize(
    ("copied", "at_robot", "at_operator"),
    [
        (False, "takes one at a time", "stop one of the two robots"),
        (True, "with the same key is connected", "called with the key of 'robot'"),
    ],
)
def test_a_second_robot_is_sent_away_and_both_sides_show_it(
    copied: bool, at_robot: str, at_operator: str, tmp_path: Path
) -> None:
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    if copied:
        shutil.copytree(tmp_path / "robot", tmp_path / "second")
    else:
        second = Identity.create("second")
        second.save(tmp_path / "second")
        Peers.load(tmp_path / "robot").save(tmp_path / "second")
        Peers.load(tmp_path / "operator").trusting("second", second.fingerprint).save(
            tmp_path / "operator"
        )
    link = dataclasses.replace(
        system.robot_settings.link, identity=str(tmp_path / "second")
    )
    settings = dataclasses.replace(system.robot_settings, link=link)
    info = ProcessInfo(system.names[0] + "-second")
    with ExitStack() as stack:
        stack.enter_context(system.both())
        assert eventually(lambda: system.amplitude() > 0.3)
        robot = stack.enter_context(
            Robot(settings, info, open_source=lambda _: Strokes())
        )
        stack.enter_context(housekept(robot))
        assert eventually(lambda: at_operator in str(system.snapshot().state.faults))
        assert eventually(
            lambda: at_robot in str(Watcher(info.name).snapshot().state.faults)
        )
        assert system.snapshot().state.link == "connected to robot"
        assert system.snapshot().counters["link_losses"] == 0


def test_a_robot_that_is_said_to_move_shows_it_at_both_ends_until_it_stands(
    tmp_path: Path,
) -> None:
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    with system.both():
        assert eventually(lambda: system.snapshot().state.link == "connected to robot")
        robot = Watcher(system.names[0])
        for value, words in ((1.0, ", moving"), (0.0, "")):
            robot.ask("moving", value)
            assert eventually(
                lambda: system.snapshot().state.link == f"connected to robot{words}"  # noqa: B023
            )
            assert robot.state().link == f"connected to operator{words}"


class Relay:
    """Stands between robot and operator as a NAT does, and changes its own port on
    request."""

    def __init__(self, port: int) -> None:
        self._operator = ("127.0.0.1", port)
        self._robot_side, self._operator_side = (
            UdpSocket("127.0.0.1"),
            UdpSocket("127.0.0.1"),
        )
        self._robot = ("", 0)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    @property
    def port(self) -> int:
        return self._robot_side.address[1]

    def rebind(self) -> None:
        self._operator_side = UdpSocket("127.0.0.1")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._ended.is_set():
            for datagram, source in self._robot_side.receive(0.001):
                self._robot = source
                self._operator_side.send([(datagram, self._operator)])
            if self._robot[1]:
                self._robot_side.send(
                    [
                        (datagram, self._robot)
                        for datagram, _ in self._operator_side.receive(0)
                    ]
                )


def test_a_robot_behind_a_changing_nat_is_felt_throughout(tmp_path: Path) -> None:
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    with Relay(system.operator_settings.link.port) as relay:
        link = dataclasses.replace(system.robot_settings.link, port=relay.port)
        system.robot_settings = dataclasses.replace(system.robot_settings, link=link)
        with system.both():
            assert eventually(lambda: system.amplitude() > 0.3)
            for change in range(1, 4):
                before = system.snapshot().counters
                relay.rebind()
                # The sound comes from the new address at once; a second later the
                # robot, hearing nothing, calls anew.
                assert eventually(
                    lambda before=before: (
                        _grown(system, before, "packets_received") > 20
                    )
                )  # type: ignore[misc]
                assert eventually(
                    lambda change=change: (
                        system.snapshot().counters["handshakes"] == 1 + change
                    )
                )  # type: ignore[misc]
            assert system.snapshot().counters["link_losses"] == 0
            assert eventually(lambda: system.amplitude() > 0.3)


def _grown(system: LiveSystem, before: dict[str, int], name: str) -> int:
    return int(system.snapshot().counters[name] - before[name])


def _has_ipv6() -> bool:
    try:
        with socket.socket(socket.AF_INET6, socket.SOCK_DGRAM) as probe:
            probe.bind(("::1", 0))
    except OSError:
        return False
    return True


@pytest.mark.skipif(
    not can_make_networks(), reason="network namespaces need root and iproute2"
)
def test_a_network_interface_taken_away_silences_and_given_back_is_felt_again(
    tmp_path: Path,
) -> None:
    with unpluggable_link(tmp_path, f"test-{tmp_path.name[-20:]}") as link:
        found = [link.unplug(outage, 0.5) for outage in OUTAGES]
        # It takes 0.1 s on a quiet machine.
        assert statistics.median(each.silent for each in found) < 0.3
        assert max(each.peak for each in found) <= SILENT
        assert max(each.felt for each in found) < 10.0
        assert link.restarts() == 0
    assert "Traceback" not in (tmp_path / "printed").read_text()
