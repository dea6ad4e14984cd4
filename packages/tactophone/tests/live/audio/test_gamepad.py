"""The motors of a gamepad: a recorded pad everywhere, a virtual one of the kernel where
the machine allows it."""

import errno
import math
import os
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tactophone.core.errors import DeviceError
from tactophone.core.types import FloatArray
from tactophone.live.audio.gamepad import REFRESH, GamepadDevice, motor_levels
from tests.live.audio import actuator_contract as contract

from .test_jack import eventually

pytest.importorskip("evdev")


class RecordedPad:
    """Notes each effect as its two motor levels and its length in ms."""

    name, path = "Test Pad", "/dev/input/event7"

    def __init__(self) -> None:
        self.effects: list[tuple[float, float, int]] = []
        self.started = 0
        self.gone = False

    def upload_effect(self, effect: Any) -> int:
        if self.gone:
            raise OSError(errno.ENODEV, "gone")
        rumble = effect.u.ff_rumble_effect
        self.effects.append(
            (
                rumble.strong_magnitude / 65535,
                rumble.weak_magnitude / 65535,
                effect.ff_replay.length,
            )
        )
        return 3

    def write(self, *_: int) -> None:
        self.started += 1

    def close(self) -> None:
        pass


class Level:
    def __init__(self, level: float) -> None:
        self.level = level

    def __call__(self, _: list[FloatArray], outputs: list[FloatArray]) -> None:
        outputs[0][:] = self.level


def device(
    pad: Any,
    process: Any,
    *,
    roughness: float = 1.0,
    ceiling: float = 0.5,
    name: str = "",
) -> GamepadDevice:
    return GamepadDevice(
        process,
        device=name,
        roughness=lambda: roughness,
        ceiling=lambda: ceiling,
        find=lambda: [pad] if pad else [],
    )


@pytest.mark.parametrize("promise", contract.ALL)
def test_a_gamepad_keeps_the_contract(promise: Any) -> None:
    from tactophone.live.audio.actuator import gamepad_actuator

    promise(
        lambda render: gamepad_actuator(
            render,
            roughness=lambda: 1.0,
            ceiling=lambda: 0.5,
            find=lambda: [RecordedPad()],
        )
    )


@pytest.mark.parametrize(("roughness", "motor"), [(1.0, 0), (0.0, 1)])
def test_rough_turns_the_strong_motor_and_smooth_the_weak_one(
    roughness: float, motor: int
) -> None:
    pad = RecordedPad()
    played = device(pad, Level(0.5), roughness=roughness)
    played.open()
    assert eventually(lambda: len(pad.effects) > 4)
    played.close()
    assert all(
        effect[motor] == pytest.approx(0.5, abs=1e-4) for effect in pad.effects[1:-1]
    )
    assert all(effect[1 - motor] == 0 for effect in pad.effects)
    assert {effect[2] for effect in pad.effects} == {120}
    assert pad.started == len(pad.effects)
    assert pad.effects[-1][:2] == (0.0, 0.0)


def test_another_pad_in_its_place_is_not_taken() -> None:
    pad, other = RecordedPad(), RecordedPad()
    other.name = "Someone Else's Pad"
    pads = [pad]
    played = GamepadDevice(
        Level(0.5), roughness=lambda: 1.0, ceiling=lambda: 0.5, find=lambda: pads
    )
    played.open()
    pad.gone = True
    assert eventually(lambda: played.fault != "")
    pads[:] = [other]
    played.revive()
    assert "Test Pad is gone; there are: /dev/input/event7 Someone" in played.fault
    assert (played.lost, other.effects) == (True, [])
    pad.gone = False
    pads[:] = [other, pad]
    played.revive()
    assert (played.lost, played.fault) == (False, "")
    played.close()


def test_silence_and_a_failing_render_rest_both_motors() -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("a render that fails")

    for process in (Level(0.0), Level(math.nan), Level(math.inf), fail):
        pad = RecordedPad()
        played = device(pad, process)
        played.open()
        assert eventually(lambda pad=pad: len(pad.effects) > 2)
        played.close()
        assert {effect[:2] for effect in pad.effects} == {(0.0, 0.0)}


