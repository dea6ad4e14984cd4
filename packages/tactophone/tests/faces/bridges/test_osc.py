import argparse
import contextlib
import socket
import struct
import threading
import time
from collections.abc import Iterator
from functools import partial

import numpy as np
import pytest
from msgspec.structs import replace

from tactophone.cli import live, options
from tactophone.core.errors import ConfigError
from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.faces.bridges import osc
from tactophone.faces.bridges.osc import OscBridge
from tactophone.faces.bridges.process import BridgeProcess
from tactophone.live.log.reader import READER_BACKLOG, READER_SILENCE, PredictionReader
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.writer import Telemetry

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


def sent_with_avatar(
    telemetry: Telemetry, step: PipelineStep
) -> dict[str, list[float]]:
    """Return what a bridge with avatar parameters sends of a step."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        target = f"127.0.0.1:{listening.getsockname()[1]}"
        with OscBridge(telemetry.name, target, avatar=True) as bridge:
            telemetry.publish(step, now=time.monotonic())
            bridge.read()
            return receive(listening, 7)


def test_predictions_and_vibration_are_sent_as_limited(telemetry: Telemetry) -> None:
    found = sent_with_avatar(telemetry, STEP)
    assert found["/tactophone/index/prediction"] == pytest.approx([0.1, 0.2, 0.7])
    assert found["/tactophone/index/vibration"] == pytest.approx([0.5, 60.0])
    assert found["/tactophone/index/contact"] == [1]
    assert found["/avatar/parameters/TactophoneRoughness"] == pytest.approx([0.75])


@pytest.mark.parametrize(("role", "contact"), [("operator", 0), ("robot", 1)])
def test_an_avatar_feels_nothing_while_the_finger_is_muted(
    role: str, contact: int, telemetry: Telemetry
) -> None:
    """A vest that is mapped to contact vibrated through every stop."""
    muted = replace(STEP, commands=(HapticCommand(0.0, 60.0, 0.26),))
    telemetry.update(RunState(role=role), now=time.monotonic())
    found = sent_with_avatar(telemetry, muted)
    assert found["/tactophone/index/contact"] == [1]
    avatar = [value for address, value in found.items() if address.startswith("/a")]
    assert sorted(avatar) == [[0.0], [0.75 * contact], [contact]]


def test_a_target_on_this_machine_opens_no_port_to_a_network(
    telemetry: Telemetry,
) -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other,
    ):
        listening.bind(("127.0.0.1", 0))
        listening.settimeout(5)
        target = f"localhost:{listening.getsockname()[1]}"
        with OscBridge(telemetry.name, target) as bridge:
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            _, (_, port) = listening.recvfrom(1 << 12)
            # A socket at all addresses would have this port here too.
            other.bind(("127.0.0.2", port))


def test_the_name_of_a_target_is_looked_up_once(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A lookup may take seconds, in which every message would wait."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        found = [(socket.AF_INET, socket.SOCK_DGRAM, 0, "", listening.getsockname())]
        asked: list[str] = []

        def look_up(host: str, *_: object, **__: object) -> object:
            asked.append(host)
            return found

        monkeypatch.setattr(socket, "getaddrinfo", look_up)
        target = f"avatar.invalid:{listening.getsockname()[1]}"
        with OscBridge(telemetry.name, target) as bridge:
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            receive(listening, 4)
    assert asked == ["avatar.invalid"]


def test_each_finger_of_a_hand_has_its_name() -> None:
    with (
        Telemetry("test-osc-hand", fingers=2) as telemetry,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening,
    ):
        telemetry.update(
            RunState(fingers=(FingerState("thumb"), FingerState("index"))),
            now=time.monotonic(),
        )
        listening.bind(("127.0.0.1", 0))
        with OscBridge(
            telemetry.name, f"127.0.0.1:{listening.getsockname()[1]}", avatar=True
        ) as bridge:
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
        with OscBridge(
            telemetry.name, f"127.0.0.1:{listening.getsockname()[1]}", avatar=True
        ) as bridge:
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            receive(listening, 7)
            # The clock on the wall may be set at any time.
            monkeypatch.setattr(time, "time", lambda: 0.0)
            if ending == "the predictions end":
                monkeypatch.setattr(osc, "REPEAT_INTERVAL", 0.02)
                time.sleep(1.1 * READER_SILENCE)
                while bridge._repeat(osc.REPEAT_INTERVAL):
                    bridge.read()
        found = receive(listening, 7)
        # The network may lose any of them.
        for _ in range(osc.REPEATS):
            assert receive(listening, 7) == found
        listening.setblocking(False)
        with pytest.raises(BlockingIOError):
            listening.recv(1)
    assert found["/tactophone/index/vibration"] == pytest.approx([0.0, 60.0])
    assert (
        found["/avatar/parameters/TactophoneVibration"]
        == found["/avatar/parameters/TactophoneContact"]
        == [0]
    )


def test_what_a_run_did_before_is_not_passed_on(telemetry: Telemetry) -> None:
    telemetry.publish(STEP, now=time.monotonic())
    reader = PredictionReader(telemetry.name)
    assert reader.read() == []
    telemetry.publish(STEP, now=time.monotonic())
    assert [(passed.finger, passed.command.amplitude) for passed in reader.read()] == [
        ("index", 0.5)
    ]


def predicted(number: int) -> PipelineStep:
    """Return a step whose prediction has a number as its roughness, made of sound that
    ends 10 ms after the last."""
    found = replace(STEP.predictions[0], roughness=float(number), end=number / 100)
    return replace(STEP, predictions=(found,))


def test_a_slow_reader_loses_the_oldest_first_and_counts_them(
    telemetry: Telemetry,
) -> None:
    reader = PredictionReader(telemetry.name)
    for number in range(READER_BACKLOG + 20):
        telemetry.publish(predicted(number), now=time.monotonic())
    assert [passed.roughness for passed in reader.read()] == list(
        range(20, READER_BACKLOG + 20)
    )
    assert reader.missed == 20
    telemetry.publish(predicted(7), now=time.monotonic())
    assert len(reader.read()) == 1
    assert reader.missed == 20


def test_each_prediction_has_the_times_of_its_sound_its_making_and_its_vibration(
    telemetry: Telemetry,
) -> None:
    reader = PredictionReader(telemetry.name)
    telemetry.gauge("latency_render", 0.002)
    telemetry.gauge("latency_device", 0.004)
    began, delays = time.monotonic() - 1.0, (0.009, 0.005, 0.030, 0.006)
    for number, delay in enumerate(delays):
        telemetry.publish(predicted(number), now=began + number / 100 + delay)
    found = reader.read()
    epoch = time.time() - time.monotonic()
    # From the quickest on, the sound's times are as even as its own clock, and late by
    # the least delay.
    sound = [passed.sound - epoch - began for passed in found]
    assert sound == pytest.approx([0.009, 0.015, 0.025, 0.035], abs=1e-4)
    made = [passed.made - epoch - began for passed in found]
    assert made == pytest.approx(
        [number / 100 + delay for number, delay in enumerate(delays)], abs=1e-4
    )
    assert [passed.rendered - passed.made for passed in found] == pytest.approx(
        [0.006] * 4, abs=1e-4
    )


@pytest.mark.realtime
@pytest.mark.timed
def test_every_prediction_arrives_within_10_ms_of_its_making(
    telemetry: Telemetry,
) -> None:
    made: dict[float, float] = {}
    arrived: dict[float, float] = {}
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", 0))
        listening.settimeout(1)

        def receive_all() -> None:
            with contextlib.suppress(TimeoutError):
                while len(arrived) < 200:
                    datagram = listening.recv(1 << 12)
                    if datagram.startswith(b"/tactophone/index/roughness\0"):
                        (number,) = struct.unpack(">f", datagram[-4:])
                        arrived[number] = time.monotonic()

        thread = threading.Thread(target=receive_all)
        with BridgeProcess(
            partial(
                OscBridge, telemetry.name, f"127.0.0.1:{listening.getsockname()[1]}"
            )
        ):
            thread.start()
            for number in range(200):
                made[number] = time.monotonic()
                telemetry.publish(predicted(number), now=made[number])
                time.sleep(0.0094)
            thread.join()
    assert set(arrived) == set(made)
    delays = [arrived[number] - made[number] for number in made]
    assert np.percentile(delays, 95) < 0.010


MESSAGE = b"/tactophone/stop\0\0\0\0,\0\0\0"
OTHERS = (
    b"/tactophone/arm\0,\0\0\0",
    b"/tactophone/stopped\0,\0\0\0",
    b"#bundle\0" + bytes(12),
    b"\xff" * 100,
    b"",
    b"/tactophone/ceiling",
)


@pytest.mark.parametrize("filtered", [True, False])
@pytest.mark.parametrize(
    "stop", [MESSAGE, b"#bundle\0" + bytes(7) + b"\1" + bytes(3) + b"\x18" + MESSAGE]
)
def test_only_stop_is_obeyed_and_no_flood_keeps_it_out(
    stop: bytes, filtered: bool, telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bundled stop was ignored, and eight of ten stops were lost in a flood."""
    if not filtered:
        monkeypatch.setattr("tactophone.faces.bridges.osc.pass_only", lambda *_: None)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    bridge = OscBridge(telemetry.name, "127.0.0.1:9", listen=port)
    with bridge, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        for datagram in OTHERS:
            stranger.sendto(datagram, ("127.0.0.1", port))
        bridge.read()
        assert telemetry.requests() == []
        assert bridge.counts["ignored"] == (0 if filtered else len(OTHERS))
        for _ in range(5000 if filtered else 0):  # more than the socket's buffer holds
            stranger.sendto(b"/x\0\0,\0\0\0", ("127.0.0.1", port))
        stranger.sendto(stop, ("127.0.0.1", port))
        bridge.read()
        assert [request.action for request in telemetry.requests()] == ["stop"]


@pytest.mark.parametrize("target", ["9000", "host:", "host:port", "host:70000"])
def test_a_wrong_address_is_one_line(telemetry: Telemetry, target: str) -> None:
    with pytest.raises(ConfigError, match="HOST:PORT"):
        OscBridge(telemetry.name, target)


@pytest.mark.parametrize("port", [-1, 65_536])
def test_a_port_to_listen_at_that_is_none_is_one_line(
    telemetry: Telemetry, port: int
) -> None:
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
def test_an_option_that_would_be_ignored_is_refused(
    telemetry: Telemetry, verb: str, words: list[str]
) -> None:
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


@pytest.mark.parametrize("host", ["a..b", 70 * "x" + ".com"])
def test_a_name_that_no_machine_can_have_is_one_line(
    telemetry: Telemetry, host: str
) -> None:
    with (
        pytest.raises(ConfigError, match="choose another address"),
        OscBridge(telemetry.name, f"{host}:9000"),
    ):
        pass
