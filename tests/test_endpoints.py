from collections.abc import Iterator
from itertools import cycle
from pathlib import Path

import pytest

from tactophone.endpoints import OperatorEndpoint, Pipeline, RobotEndpoint, open_pipeline
from tactophone.link import Codec
from tactophone.simulation.network.impairments import ImpairedLine, NetworkProfile
from tactophone.simulation.network.virtual_link import VirtualLine, paired_ends
from tactophone.types import HapticCommand, PipelineStep, Touch
from tests.models import write_tiny_model
from tests.sounds import blocks, strokes

RATE = 48_000


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(write_tiny_model(tmp_path / "tiny.onnx"))


def walk_of(model: str) -> Pipeline:
    return open_pipeline(model, sample_rate=RATE, channels=1)


def journey(model: str, *, lost: Iterator[bool] | None = None, judge: bool = False) -> list[tuple[float, PipelineStep]]:
    """Strokes from the robot's fingertip to the operator's, in virtual time; each tick with when it came."""
    robot, operator = paired_ends(Codec("pcm16", channels=1, packet_size=120))
    line = VirtualLine(robot, operator)
    sender = RobotEndpoint(robot, walk_of(model).judge if judge else None)
    receiver = OperatorEndpoint(operator, walk_of(model))
    begun = now = line.connect(0.0)
    line.there = ImpairedLine(NetworkProfile(), lost=lost)
    ticks = []
    for block in blocks(strokes(), 120):
        now = begun + block.end / RATE
        sender.push(block)
        ticks += [(now - begun, tick) for news in line.carry(now) if (tick := receiver.take(news))]
    return ticks


def felt(ticks: list[tuple[float, PipelineStep]]) -> list[tuple[float, HapticCommand]]:
    return [(when, command) for when, tick in ticks for command in tick.commands]


def touch_at(ticks: list[tuple[float, PipelineStep]], time: float) -> Touch:
    return [belief.touch for when, tick in ticks for belief in tick.predictions if when <= time][-1]


@pytest.mark.parametrize("judge", [False, True], ids=["sound", "belief"])
def test_a_stroke_is_felt_at_the_other_end(model: str, judge: bool) -> None:
    ticks = journey(model, judge=judge)
    assert [touch_at(ticks, time) for time in (0.4, 0.95, 1.3, 1.9)] == [
        Touch.NONE,
        Touch.ROUGH,
        Touch.NONE,
        Touch.SMOOTH,
    ]
    first = next(when for when, command in felt(ticks) if command.amplitude > 0)
    assert first == pytest.approx(0.503, abs=0.006)


def test_without_loss_the_line_changes_nothing(model: str) -> None:
    walk = walk_of(model)
    direct = [command for block in blocks(strokes(), 120) for command in walk.push(block).commands]
    over_the_line = [command for _, command in felt(journey(model))]
    # The line rounds the sound to 16 bits, and may keep a last packet.
    assert len(direct) - len(over_the_line) in range(3)
    for one, other in zip(direct, over_the_line, strict=False):
        assert (one.amplitude, one.frequency) == pytest.approx((other.amplitude, other.frequency), abs=0.2)


@pytest.mark.parametrize("every", [20, 5])
def test_loss_does_not_change_what_is_felt(model: str, every: int) -> None:
    ticks = journey(model, lost=cycle([False] * (every - 1) + [True]))
    assert [touch_at(ticks, time) for time in (0.4, 0.95, 1.3, 1.9)] == [
        Touch.NONE,
        Touch.ROUGH,
        Touch.NONE,
        Touch.SMOOTH,
    ]


@pytest.mark.parametrize("judge", [False, True], ids=["sound", "belief"])
def test_what_comes_too_late_is_not_felt_but_remembered(model: str, judge: bool) -> None:
    robot, operator = paired_ends(Codec("pcm16", channels=1, packet_size=120))
    line, receiver = VirtualLine(robot, operator), OperatorEndpoint(operator, walk_of(model))
    sender = RobotEndpoint(robot, walk_of(model).judge if judge else None)
    begun = line.connect(0.0)
    stalled: list[PipelineStep] = []
    after: list[PipelineStep] = []
    for block in blocks(strokes(), 120):
        sender.push(block)
        if 0.7 < block.time < 0.9:
            continue  # the line holds everything back for 200 ms
        ticks = [tick for news in line.carry(begun + block.end / RATE) if (tick := receiver.take(news))]
        (after if block.time >= 0.9 else stalled).extend(ticks)
    old = [tick for tick in after if tick.block.time < 0.83]
    assert old
    assert not any(tick.commands for tick in old)
    now = [belief for tick in after if 0.9 < tick.block.time < 0.92 for belief in tick.predictions]
    assert {belief.touch for belief in now} == {Touch.ROUGH}
