import argparse
import itertools
import math
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

pytest.importorskip("cyclonedds")

from cyclonedds.core import Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic

from tactophone.cli import options
from tactophone.core import plugins
from tactophone.core.errors import ConfigError
from tactophone.core.types import AudioBlock, PipelineStep
from tactophone.faces.bridges import ros_topics as messages
from tactophone.faces.bridges.process import BridgeProcess
from tactophone.faces.bridges.ros import (
    BEST_EFFORT,
    MOST_JOINTS,
    QOS,
    ROS_INTERVAL,
    DdsTransport,
    JointMotion,
    RosBridge,
    RosSource,
)
from tactophone.faces.bridges.ros_topics import open_sinks
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.writer import Telemetry
from tests.faces.bridges.test_osc import STEP

URI = (
    "<General><Interfaces><NetworkInterface name='lo' "
    "multicast='true'/></Interfaces></General>"
)
DOMAIN = 87
PACKAGE = Path(__file__).parents[5] / "ros/tactophone_msgs"

ROBOT = """
import sys, time
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from tactophone.faces.bridges import ros_topics as messages
from tactophone.faces.bridges.ros import LATCHED, QOS
domain = DomainParticipant(87)
def topic(name, kind, qos=QOS):
    return Topic(domain, "rt/" + name, getattr(messages, kind), qos)
def reader(name, kind, qos=QOS):
    return DataReader(domain, topic(name, kind, qos))
readers = {
    "prediction": reader("tactophone/index/prediction", "Float32MultiArray"),
    "joy": reader("joy/set_feedback", "JoyFeedback"),
    "glove": reader("haptics_controller/commands", "Float64MultiArray"),
    "info": reader("tactophone/index/audio_info", "AudioInfo", LATCHED),
    "audio": reader("tactophone/index/audio", "AudioDataStamped"),
    "diagnostics": reader("diagnostics", "DiagnosticArray"),
}
stop = DataWriter(domain, topic("tactophone/stop", "Empty"))
found, until = {}, time.monotonic() + 30
while time.monotonic() < until and len(found) < len(readers):
    for name, reader in readers.items():
        for sample in reader.take(N=10):
            found.setdefault(name, sample)
    time.sleep(0.01)
for name, sample in found.items():
    print(name, sample)
stop.write(messages.Empty())
time.sleep(1)
"""


@pytest.fixture
def telemetry(request: pytest.FixtureRequest) -> Iterator[Telemetry]:
    with Telemetry(f"test-ros-{abs(hash(request.node.name))}") as telemetry:
        yield telemetry


