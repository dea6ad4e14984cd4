import itertools
import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("isaacteleop")

from isaacteleop.retargeting_engine.deviceio_source_nodes import HapticSink
from isaacteleop.retargeting_engine.interface import OptionalTensorGroup, TensorGroup
from isaacteleop.retargeting_engine.interface.tensor_group_type import OptionalType
from isaacteleop_tactophone import TouchSource
from isaacteleop_tactophone.device import TactophoneDevice

from tactophone import HapticCommand, Prediction, Touch
from tactophone.live.log.reader import Passed


def passed(
    made: float, amplitude: float = 0.4, finger: str = "index", frequency: float = 120.0
) -> Passed:
    prediction = Prediction(
        probabilities=(0.1, 0.2, 0.7),
        touch=Touch.ROUGH,
        roughness=0.8,
        start=0.0,
        end=0.1,
        level_dbfs=-20.0,
    )
    times = made, made, made
    return Passed(
        finger,
        prediction,
        HapticCommand(amplitude, frequency, made),
        *times,
        computed=made,
    )


class Robot:
    """Gives a prediction every 10 ms until it is killed."""

    def __init__(self) -> None:
        self.now, self.alive = 100.0, True

    def read(self) -> list[Passed]:
        return [passed(self.now)] if self.alive else []


def node(robot: Robot) -> TouchSource:
    return TouchSource("touch", "none", reader=robot.read, clock=lambda: robot.now)


def test_isaacs_own_sink_takes_the_pulse_and_vibrates() -> None:
    robot, commands = Robot(), []
    source = node(robot)
    device = TactophoneDevice(commands.append, clock=lambda: robot.now)
    sink = HapticSink("sink", device)
    outputs: dict[str, Any] = {
        name: TensorGroup(kind) for name, kind in source.output_spec().items()
    }
    source._compute_fn({}, outputs, None)
    group = OptionalTensorGroup(OptionalType(device.accepted_type()))
    group[0] = np.asarray(outputs["pulse"][0])
    sink._compute_fn({"right": group}, {}, None)
    sink.flush_to_device(None)
    assert commands[0].amplitude == pytest.approx(0.4)
    assert commands[0].frequency == pytest.approx(120.0)
    assert np.asarray(outputs["powers"][0]).tolist() == pytest.approx([0, 0.4, 0, 0, 0])


@pytest.mark.parametrize("by", [-100.0, 100.0])
def test_a_clock_that_is_set_neither_hides_a_command_nor_prolongs_one(
    by: float,
) -> None:
    newest = replace(passed(time.time() + by), computed=time.monotonic())
    source = TouchSource("touch", "none", reader=lambda: [newest])
    assert source.values()[0][0] == pytest.approx(0.4)
    newest = replace(newest, computed=newest.computed - 0.2)
    assert not source.values()[0].any()


@pytest.mark.parametrize("seed", range(20))
def test_a_killed_robot_is_silent_within_100_ms_and_leaves_no_stale_pulse(
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    for _ in range(50):
        robot = Robot()
        source, vibrates_until = node(robot), 0.0
        for _ in range(int(rng.integers(1, 30))):
            robot.now += 0.01
            source.values()
        robot.alive, killed = False, robot.now
        while robot.now < killed + 0.3:
            pulse, powers = source.values()
            if pulse[0] > 0:
                vibrates_until = max(vibrates_until, robot.now + float(pulse[2]))
            if robot.now > killed + 0.1:
                assert not pulse.any()
                assert not powers.any()
            robot.now += float(rng.uniform(0.002, 0.03))
        assert vibrates_until <= killed + 0.1 + 1e-4


@pytest.mark.parametrize(
    ("amplitude", "frequency", "late"),
    list(itertools.product((math.nan, -1.0), (120.0, math.inf), (0.0, -5.0))),
)
def test_what_is_no_command_is_silence(
    amplitude: float, frequency: float, late: float
) -> None:
    source = TouchSource(
        "touch",
        "none",
        reader=lambda: [passed(10.0 - late, amplitude, "index", frequency)],
        clock=lambda: 10.0,
    )
    assert not source.values()[0].any()


def test_the_ceiling_holds() -> None:
    source = TouchSource(
        "touch",
        "none",
        ceiling=0.2,
        reader=lambda: [passed(10.0, 0.9)],
        clock=lambda: 10.0,
    )
    pulse, powers = source.values()
    assert max(pulse[0], *powers) == pytest.approx(0.2)
