from typing import Any

import numpy as np
import pytest

pytest.importorskip("isaacteleop")

from isaacteleop.haptic_devices import IHapticDevice
from isaacteleop.retargeting_engine.deviceio_source_nodes import HapticSink
from isaacteleop.retargeting_engine.interface import OptionalTensorGroup
from isaacteleop.retargeting_engine.interface.tensor_group_type import OptionalType
from isaacteleop_tactophone.device import TactophoneDevice

from tactophone.core.types import HapticCommand
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator


def pulse(device: Any, *values: float) -> dict[str, OptionalTensorGroup]:
    group = OptionalTensorGroup(OptionalType(device.accepted_type()))
    group[0] = np.array(values, np.float32)
    return {"right": group}


def test_isaacs_own_sink_takes_the_device_and_the_pulse_is_bounded() -> None:
    commands: list[HapticCommand] = []
    now = [0.0]
    device = TactophoneDevice(commands.append, clock=lambda: now[0])
    assert isinstance(device, IHapticDevice)
    sink = HapticSink("fingertip", device)
    assert set(sink.input_spec()) == {"right"}
    sink._compute_fn(pulse(device, 0.9, 120.0, 0.05), {}, None)
    sink.flush_to_device(None)
    now[0] = 0.04
    sink.flush_to_device(None)
    now[0] = 0.06
    sink.flush_to_device(None)
    assert [command.amplitude for command in commands] == [0.5, 0.5, 0.0]
    assert commands[0].frequency == pytest.approx(120.0)
    sink._compute_fn(pulse(device, float("nan"), float("inf"), -1.0), {}, None)
    sink.flush_to_device(None)
    assert commands[-1].amplitude == 0.0
    assert device.faults == 1


def test_a_pulse_is_rendered_and_fades_when_isaac_stops() -> None:
    oscillator = Oscillator(Limits(ceiling=0.3))
    device = TactophoneDevice(oscillator.submit, ceiling=1.0)
    device.apply("right", np.array([1.0, 120.0, 0.5]))
    device.flush(None)
    wave = np.zeros(9_600, np.float32)
    oscillator.render(wave)
    assert 0.25 < np.abs(wave).max() <= np.float32(0.3)
    assert not wave[-960:].any()
