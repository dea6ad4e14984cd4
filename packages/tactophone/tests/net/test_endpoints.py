import math
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from msgspec.structs import replace

from benchmarks.virtual_link import VirtualLink, paired_sessions
from tactophone.core.errors import ModelError
from tactophone.core.types import AudioBlock, HapticCommand, PipelineStep, Touch
from tactophone.net.endpoints import OperatorEndpoint, RobotEndpoint
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.events import Connected
from tactophone.net.link.receive import ReceiveEvent, ReceiveSession
from tactophone.net.link.send import Datagrams
from tactophone.net.link.stream import DecodedAudio
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.perception.fallback import FallbackDetector
from tactophone.signal.pipeline import Pipeline, open_pipeline
from tests.models import write_tiny_model
from tests.sounds import blocks, noise, strokes

RATE = 48_000


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(write_tiny_model(tmp_path / "tiny.onnx"))


def pipeline_of(model: str) -> Pipeline:
    return open_pipeline(model, sample_rate=RATE, channels=1)


def journey(
    model: str,
    *,
    lost: Iterator[bool] | None = None,
    send_predictions: bool = False,
    moving: Callable[[float], bool] = lambda time: False,
) -> list[tuple[float, PipelineStep]]:
    """Strokes from the robot's fingertip to the operator's, in virtual time; each step
    with the time of its arrival."""
    robot, operator = paired_sessions(Codec("pcm16", channels=1, packet_size=120))
    detectors = [pipeline_of(model).detector] if send_predictions else []
    sender = RobotEndpoint(robot, detectors)
    link = VirtualLink(robot, OperatorEndpoint(operator, pipeline_of(model)))
    begun = now = link.connect(0.0)
    link.to_operator = ImpairedLink(NetworkProfile(), lost=lost)
    steps = []
    for block in blocks(strokes(), 120):
        now = begun + block.end / RATE
        sender.push(replace(block, moving=moving(block.time)))
        steps += [(now - begun, step) for _, step in link.carry(now) if step]
    return steps


def commands_of(
    steps: list[tuple[float, PipelineStep]],
) -> list[tuple[float, HapticCommand]]:
    return [(when, command) for when, step in steps for command in step.commands]


def touch_at(steps: list[tuple[float, PipelineStep]], time: float) -> Touch:
    return [
        prediction.touch
        for when, step in steps
        for prediction in step.predictions
        if when <= time
    ][-1]


@pytest.mark.parametrize("send_predictions", [False, True], ids=["sound", "prediction"])
def test_a_stroke_is_rendered_at_the_other_end(
    model: str, send_predictions: bool
) -> None:
    steps = journey(model, send_predictions=send_predictions)
    assert [touch_at(steps, time) for time in (0.4, 0.95, 1.3, 1.9)] == [
        Touch.NONE,
        Touch.ROUGH,
        Touch.NONE,
        Touch.SMOOTH,
    ]
    first = next(when for when, command in commands_of(steps) if command.amplitude > 0)
    assert first == pytest.approx(0.503, abs=0.006)


def test_without_loss_the_link_changes_nothing(model: str) -> None:
    pipeline = pipeline_of(model)
    direct = [
        command
        for block in blocks(strokes(), 120)
        for command in pipeline.push(block).commands
    ]
    over_the_link = [command for _, command in commands_of(journey(model))]
    # The link rounds the sound to 16 bits, and may keep a last packet.
    assert len(direct) - len(over_the_link) in range(3)
    for here, there in zip(direct, over_the_link, strict=False):
        assert (here.amplitude, here.frequency) == pytest.approx(
            (there.amplitude, there.frequency), abs=0.2
        )


@pytest.mark.parametrize("every", [20, 5])
def test_loss_does_not_change_the_touch(model: str, every: int) -> None:
    steps = journey(model, lost=cycle([False] * (every - 1) + [True]))
    assert [touch_at(steps, time) for time in (0.4, 0.95, 1.3, 1.9)] == [
        Touch.NONE,
        Touch.ROUGH,
        Touch.NONE,
        Touch.SMOOTH,
    ]


@pytest.mark.parametrize("send_predictions", [False, True], ids=["sound", "prediction"])
def test_late_sound_is_not_rendered_but_still_detected(
    model: str, send_predictions: bool
) -> None:
    robot, operator = paired_sessions(Codec("pcm16", channels=1, packet_size=120))
    link = VirtualLink(robot, OperatorEndpoint(operator, pipeline_of(model)))
    detectors = [pipeline_of(model).detector] if send_predictions else []
    sender = RobotEndpoint(robot, detectors)
    begun = link.connect(0.0)
    stalled: list[PipelineStep] = []
    after: list[PipelineStep] = []
    for block in blocks(strokes(), 120):
        sender.push(block)
        if 0.7 < block.time < 0.9:
            continue  # the link holds everything back for 200 ms
        steps = [step for _, step in link.carry(begun + block.end / RATE) if step]
        (after if block.time >= 0.9 else stalled).extend(steps)
    old = [step for step in after if step.block.time < 0.83]
    assert old
    assert not any(step.commands for step in old)
    now = [
        prediction
        for step in after
        if 0.9 < step.block.time < 0.92
        for prediction in step.predictions
    ]
    assert {prediction.touch for prediction in now} == {Touch.ROUGH}


