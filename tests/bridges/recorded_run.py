"""A run in virtual time, recorded: the operator's end over an impaired link, with its log."""

import uuid
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tactophone import config
from tactophone.bridges import McapLog
from tactophone.config import Settings
from tactophone.endpoints import EventStep, OperatorEndpoint, RobotEndpoint
from tactophone.link import Address, Codec, Datagrams
from tactophone.runtime import OutputGate, SessionRecorder, open_pipeline_for
from tactophone.simulation.network import ImpairedLink, NetworkProfile, VirtualLink, paired_sessions
from tactophone.telemetry import Telemetry
from tactophone.types import AudioBlock
from tests.sounds import blocks, strokes

RATE = 48_000


class RecordedOperator:
    """An operator's endpoint that logs and publishes as `runtime.Operator` does."""

    def __init__(self, endpoint: OperatorEndpoint, telemetry: Telemetry, settings: Settings) -> None:
        self.endpoint, self.gate = endpoint, OutputGate(ceiling=settings.rendering.ceiling)
        self._telemetry = telemetry
        self.recorder = SessionRecorder(telemetry, settings, role="operator")
        endpoint.session.tap = self.recorder.arrival

    @property
    def peer(self) -> str | None:
        return self.endpoint.peer

    def receive(self, datagrams: Datagrams, *, now: float) -> Iterable[EventStep]:
        self.recorder.controls(*self.controls())
        return list(self._published(self.endpoint.receive(datagrams, now=now), now))

    def poll(self, now: float) -> Iterable[EventStep]:
        self.recorder.controls(*self.controls())
        return list(self._published(self.endpoint.poll(now), now))

    def outgoing(self) -> list[tuple[bytes, Address]]:
        return self.endpoint.outgoing()

    def controls(self) -> tuple[bool, float, float, float, str, float | None]:
        pipeline, gate = self.endpoint.pipeline, self.gate
        return (
            gate.armed, gate.ceiling, gate.output_level, pipeline.limits.ceiling, pipeline.profile.name,
            None if pipeline.follows_floor else pipeline.threshold_dbfs,
        )  # fmt: skip

    def _published(self, steps: Iterable[EventStep], now: float) -> Iterator[EventStep]:
        for event, step in steps:
            if step is not None:
                bounded = tuple(replace(each, amplitude=self.gate.bound(each.amplitude)) for each in step.commands)
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
) -> Path:
    """Record strokes that cross the link; ``meanwhile`` is called before each block, with the time of the sound."""
    codec = codec or Codec("pcm16", channels=1, packet_size=120)
    switches = ["detector.check_microphones=false", f"detector.model={model}", *changes]
    settings = config.change(Settings(), switches)
    robot, session = paired_sessions(codec)

    def reopen(channels: int):  # type: ignore[no-untyped-def]
        return open_pipeline_for(settings, channels=channels)

    name = f"test-{uuid.uuid4().hex[:8]}"
    with Telemetry(name) as telemetry:
        operator = RecordedOperator(OperatorEndpoint(session, reopen(2), reopen=reopen), telemetry, settings)
        detector = reopen(codec.channels).detector if remote else None
        sender = RobotEndpoint(robot, detector)
        with McapLog(name, path) as log:
            link = VirtualLink(robot, operator)
            begun = link.connect(0.0)
            link.to_operator = ImpairedLink(network or NetworkProfile(), lost=lost)
            for number, block in enumerate(sound or blocks(np.repeat(strokes(), codec.channels, axis=1), 120)):
                meanwhile(operator, block.time)
                sender.push(block)
                link.carry(begun + block.end / RATE)
                if number % 80 == 0:
                    log.read()
            log.read()
    return path
