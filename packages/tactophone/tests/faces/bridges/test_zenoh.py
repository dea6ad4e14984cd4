"""The topics of ROS 2 over Zenoh: two sessions that talk over the loopback interface,
as peers."""

import json
import socket
import struct
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("zenoh")
pytest.importorskip("cyclonedds")
pytest.importorskip("rosbags")

import zenoh
from zenoh import ext

from tactophone.core.errors import ConfigError
from tactophone.faces.bridges import ros_topics as messages
from tactophone.faces.bridges.ros import RosBridge
from tactophone.faces.bridges.ros_topics import open_type_store
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.writer import Telemetry
from tests.faces.bridges.test_osc import STEP
from tests.live.runtime.live_system import eventually

FLOAT32 = "std_msgs::msg::dds_::Float32_"
FLOAT32_HASH = "RIHS01_7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2"
"""Of std_msgs/msg/Float32, as ROS 2 Jazzy publishes it."""

pytestmark = pytest.mark.realtime


def config(**endpoints: list[str]) -> Any:
    """Return the configuration of a peer that nobody finds by itself."""
    entries = {
        "mode": "peer",
        "scouting": {"multicast": {"enabled": False}},
        "listen": {"endpoints": []},
    }
    entries |= {name: {"endpoints": found} for name, found in endpoints.items()}
    return entries


@pytest.fixture
def address() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@pytest.fixture
def telemetry() -> Iterator[Telemetry]:
    with Telemetry("test-zenoh") as telemetry:
        yield telemetry


@pytest.fixture
def bridge(
    telemetry: Telemetry, address: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[RosBridge]:
    (tmp_path / "session.json5").write_text(json.dumps(config(listen=[address])))
    monkeypatch.setenv("ZENOH_SESSION_CONFIG_URI", str(tmp_path / "session.json5"))
    with RosBridge(
        telemetry.name, sinks=["senseglove"], domain=7, over="zenoh"
    ) as bridge:
        yield bridge


@pytest.fixture
def node(bridge: RosBridge, address: str) -> Iterator[Any]:
    """Open the session of another program, which knows where the bridge listens."""
    with zenoh.open(
        zenoh.Config.from_json5(json.dumps(config(connect=[address])))
    ) as session:
        yield session


def test_predictions_sound_format_and_devices_arrive_under_the_keys_of_rmw_zenoh(
    bridge: RosBridge, node: Any, telemetry: Telemetry
) -> None:
    found: dict[str, Any] = {}
    everything = node.declare_subscriber(
        "7/**", lambda sample: found.setdefault(str(sample.key_expr), sample)
    )
    late = ext.declare_advanced_subscriber(
        node,
        "7/tactophone/index/audio_info/**",
        lambda sample: found.setdefault("late", sample),
        history=ext.HistoryConfig(detect_late_publishers=True),
    )

    def arrived() -> bool:
        telemetry.publish(STEP, now=time.monotonic())
        bridge.read()
        topics = {
            key.split("/", 1)[1].rpartition("/")[0].rpartition("/")[0]
            for key in found
            if key != "late"
        }
        return {
            "tactophone/index/roughness",
            "haptics_controller/commands",
            "diagnostics",
        } <= topics and "late" in found

    assert eventually(arrived, timeout=20)
    roughness = found[f"7/tactophone/index/roughness/{FLOAT32}/{FLOAT32_HASH}"]
    assert messages.Float32.deserialize(roughness.payload.to_bytes()).data == 0.75
    number, stamp, size, _ = struct.unpack("<qqB16s", roughness.attachment.to_bytes())
    assert number >= 1
    assert abs(stamp / 1e9 - time.time()) < 60
    assert size == 16
    assert (
        messages.AudioInfo.deserialize(found["late"].payload.to_bytes()).sample_rate
        == 48_000
    )
    everything.undeclare()
    late.undeclare()


def test_a_node_sees_the_publishers_and_may_stop_and_mute_only(
    bridge: RosBridge, node: Any, telemetry: Telemetry
) -> None:
    def tokens() -> set[str]:
        return {
            str(reply.ok.key_expr)
            for reply in node.liveliness().get("@ros2_lv/**")
            if reply.ok
        }

    assert eventually(lambda: len(tokens()) >= 8, timeout=20)
    publishers = [token.split("/") for token in tokens() if "/MP/" in token]
    assert [
        "%",
        "%",
        "tactophone",
        "%tactophone%index%roughness",
        FLOAT32,
        FLOAT32_HASH,
        "::,10:,:,:,,",
    ] in [parts[6:] for parts in publishers]
    requests: list[str] = []

    def stopped() -> bool:
        for topic in ("stop", "arm", "ceiling"):
            node.put(
                f"7/tactophone/{topic}/std_msgs::msg::dds_::Empty_/TypeHashNotSupported",
                bytes(5),
            )
        bridge.read()
        requests.extend(request.action for request in telemetry.requests())
        return bool(requests)

    assert eventually(stopped, timeout=20)
    assert set(requests) == {"stop"}


def test_joint_states_say_when_the_robot_moves(
    bridge: RosBridge, node: Any, telemetry: Telemetry
) -> None:
    telemetry.update(RunState(role="robot"), now=time.monotonic())
    moving = messages.JointState(
        messages.header(1.0), ["wrist"], velocity=[0.2]
    ).serialize()
    requests: list[tuple[str, float]] = []

    def moved() -> bool:
        for payload in (bytes(3), moving):
            node.put(
                "7/joint_states/sensor_msgs::msg::dds_::JointState_/TypeHashNotSupported",
                payload,
            )
        bridge.read()
        requests.extend(
            (request.action, request.value) for request in telemetry.requests()
        )
        return bool(requests)

    assert eventually(moved, timeout=20)
    assert requests == [("moving", 1.0)]


def test_the_hashes_are_those_of_ros() -> None:
    assert open_type_store().hash_rihs01("std_msgs/msg/Float32") == FLOAT32_HASH


def test_a_wrong_configuration_is_one_line(
    telemetry: Telemetry, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ZENOH_SESSION_CONFIG_URI", str(tmp_path / "none.json5"))
    with (
        pytest.raises(ConfigError, match="check ZENOH_SESSION_CONFIG_URI"),
        RosBridge(telemetry.name, over="zenoh"),
    ):
        pass