def test_a_robot_that_connects_anew_is_not_heard_with_the_sound_of_the_one_before(
    model: str,
) -> None:
    """It may come within the time across which a detector joins what was lost."""

    def levels(*, after_another: bool) -> list[float]:
        robot, operator = paired_sessions(Codec("pcm16", channels=1, packet_size=120))
        endpoint = OperatorEndpoint(operator, pipeline_of(model))
        link = VirtualLink(robot, endpoint)
        now = link.connect(0.0)
        if after_another:
            for block in blocks(noise(level_dbfs=-6, duration=0.3, channels=1), 120):
                robot.push(block)
                link.carry(now + block.end / RATE)
            now += 0.3
            robot.members[0].session.hang_up("its wearer goes home")
            link.carry(now)
            now = link.connect(now)
        found = []
        for block in blocks(noise(duration=0.3, channels=1, seed=1), 120):
            robot.push(block)
            for _, step in link.carry(now + block.end / RATE):
                found += list(step.predictions) if step else []
        # How many windows there are before one is full depends on the phase of packets.
        heard = [prediction.level_dbfs for prediction in found]
        return [level for level in heard if level > -math.inf]

    fresh = levels(after_another=False)
    assert len(fresh) >= 4
    assert levels(after_another=True)[:4] == pytest.approx(fresh[:4], abs=1.0)


def test_a_robot_with_other_microphones_gets_its_own_pipeline_under_the_same_ceiling(
    model: str,
) -> None:
    robot, operator = paired_sessions(Codec("pcm16", channels=1, packet_size=120))
    opened: list[int] = []

    def reopen(channels: int) -> Pipeline:
        opened.append(channels)
        return pipeline_of(model)

    endpoint = OperatorEndpoint(operator, pipeline_of(model), reopen=reopen)
    endpoint.pipeline.limits = Limits(ceiling=0.1)
    link = VirtualLink(robot, endpoint)
    begun = link.connect(0.0)
    for block in blocks(noise(duration=0.1, channels=1), 120):
        robot.push(block)
        link.carry(begun + block.end / RATE)
    assert opened == [1]
    assert endpoint.pipeline.limits.ceiling == 0.1


def test_a_robot_whose_sound_the_model_cannot_use_is_refused_in_words_on_both_ends(
    model: str,
) -> None:
    robot, operator = paired_sessions(Codec("pcm16", channels=1, packet_size=120))

    def reopen(channels: int) -> Pipeline:
        raise ModelError("the model needs contact and air; choose a one-channel model")

    endpoint = OperatorEndpoint(operator, pipeline_of(model), reopen=reopen)
    link = VirtualLink(robot, endpoint)
    begun = link.connect(0.0)
    steps = []
    for block in blocks(noise(duration=0.05, channels=1), 120):
        robot.push(block)
        steps += [step for _, step in link.carry(begun + block.end / RATE)]
    assert steps
    assert not any(steps)
    assert "one-channel model" in endpoint.refusal
    operator.session.hang_up(endpoint.refusal)
    link.carry(begun + 0.1)
    assert robot.members[0].session.failure
    assert "one-channel model" in robot.members[0].session.failure


@pytest.mark.slow
@pytest.mark.parametrize("send_predictions", [False, True], ids=["sound", "prediction"])
def test_a_robot_that_starts_to_move_is_felt_150_ms_later_at_the_other_end(
    model: str, send_predictions: bool
) -> None:
    def begins(start: float) -> float:
        steps = journey(
            model, send_predictions=send_predictions, moving=lambda time: time >= start
        )
        return next(
            when for when, command in commands_of(steps) if command.amplitude > 0
        )

    assert begins(0.4) - begins(9.0) == pytest.approx(0.15, abs=0.02)


class GivenSession:
    """A session that reports what the test puts into ``events``."""

    def __init__(self) -> None:
        self.events: list[ReceiveEvent] = []

    def receive(self, datagrams: Datagrams, *, now: float) -> list[ReceiveEvent]:
        return self.events


@pytest.mark.parametrize(("caller", "known"), [("robot", True), ("another", False)])
def test_a_robot_that_comes_back_has_the_microphones_that_it_had(
    caller: str, known: bool
) -> None:
    session = GivenSession()
    operator = OperatorEndpoint(
        cast(ReceiveSession, session), open_pipeline(sample_rate=RATE, channels=2)
    )
    time = np.arange(2 * RATE) / RATE
    hum = 0.5 * np.sin(2 * np.pi * 50 * time)
    air = np.random.default_rng(0).normal(0, 1e-3, len(time))
    sound = AudioBlock(np.stack((hum, air), axis=1).astype(np.float32), RATE)
    later = AudioBlock(sound.samples[:480], RATE, 10 * RATE)
    session.events = [Connected("robot", 1, 2), DecodedAudio(sound)]
    list(operator.receive([], now=0.0))
    session.events = [Connected(caller, 3, 4), DecodedAudio(later)]
    list(operator.receive([], now=10.0))
    detector = operator.pipeline.detector
    assert isinstance(detector, FallbackDetector)
    found = [fault.code for fault in detector.sensor_faults]
    assert found == (["contact-hum"] if known else [])
