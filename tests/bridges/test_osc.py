import argparse
import socket
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from tactophone.bridges.osc import OscBridge
from tactophone.bridges.reader import SILENCE, NewestReader
from tactophone.cli import live, options
from tactophone.errors import ConfigError
from tactophone.telemetry.layout import FingerState, State
from tactophone.telemetry.writer import Telemetry
from tactophone.types import AudioBlock, HapticCommand, PipelineStep, Prediction, Touch

osc_message = pytest.importorskip("pythonosc.osc_message")

STEP = PipelineStep(
    AudioBlock(np.zeros((1, 1), np.float32), 48_000),
    (Prediction((0.1, 0.2, 0.7), Touch.ROUGH, 0.75, -20.0, 0.0, 0.256),),
    (HapticCommand(0.5, 60.0, 0.26),),
)


@pytest.fixture
def telemetry(request: pytest.FixtureRequest) -> Iterator[Telemetry]:
    with Telemetry(f"test-osc-{abs(hash(request.node.name))}") as telemetry:
        yield telemetry


def receive(listening: socket.socket, count: int) -> dict[str, list[float]]:
    listening.settimeout(5)
    messages = [osc_message.OscMessage(listening.recv(1 << 12)) for _ in range(count)]
    return {message.address: list(message.params) for message in messages}


def test_predictions_and_vibration_are_sent_as_limited(telemetry: Telemetry) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        target = f"127.0.0.1:{listening.getsockname()[1]}"
        with OscBridge(telemetry.name, target, avatar=True) as bridge:
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            found = receive(listening, 7)
    assert found["/tactophone/index/prediction"] == pytest.approx([0.1, 0.2, 0.7])
    assert found["/tactophone/index/vibration"] == pytest.approx([0.5, 60.0])
    assert found["/tactophone/index/contact"] == [1]
    assert found["/avatar/parameters/TactophoneRoughness"] == pytest.approx([0.75])


def test_each_finger_of_a_hand_has_its_name() -> None:
    with (
        Telemetry("test-osc-hand", fingers=2) as telemetry,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening,
    ):
        telemetry.update(State(fingers=(FingerState("thumb"), FingerState("index"))), now=time.monotonic())
        listening.bind(("127.0.0.1", 0))
        with OscBridge(telemetry.name, f"127.0.0.1:{listening.getsockname()[1]}", avatar=True) as bridge:
            telemetry.publish(replace(STEP, finger=1), now=time.monotonic())
            bridge.read()
            found = receive(listening, 7)
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            found_next = receive(listening, 7)
    assert found["/tactophone/index/vibration"] == pytest.approx([0.5, 60.0])
    assert found["/avatar/parameters/TactophoneVibrationIndex"] == pytest.approx([0.5])
    assert found_next["/tactophone/thumb/vibration"] == pytest.approx([0.5, 60.0])


@pytest.mark.parametrize("ending", ["the predictions end", "the bridge ends"])
def test_what_was_vibrating_is_sent_a_0_when(
    ending: str, telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        with OscBridge(telemetry.name, f"127.0.0.1:{listening.getsockname()[1]}", avatar=True) as bridge:
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            receive(listening, 7)
            monkeypatch.setattr(time, "time", lambda: 0.0)  # the clock on the wall may be set at any time
            if ending == "the predictions end":
                time.sleep(1.1 * SILENCE)
                bridge.read()
        found = receive(listening, 7)
        listening.setblocking(False)
        with pytest.raises(BlockingIOError):
            listening.recv(1)  # once is enough
    assert found["/tactophone/index/vibration"] == pytest.approx([0.0, 60.0])
    assert found["/avatar/parameters/TactophoneVibration"] == found["/avatar/parameters/TactophoneContact"] == [0]


def test_what_a_run_did_before_is_not_passed_on(telemetry: Telemetry) -> None:
    telemetry.publish(STEP, now=time.monotonic())
    reader = NewestReader(telemetry.name)
    assert reader.read() == {}
    telemetry.publish(STEP, now=time.monotonic())
    assert reader.read()["index"].command.amplitude == 0.5


def test_only_stop_is_obeyed_and_a_flood_is_counted(telemetry: Telemetry) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    bridge = OscBridge(telemetry.name, "127.0.0.1:9", listen=port)
    with bridge, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for datagram in (
            b"/tactophone/arm\0,\0\0\0",
            b"#bundle\0" + bytes(12),
            b"\xff" * 100,
            b"",
            b"/tactophone/ceiling",
        ):
            stranger.sendto(datagram, ("127.0.0.1", port))
        bridge.read()
        assert telemetry.requests() == []
        assert bridge.counts["ignored"] == 5
        for _ in range(200):
            stranger.sendto(b"/x\0\0,\0\0\0", ("127.0.0.1", port))
        bridge.read()
        assert bridge.counts["ignored"] == 37  # one read takes 32 of them
        for _ in range(8):
            bridge.read()
        stranger.sendto(b"/tactophone/stop\0\0\0\0,\0\0\0", ("127.0.0.1", port))
        bridge.read()
        assert [request.action for request in telemetry.requests()] == ["stop"]


@pytest.mark.parametrize("target", ["9000", "host:", "host:port", "host:70000"])
def test_a_wrong_address_is_one_line(telemetry: Telemetry, target: str) -> None:
    with pytest.raises(ConfigError, match="HOST:PORT"):
        OscBridge(telemetry.name, target)


@pytest.mark.parametrize("port", [-1, 65_536])
def test_a_port_to_listen_at_that_is_none_is_one_line(telemetry: Telemetry, port: int) -> None:
    with pytest.raises(ConfigError, match="1 to 65535"):
        OscBridge(telemetry.name, "127.0.0.1:9", listen=port)


@pytest.mark.parametrize(
    ("verb", "words"),
    [
        ("receive", ["--set", "bridges.osc_listen=9001"]),
        ("receive", ["--set", "bridges.osc_avatar=true"]),
        ("receive", ["--set", "bridges.ros_sinks=joy", "--bridge", "osc=127.0.0.1:9"]),
        ("receive", ["--set", "bridges.finger=thumb"]),
        ("send", ["--bridge", "osc=127.0.0.1:9", "--set", "bridges.osc_listen=9001"]),
    ],
)
def test_an_option_that_would_be_ignored_is_refused(telemetry: Telemetry, verb: str, words: list[str]) -> None:
    parser = argparse.ArgumentParser()
    live.add_record(parser)
    options.add_settings(parser, verb)
    args = parser.parse_args(words)
    args.verb = verb
    with (
        pytest.raises(ConfigError, match=r"does nothing without|stops the operator"),
        live.recorded(args, options.settings_of(args), telemetry.name),
    ):
        pass