@pytest.mark.realtime
def test_two_processes_talk_over_a_domain_on_the_loopback_interface(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", URI)
    robot = subprocess.Popen(
        [sys.executable, "-c", ROBOT],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    )
    requests: list[str] = []
    sinks = ("joy", "senseglove")
    with RosBridge(telemetry.name, sinks=sinks, domain=DOMAIN) as bridge:
        while robot.poll() is None:
            telemetry.publish(STEP, now=time.monotonic())
            bridge.read()
            requests += [request.action for request in telemetry.requests()]
            time.sleep(0.02)
    output, errors = robot.communicate()
    lines = dict(line.split(" ", 1) for line in output.splitlines())
    assert set(lines) == {
        "prediction",
        "joy",
        "glove",
        "info",
        "audio",
        "diagnostics",
    }, errors
    assert "type=1, id=0, intensity=0.5" in lines["joy"]
    assert (
        "data=[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 50.0" in lines["glove"]
        or "49.99, 0.0" in lines["glove"]
    )
    assert "sample_rate=48000" in lines["info"]
    assert "stop" in requests
    assert set(requests) == {"stop"}


@pytest.mark.realtime
@pytest.mark.timed
def test_every_prediction_reaches_a_glove_within_10_ms(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct, types
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic

    monkeypatch.setenv("CYCLONEDDS_URI", URI)

    # Written a second time, so that a mistake in ours shows.
    @dataclass
    class Command(IdlStruct, typename="std_msgs::msg::dds_::Float32_"):
        data: types.float32 = 0.0

    domain = DomainParticipant(DOMAIN)
    reader = DataReader(
        domain, Topic(domain, "rt/tactophone/index/amplitude", Command, QOS)
    )
    made: dict[float, float] = {}
    arrived: dict[float, float] = {}

    def take(seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            for message in reader.take(N=100):
                arrived.setdefault(message.data, time.monotonic())
            time.sleep(0.0005)

    with BridgeProcess(
        partial(RosBridge, telemetry.name, sinks=["float32"], domain=DOMAIN)
    ):
        take(1.0)  # until both ends know of each other
        for number in range(1, 201):
            amplitude = number / 512  # exact in float32
            made[amplitude] = time.monotonic()
            command = replace(STEP.commands[0], amplitude=amplitude)
            telemetry.publish(replace(STEP, commands=(command,)), now=made[amplitude])
            take(0.0094)
        take(0.5)
    assert set(made) <= set(arrived)
    # Beside other work the bridge waits, as its priority is lower than the sound's.
    within = 0.010 if os.getloadavg()[0] < 2 else 0.050
    assert np.percentile([arrived[each] - made[each] for each in made], 95) < within


def test_a_sink_gets_silence_when_the_commands_end(telemetry: Telemetry) -> None:
    (sink,) = open_sinks("senseglove", fingers=["index"])
    first, second = (sink.make({"index": 0.5}, beat).data for beat in (0, 1))
    assert first != second  # the driver drops a repeated value
    assert max(map(max, (first, second))) <= 50
    assert not any(sink.make({"index": 0.0}, 1).data)
    assert len(first) == 12


def test_a_plug_in_brings_gloves(monkeypatch: pytest.MonkeyPatch) -> None:
    from examples.plugins.tactophone_gloves import tactophone_gloves as gloves

    kinds = {"manus": gloves.manus, "haptx-left": gloves.haptx_left}
    monkeypatch.setattr(
        plugins,
        "load",
        lambda group, name: kinds.get(name) if group == plugins.ROS_SINKS else None,
    )
    amplitudes = {"thumb": 0.25, "little": 0.5}
    (manus,) = open_sinks("manus", fingers=list(amplitudes))
    assert list(manus.make(amplitudes, 0).intensities) == [0.25, 0, 0, 0, 0.5]
    (haptx,) = open_sinks("haptx-left", fingers=list(amplitudes))
    assert haptx.topic == "haptx/lh/tactor_group_state"
    assert (
        haptx.make(amplitudes, 0).tactor_group,
        haptx.make(amplitudes, 0).inflation,
    ) == (
        ["lh_th", "lh_lf"],
        [0.25, 0.5],
    )


@pytest.mark.parametrize(
    ("text", "finger"), [("gloves", "index"), ("senseglove", "toe")]
)
def test_an_unknown_device_or_finger_is_one_line(text: str, finger: str) -> None:
    with pytest.raises(ConfigError):
        open_sinks(text, fingers=[finger])


def test_a_topic_of_its_own_is_taken() -> None:
    assert (
        open_sinks("float32:/left/amplitude", fingers=["index"])[0].topic
        == "left/amplitude"
    )


def test_each_finger_of_a_hand_drives_its_own_place() -> None:
    amplitudes = {"thumb": 0.25, "little": 0.5}
    (sense,) = open_sinks("senseglove", fingers=list(amplitudes))
    assert sense.make(amplitudes, 0).data[5:10] == [25, 0, 0, 0, 50]
    (joy,) = open_sinks("joy", fingers=list(amplitudes))
    assert joy.make(amplitudes, 0).intensity == 0.5
    assert [
        sink.make(amplitudes, 0).data
        for sink in open_sinks("float32", fingers=list(amplitudes))
    ] == [0.25, 0.5]
    with pytest.raises(ConfigError, match="cannot share a topic"):
        open_sinks("float32:/one", fingers=list(amplitudes))


def test_a_wrong_domain_is_one_line(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "many")
    with pytest.raises(ConfigError, match="0 to 232"):
        RosBridge(telemetry.name)


def unreadable(*_: object, **__: object) -> None:
    """What the library raises where a text is no UTF-8, as any node may send it."""
    raise UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid start byte")


@pytest.mark.realtime
def test_a_message_that_cannot_be_read_ends_no_bridge_and_stops_all_the_same(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", URI)
    for kind in (messages.Empty, messages.JointState):
        monkeypatch.setattr(kind, "deserialize", unreadable)
    telemetry.update(RunState(role="robot"), now=time.monotonic())
    other = DdsTransport(DOMAIN + 2)
    stop = other.writer("tactophone/stop", messages.Empty)
    joints = other.writer("joint_states", messages.JointState)
    moved = messages.JointState(messages.header(0.0), ["wrist"], [0.0], [0.0], [0.0])
    asked: list[str] = []
    until = time.monotonic() + 20
    with RosBridge(telemetry.name, domain=DOMAIN + 2) as bridge:
        while not asked and time.monotonic() < until:
            joints.write(moved)
            stop.write(messages.Empty())
            bridge.read()
            asked += [request.action for request in telemetry.requests()]
            time.sleep(0.01)
    assert set(asked) == {"stop"}


@pytest.mark.realtime
@pytest.mark.parametrize("action", ["stop", "mute"])
@pytest.mark.parametrize("qos", [QOS, BEST_EFFORT], ids=["reliable", "best effort"])
def test_a_stop_is_heard_whatever_quality_its_publisher_offers(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch, qos: Qos, action: str
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", URI)
    node = DomainParticipant(DOMAIN + 3)
    topic = Topic(node, f"rt/tactophone/{action}", messages.Empty)
    writer = DataWriter(node, topic, qos=qos)
    asked: list[str] = []
    until = time.monotonic() + 20
    with RosBridge(telemetry.name, domain=DOMAIN + 3) as bridge:
        while not asked and time.monotonic() < until:
            writer.write(messages.Empty())
            bridge.read()
            asked += [request.action for request in telemetry.requests()]
            time.sleep(0.01)
    assert set(asked) == {action}


@pytest.mark.realtime
def test_microphones_on_a_topic_are_a_source(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", URI)
    tone = np.repeat(
        (0.25 * np.sin(np.arange(480) / 10)).astype(np.float32)[:, None], 2, axis=1
    )
    step = PipelineStep(AudioBlock(tone, 48_000), (), ())
    with RosBridge(telemetry.name, domain=DOMAIN + 1) as bridge:
        source = RosSource("/tactophone/index/audio", domain=DOMAIN + 1)
        assert (source.sample_rate, source.channels) == (48_000, 2)
        received: list[AudioBlock] = []
        for block in source:
            received.append(block)
            telemetry.publish(step, now=time.monotonic())
            bridge.read()
            if sum(each.size for each in received) >= 4_800 or len(received) > 2_000:
                break
    sound = np.concatenate([block.samples for block in received])
    assert len(sound) >= 4_800
    np.testing.assert_allclose(sound[:480], tone, atol=2e-4)
    assert all(a.end == b.start for a, b in itertools.pairwise(received))


def test_a_topic_in_another_format_is_one_line() -> None:
    from tactophone.faces.bridges import ros_topics as messages

    broken = RosSource.__new__(RosSource)
    broken._topic = "/audio"
    for info in (
        messages.AudioInfo(2, 48_000, "S16LE", 0, "mp3"),
        messages.AudioInfo(6, 48_000, "S16LE", 0, "wave"),
        messages.AudioInfo(1, 800, "S16LE", 0, "wave"),
    ):
        with pytest.raises(ConfigError, match="is needed"):
            broken._checked(info)


def test_a_source_is_named_with_its_topic() -> None:
    parser = argparse.ArgumentParser()
    options.add_settings(parser, "send")
    settings = options.settings_of(parser.parse_args(["--source", "ros:/audio"]))
    assert (settings.capture.source, settings.capture.device) == ("ros", "/audio")


def test_the_package_for_colcon_has_the_type_that_is_published() -> None:
    pytest.importorskip("rosbags")
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from tactophone.faces.bridges import ros_topics as messages
    from tactophone.live.log.reader import Passed

    name, text = (
        "tactophone_msgs/msg/Prediction",
        (PACKAGE / "msg/Prediction.msg").read_text(),
    )
    others = get_typestore(Stores.ROS2_HUMBLE)
    others.register(get_types_from_msg(text, name))
    assert others.hash_rihs01(name) == messages.open_type_store().hash_rihs01(name)
    passed = Passed(
        "thumb",
        STEP.predictions[0],
        STEP.commands[0],
        1e9 + 0.25,
        1e9 + 0.5,
        float("nan"),
        computed=0.5,
    )
    sent = messages.predicted(passed)["touch"]
    assert messages.type_name(type(sent)) == name
    read = others.deserialize_cdr(sent.serialize(), name)
    assert (read.header.stamp.sec, read.header.stamp.nanosec, read.header.frame_id) == (
        10**9,
        250_000_000,
        "thumb",
    )
    assert (read.made.nanosec, read.rendered.sec, read.touch, read.event) == (
        500_000_000,
        0,
        read.ROUGH,
        "",
    )
    assert list(read.probabilities) == pytest.approx([0.1, 0.2, 0.7])
    assert [read.roughness, read.level_dbfs, read.amplitude, read.frequency] == [
        0.75,
        -20,
        0.5,
        60,
    ]


def joints(time: float, **fields: list[float]) -> Any:
    names = [f"joint {place}" for place in range(max(map(len, fields.values())))]
    return messages.JointState(messages.header(time), names, **fields)


@pytest.mark.parametrize("known", ["velocity", "position"])
def test_a_robot_moves_while_a_joint_does(known: str) -> None:
    motion = JointMotion()
    moving = []
    place = 0.0
    for step, speed in enumerate((0.0, 0.005, 0.03, 0.015, 0.005, -0.5, 0.0)):
        place += 0.01 * speed
        motion.push(
            joints(
                1 + 0.01 * step,
                **{known: [0.0, speed if known == "velocity" else place]},
            )
        )
        moving.append(motion.moving)
    assert moving == [False, False, True, True, False, True, False]


def test_joint_states_of_parts_belong_to_one_robot_and_nonsense_moves_nothing() -> None:
    motion = JointMotion()
    motion.push(joints(1.0, velocity=[0.0, 0.0, 0.0, 0.1]))
    motion.push(joints(1.0, velocity=[0.0]))
    assert motion.moving
    motion.push(joints(1.1, velocity=[math.nan] * 4, position=[math.inf] * 9))
    motion.push(joints(1.1, velocity=[], position=[math.inf] * 9))
    assert not motion.moving
    for number in range(2 * MOST_JOINTS):
        motion.push(
            messages.JointState(
                messages.header(2.0), [str(number)], velocity=[0.0], position=[1.0]
            )
        )
    assert len(motion._speeds) <= MOST_JOINTS


class Sent:
    """A transport whose topics hold what a test puts there."""

    def __init__(self) -> None:
        self.waiting: dict[str, list[Any]] = {}

    def writer(self, *_: Any, **__: Any) -> Any:
        return SimpleNamespace(write=lambda message: None)

    def reader(self, topic: str, *_: Any, **__: Any) -> Any:
        def take(N: int) -> list[Any]:
            return self.waiting.pop(topic, [])

        return SimpleNamespace(take=take)

    def close(self) -> None:
        pass


@pytest.mark.parametrize("role", ["robot", "operator"])
def test_joint_states_tell_the_robots_side_alone_when_it_moves(
    role: str, telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    transport = Sent()
    monkeypatch.setattr(
        "tactophone.faces.bridges.ros.DdsTransport", lambda domain: transport
    )
    telemetry.update(RunState(role=role), now=time.monotonic())
    asked: list[tuple[str, float]] = []
    with RosBridge(telemetry.name, domain=DOMAIN) as bridge:
        for speed in (0.0, 0.2, 0.2, 0.0):
            transport.waiting["joint_states"] = [
                object(),
                joints(1.0, velocity=[speed]),
            ]
            bridge.read()
            asked += [
                (request.action, request.value) for request in telemetry.requests()
            ]
    assert asked == ([("moving", 1.0), ("moving", 0.0)] if role == "robot" else [])


def test_joints_of_strangers_hold_no_bridge_up(
    telemetry: Telemetry, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An operator's, which may drive a glove, reads none at all; a robot's takes as
    many as fit its interval."""
    many = joints(1.0, velocity=[1.0] * (MOST_JOINTS + 1))
    taken = 0

    def take(N: int) -> list[Any]:
        nonlocal taken
        taken += 1
        time.sleep(2 * ROS_INTERVAL)  # as long as a large message takes
        return [many] * N

    transport = Sent()
    transport.reader = lambda topic, *_, **__: SimpleNamespace(  # type: ignore[method-assign]
        take=take if topic == "joint_states" else lambda N: []
    )
    monkeypatch.setattr(
        "tactophone.faces.bridges.ros.DdsTransport", lambda domain: transport
    )
    for role, most in (("operator", 0), ("robot", 1)):
        telemetry.update(RunState(role=role), now=time.monotonic())
        with RosBridge(telemetry.name, domain=DOMAIN) as bridge:
            bridge.read()
        assert taken == most
    assert not telemetry.requests()


WRITER = """
import sys, time
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from tactophone.faces.bridges import ros_topics as messages
from tactophone.faces.bridges.ros import QOS
domain = DomainParticipant(int(sys.argv[1]))
topic = Topic(domain, "rt/sizes", messages.AudioDataStamped, QOS)
writer = DataWriter(domain, topic)
while True:
    for size in (2 * messages.LARGEST_SAMPLE, 1000):
        sound = messages.AudioData(data=[0] * size)
        writer.write(messages.AudioDataStamped(messages.header(1.0), sound))
    time.sleep(0.1)
"""


@pytest.mark.realtime
def test_a_message_that_would_take_all_memory_is_dropped_unread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", URI)
    reader = DdsTransport(DOMAIN + 3).reader("sizes", messages.AudioDataStamped)
    sender = subprocess.Popen([sys.executable, "-c", WRITER, str(DOMAIN + 3)])
    try:
        sizes = set[int]()
        until = time.monotonic() + 30
        count = 0
        while count < 5 and time.monotonic() < until:
            found = reader.take(N=1)
            count += len(found)
            sizes |= {len(each.audio.data) for each in found if hasattr(each, "audio")}
            time.sleep(0.01)
    finally:
        sender.kill()
        sender.wait()
    assert sizes == {1000}


@pytest.mark.parametrize("now", [math.nan, math.inf, -1.0, 2.0**31, 1e300])
def test_a_time_that_ros_has_no_number_for_ends_no_bridge(now: float) -> None:
    """As of a machine whose clock is set beyond 2038."""
    assert messages.header(now).serialize() == messages.header(0.0).serialize()


def test_a_message_of_sound_that_claims_minutes_is_dropped() -> None:
    """The robot would wait for as long, and send nothing."""
    source = RosSource.__new__(RosSource)
    source.faults = Counter()
    source.sample_rate, source.channels = 2_000, 1
    for size, dropped in ((4_000, False), (4_002, True), (1_000_000, True)):
        message = messages.AudioDataStamped(
            messages.header(1.0), messages.AudioData(data=[0] * size)
        )
        assert (len(source._samples(message)) == 0) == dropped
    assert source.faults["odd size"] == 2


def test_a_writer_tells_the_hash_of_its_type_as_ros_2_looks_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    from cyclonedds.core import Policy

    from tactophone.faces.bridges import ros, ros_topics

    monkeypatch.setenv("CYCLONEDDS_URI", URI)
    writer = ros.DdsTransport(DOMAIN + 2).writer(
        "tactophone/index/roughness", ros_topics.Float32, latched=True
    )
    # As ROS 2 itself computes it.
    hashed = "RIHS01_7170d3d8f841f7be3172ce5f4f59f3a4d7f63b0447e8b33327601ad64d83d6e2"
    assert (
        bytes(writer.get_qos()[Policy.Userdata].data) == f"typehash={hashed};".encode()
    )
    assert writer.get_qos()[Policy.Durability] == Policy.Durability.TransientLocal
