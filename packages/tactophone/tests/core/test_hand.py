"""Several fingers are what each of them is alone: through the pipelines, over the link,
with loss."""

from collections.abc import Iterator
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.virtual_link import VirtualLink, paired_sessions
from tactophone.core.types import AudioBlock, FloatArray, PipelineStep
from tactophone.net.endpoints import OperatorEndpoint, RobotEndpoint
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.signal.pipeline import Hand, Pipeline, open_pipeline
from tests.models import write_tiny_model
from tests.sounds import ODD_SIZES, blocks, noise, strokes

RATE = 48_000


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(write_tiny_model(tmp_path / "tiny.onnx"))


def pipeline_of(model: str) -> Pipeline:
    return open_pipeline(model, sample_rate=RATE, channels=2)


def sound_of(fingers: int, *, duration: float = 1.0) -> FloatArray:
    """Strokes that begin at another time at each finger, with a little air."""
    contact = strokes()[:, 0]
    parts = [np.roll(contact, 4800 * finger) for finger in range(fingers)]
    samples = np.stack(
        [part for contact in parts for part in (contact, 0.1 * contact)], axis=1
    )
    return np.ascontiguousarray(
        samples[RATE // 4 : RATE // 4 + round(duration * RATE)], np.float32
    )


def alone(pipeline: Pipeline, samples: FloatArray, size: int) -> list[object]:
    found: list[object] = []
    for block in blocks(np.ascontiguousarray(samples), size):
        step = pipeline.push(block)
        found += zip(step.predictions, step.commands, strict=True)
    return found


def of_finger(steps: list[PipelineStep], finger: int) -> list[object]:
    mine = [step for step in steps if step.finger == finger]
    return [
        pair
        for step in mine
        for pair in zip(step.predictions, step.commands, strict=True)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fingers", "size"), [(1, 240), (2, ODD_SIZES[0]), (5, 240), (10, 128)]
)
@pytest.mark.parametrize("name", ["tiny", "texture"])
def test_each_finger_computes_what_it_computes_alone(
    model: str, name: str, fingers: int, size: int
) -> None:
    chosen = model if name == "tiny" else name
    samples = sound_of(fingers, duration=1.0 if name == "tiny" else 0.6)
    hand = Hand([pipeline_of(chosen) for _ in range(fingers)])
    steps = [step for block in blocks(samples, size) for step in hand.push(block)]
    for finger in range(fingers):
        expected = alone(
            pipeline_of(chosen), samples[:, 2 * finger : 2 * finger + 2], size
        )
        assert expected
        # What several fingers compute in one batch differs from what each computes
        # alone by its last bits.
        assert flat(of_finger(steps, finger)) == pytest.approx(
            flat(expected), abs=1e-5 if name == "texture" else 0
        )


def flat(pairs: list[Any]) -> list[float]:
    """Return the numbers of predictions and commands."""
    return [
        number
        for prediction, command in pairs
        for number in (
            *prediction.probabilities,
            prediction.touch,
            prediction.roughness,
            prediction.level_dbfs,
            prediction.end,
            command.amplitude,
            command.frequency,
            command.time,
        )
    ]


def test_fingers_without_air_or_with_broken_sound_leave_the_others_alone(
    model: str,
) -> None:
    samples = sound_of(3)
    samples[:, 2] = np.nan
    hand = Hand([pipeline_of(model) for _ in range(3)], channels=[2, 2, 1])
    steps = [step for block in blocks(samples, 240) for step in hand.push(block)]
    assert of_finger(steps, 0) == alone(pipeline_of(model), samples[:, :2], 240)
    assert of_finger(steps, 2) == alone(pipeline_of(model), samples[:, 4:5], 240)
    silent = [step.command for step in steps if step.finger == 1 and step.command]
    assert silent
    assert not any(command.amplitude for command in silent)
    assert hand.pipelines[1].detector.faults["sound"] > 0
    assert not hand.pipelines[0].detector.faults


def test_sound_of_another_number_of_fingers_raises(model: str) -> None:
    hand = Hand([pipeline_of(model)] * 3)
    with pytest.raises(ValueError, match="4 channels, but 3 fingers have 6"):
        list(hand.push(AudioBlock(noise(duration=0.01, channels=4), RATE)))


def journey(
    model: str,
    fingers: int,
    *,
    codec: Codec,
    lost: Iterator[bool] | None = None,
    send_predictions: bool = False,
) -> list[PipelineStep]:
    robot, operator = paired_sessions(codec)
    detectors = (
        [pipeline_of(model).detector for _ in range(fingers)]
        if send_predictions
        else []
    )
    sender = RobotEndpoint(robot, detectors, channels=[2] * fingers)
    link = VirtualLink(
        robot,
        OperatorEndpoint(operator, Hand([pipeline_of(model) for _ in range(fingers)])),
    )
    begun = link.connect(0.0)
    link.to_operator = ImpairedLink(NetworkProfile(), lost=lost)
    steps = []
    for block in blocks(sound_of(fingers), codec.packet_size):
        sender.push(block)
        steps += [step for _, step in link.carry(begun + block.end / RATE) if step]
    return steps


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [2, 5, 10])
def test_the_link_carries_all_fingers_as_it_carries_one(
    model: str, fingers: int
) -> None:
    codec = Codec("pcm16", channels=2 * fingers, packet_size=24)
    steps = journey(model, fingers, codec=codec)
    rounded = np.rint(sound_of(fingers) * 32_768).astype(np.float32) / np.float32(
        32_768
    )
    for finger in range(fingers):
        expected = alone(
            pipeline_of(model), rounded[:, 2 * finger : 2 * finger + 2], 24
        )
        found = of_finger(steps, finger)
        assert len(expected) - len(found) in range(3)  # the link may keep a last packet
        assert found == expected[: len(found)]


