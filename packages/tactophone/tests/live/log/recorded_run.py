"""A run in virtual time, recorded: the operator's end over an impaired link, with its
log."""

import itertools
import uuid
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.virtual_link import VirtualLink, paired_sessions
from tactophone.app.logged_run import _without_gaps, decoded_blocks
from tactophone.core.hand import channels_of, each_finger, with_fingers
from tactophone.core.settings import Settings, change
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.live.log.mcap import LogEntry, McapLog
from tactophone.live.runtime.output_gate import OutputGate
from tactophone.live.runtime.recorder import SessionRecorder
from tactophone.live.telemetry.records import ARRIVAL_DIGITS
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.endpoints import EventStep, OperatorEndpoint, RobotEndpoint
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.send import Datagrams
from tactophone.signal.pipeline import Hand, open_pipeline_for
from tests.sounds import blocks, strokes

RATE = 48_000


class RecordedOperator:
    """An operator's endpoint that logs and publishes as `runtime.Operator` does."""

    def __init__(
        self, endpoint: OperatorEndpoint, telemetry: Telemetry, settings: Settings
    ) -> None:
        self.endpoint = endpoint
        self.gates = [
            OutputGate(pipeline.limits) for pipeline in endpoint.hand.pipelines
        ]
        self.gate = self.gates[0]
        self._telemetry = telemetry
        self.run = telemetry.name
        self.recorder = SessionRecorder(telemetry, settings, role="operator")
        endpoint.session.tap = self.recorder.arrival

    @property
    def session(self) -> ReceiveSession:
        return self.endpoint.session

    def receive(self, datagrams: Datagrams, *, now: float) -> Iterable[EventStep]:
        self.log_controls()
        return list(self._published(self.endpoint.receive(datagrams, now=now), now))

    def poll(self, now: float) -> Iterable[EventStep]:
        self.log_controls()
        return list(self._published(self.endpoint.poll(now), now))

    def log_controls(self) -> None:
        for finger, (pipeline, gate) in enumerate(
            zip(self.endpoint.hand.pipelines, self.gates, strict=True)
        ):
            self.recorder.controls(
                gate.armed,
                gate.limits.ceiling,
                gate.output_level,
                pipeline.profile.name,
                None
                if pipeline.detector.threshold.follows_floor
                else pipeline.detector.threshold.dbfs,
                finger=finger,
            )

    def _published(self, steps: Iterable[EventStep], now: float) -> Iterator[EventStep]:
        for event, step in steps:
            if step is not None:
                bound = self.gates[step.finger].bound
                bounded = tuple(
                    replace(each, amplitude=bound(each.amplitude))
                    for each in step.commands
                )
                self._telemetry.publish(replace(step, commands=bounded), now=now)
            yield event, step
        self.recorder.write()


def record(
    path: Path,
    model: Path,
    *changes: str,
    codec: Codec | None = None,
    lost: Iterator[bool] | None = None,
    network: NetworkProfile | None = None,
    sound: Iterable[AudioBlock] | None = None,
    meanwhile: Callable[[RecordedOperator, float], None] = lambda operator, now: None,
    remote: bool = False,
    fingers: str = "",
) -> Path:
    """Record strokes that cross the link; ``meanwhile`` is called before each block,
    with the time of the sound.

    ``fingers`` is what the command line's ``--fingers`` takes; the sound then has as
    many channels as the hand.
    """
    codec = codec or Codec("pcm16", channels=1, packet_size=120)
    switches = ["detector.check_microphones=false", f"detector.model={model}", *changes]
    settings = change(Settings(), switches)
    settings = with_fingers(settings, fingers) if fingers else settings
    hand = each_finger(settings) if fingers else []
    robot, session = paired_sessions(codec)

    def reopen(channels: int):  # type: ignore[no-untyped-def]
        return open_pipeline_for(settings, channels=channels)

    name = f"test-{uuid.uuid4().hex[:8]}"
    with Telemetry(name, fingers=max(1, len(hand))) as telemetry:
        channels = channels_of(settings, alone=codec.channels)
        endpoint = OperatorEndpoint(session, reopen(2), reopen=reopen)
        if hand:
            opened = [
                open_pipeline_for(own, channels=count)
                for own, count in zip(hand, channels, strict=True)
            ]
            endpoint = OperatorEndpoint(session, Hand(opened, channels=channels))
        operator = RecordedOperator(endpoint, telemetry, settings)
        detectors = [reopen(count).detector for count in channels] if remote else []
        sender = RobotEndpoint(robot, detectors, channels=channels if hand else ())
        with McapLog(name, path) as log:
            link = VirtualLink(robot, operator)
            begun = link.connect(0.0)
            link.to_operator = ImpairedLink(network or NetworkProfile(), lost=lost)
            for number, block in enumerate(
                sound or blocks(np.repeat(strokes(), codec.channels, axis=1), 120)
            ):
                meanwhile(operator, block.time)
                sender.push(block)
                link.carry(round(begun + block.end / RATE, ARRIVAL_DIGITS))
                if number % 80 == 0:
                    log.read()
            log.read()
    return path


def messages(path: Path, topic: str) -> list[bytes]:
    """Content of a topic's messages."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return [
            message.data
            for _, channel, message in make_reader(file).iter_messages(topics=[topic])
        ]


def decoded(path: Path, topic: str) -> list[Any]:
    """Messages of a topic, decoded by the library of protobuf with the schema in the
    file."""
    from mcap.reader import make_reader

    descriptor_pb2 = pytest.importorskip("google.protobuf.descriptor_pb2")
    descriptor_pool = pytest.importorskip("google.protobuf.descriptor_pool")
    factory = pytest.importorskip("google.protobuf.message_factory")
    with path.open("rb") as file:
        found = list(make_reader(file).iter_messages(topics=[topic]))
    pool, schema = descriptor_pool.DescriptorPool(), found[0][0]
    for described in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
        pool.Add(described)
    kind = factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    return [kind.FromString(message.data) for _, _, message in found]


def decoded_sessions(entries: Iterable[LogEntry]) -> list[list[AudioBlock]]:
    """Return the blocks of each session of a log."""
    grouped = itertools.groupby(decoded_blocks(entries), key=lambda each: each[0])
    return [[block for _, block in group] for _, group in grouped]


def joined(blocks: Iterable[AudioBlock]) -> FloatArray:
    return np.concatenate(list(_without_gaps(blocks)))