def rest_after(levels: list[float], monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """Play one level a period of 5 ms and then silence, in virtual time; return the
    times, in s, between which the strong motor turns."""
    pad, now = RecordedPad(), 1.0
    left = iter(levels)
    turning: list[float] = []

    def process(_: list[FloatArray], outputs: list[FloatArray]) -> None:
        outputs[0][:] = next(left, 0.0)

    def wait(timeout: float) -> bool:
        nonlocal now
        if pad.effects and (pad.effects[-1][0] > 0) == (len(turning) % 2 == 0):
            turning.append(now)
        now += timeout
        return now > 0.005 * len(levels) + 1.3

    played = device(pad, process)
    played._pad = pad
    clock = SimpleNamespace(monotonic=lambda: now)
    monkeypatch.setattr("tactophone.live.audio.gamepad.time", clock)
    monkeypatch.setattr(played, "_ended", SimpleNamespace(wait=wait))
    played._run()
    return turning


@pytest.mark.parametrize("periods", range(20, 31))
def test_what_has_ended_rests_at_once(
    periods: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its peak was played for up to two more refreshes, 0.1 s."""
    began, rested = rest_after([0.5] * periods, monkeypatch)
    assert rested - began == pytest.approx(0.005 * periods)


def test_a_vibration_between_two_effects_turns_the_motors_for_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    began, rested = rest_after([0.0] * 26 + [0.5] * 3, monkeypatch)
    assert rested - began == pytest.approx(REFRESH, abs=0.006)


def test_nothing_exceeds_the_ceiling() -> None:
    rng = np.random.default_rng(1)
    for amplitude, roughness, ceiling in rng.uniform(0, 1, (500, 3)):
        assert sum(motor_levels(amplitude, roughness, ceiling)) <= ceiling + 1e-12
    assert motor_levels(float("nan"), 0.5, 0.5) == (0.0, 0.0)


def test_a_pad_that_is_unplugged_is_a_fault_and_comes_back() -> None:
    pad = RecordedPad()
    played = device(pad, Level(0.3))
    played.open()
    pad.gone = True
    assert eventually(lambda: "connect it again" in played.fault)
    pad.gone = False
    played.revive()
    assert played.fault == ""
    assert played.losses == 1
    played.close()


def test_no_pad_lists_what_there_is() -> None:
    with pytest.raises(DeviceError, match="none"):
        device(None, Level(0.0)).open()
    with pytest.raises(
        DeviceError, match=r"matches 'Other'; there are: /dev/input/event7 Test Pad"
    ):
        device(RecordedPad(), Level(0.0), name="Other").open()


@pytest.mark.realtime
@pytest.mark.skipif(not os.access("/dev/uinput", os.W_OK), reason="no /dev/uinput here")
def test_a_virtual_pad_of_the_kernel_receives_the_effects() -> None:
    import threading

    from evdev import InputDevice, UInput, ecodes

    uploaded = []
    with UInput(
        {ecodes.EV_FF: [ecodes.FF_RUMBLE], ecodes.EV_KEY: [ecodes.BTN_SOUTH]},
        name="tactophone test",
    ) as pad:

        def answer() -> None:
            for event in pad.read_loop():
                if event.type == ecodes.EV_UINPUT and event.code == ecodes.UI_FF_UPLOAD:
                    upload = pad.begin_upload(event.value)
                    uploaded.append(upload.effect.u.ff_rumble_effect.strong_magnitude)
                    upload.retval = 0
                    pad.end_upload(upload)

        threading.Thread(target=answer, daemon=True).start()
        time.sleep(0.5)
        played = device(InputDevice(pad.device.path), Level(0.5))
        played.open()
        assert eventually(lambda: len(uploaded) > 3)
        played.close()
    assert max(uploaded) == pytest.approx(0.5 * 65535, abs=1)


def test_an_effect_is_refreshed_often_enough_and_not_with_every_period() -> None:
    """Each refresh is a call of the kernel, which writes to the pad over USB or
    radio."""
    pad, level = RecordedPad(), Level(0.5)
    periods: list[int] = []

    def process(inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        periods.append(pad.started)
        level(inputs, outputs)

    played = device(pad, process)
    played.open()
    assert eventually(lambda: pad.started > 6)
    played.close()
    assert len(periods) > 4 * pad.started