def test_loss_hides_no_finger_more_than_another(model: str) -> None:
    lost = cycle([False] * 6 + [True])
    steps = journey(
        model, 3, codec=Codec("opus", channels=6, packet_size=120), lost=lost
    )
    concealed = [
        [
            step.block.start
            for step in steps
            if step.finger == k and step.block.concealed
        ]
        for k in range(3)
    ]
    assert concealed[0] == concealed[1] == concealed[2]
    sizes = {step.block.size for step in steps}
    # A packet that leads to nothing waits for others, until a window of 512 samples may
    # be due.
    assert 120 < max(sizes) <= 600
    assert all(size % 120 == 0 for size in sizes)


def test_predictions_of_a_hand_travel_together(model: str) -> None:
    steps = journey(model, 5, codec=Codec(channels=10), send_predictions=True)
    for finger in range(5):
        pipeline = pipeline_of(model)
        expected = [
            (round(each.end * RATE), each.touch)
            for block in blocks(
                np.ascontiguousarray(sound_of(5)[:, 2 * finger : 2 * finger + 2]), 240
            )
            for each in pipeline.push(block).predictions
        ]
        found = [
            (round(p.end * RATE), p.touch)
            for step in steps
            if step.finger == finger
            for p in step.predictions
        ]
        # The operator counts from the first prediction that it got. Where two windows
        # end at one sample, it keeps one.
        begun = expected[0][0] - found[0][0]
        assert {(end + begun, touch) for end, touch in found} <= set(expected)
        assert len(found) >= len(expected) - 5


def test_predictions_of_a_hand_of_one_finger_arrive(model: str) -> None:
    assert any(
        step.predictions
        for step in journey(model, 1, codec=Codec(channels=2), send_predictions=True)
    )


@pytest.mark.slow
@pytest.mark.parametrize(("robot_has", "operator_has"), [(5, 1), (1, 5), (2, 5)])
@pytest.mark.parametrize("send_predictions", [False, True])
def test_an_operator_with_another_number_of_fingers_refuses_in_words(
    model: str, robot_has: int, operator_has: int, send_predictions: bool
) -> None:
    robot, operator = paired_sessions(
        Codec("pcm16", channels=2 * robot_has, packet_size=40)
    )
    detectors = (
        [pipeline_of(model).detector for _ in range(robot_has)]
        if send_predictions
        else []
    )
    sender = RobotEndpoint(
        robot, detectors, channels=[2] * robot_has if robot_has > 1 else ()
    )
    endpoint = OperatorEndpoint(
        operator, Hand([pipeline_of(model) for _ in range(operator_has)])
    )
    link = VirtualLink(robot, endpoint)
    begun = link.connect(0.0)
    steps = []
    for block in blocks(sound_of(robot_has, duration=0.5), 40):
        sender.push(block)
        steps += [step for _, step in link.carry(begun + block.end / RATE)]
    assert steps
    assert not any(steps)
    assert f"the robot has {robot_has} finger" in endpoint.refusal
    operator.session.hang_up(endpoint.refusal)
    link.carry(begun + 1)
    assert robot.members[0].session.failure
    assert (
        f"this operator {operator_has}: give both ends the same --fingers"
        in robot.members[0].session.failure
    )
