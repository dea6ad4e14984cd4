import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.virtual_link import paired_sessions
from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings, change
from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.live.runtime.output_gate import BUZZ_DURATION, FingerOutput
from tactophone.live.telemetry.layout import FingerState, Request
from tactophone.net.endpoints import OperatorEndpoint
from tactophone.net.link.codec import Codec
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.session import Session
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.haptics.passthrough import (
    GateProfile,
    PassthroughRenderer,
    open_passthrough,
)
from tactophone.signal.pipeline import Hand, open_pipeline
from tests.models import write_tiny_model


@pytest.fixture
def oscillator() -> Oscillator:
    return Oscillator(Limits(ceiling=0.5))


@pytest.fixture
def endpoint(tmp_path: Path) -> OperatorEndpoint:
    _, session = paired_sessions(Codec())
    return OperatorEndpoint(
        session,
        open_pipeline(
            str(write_tiny_model(tmp_path / "tiny.onnx")),
            sample_rate=48_000,
            channels=2,
            profile="paper",
        ),
    )


@pytest.fixture
def finger(oscillator: Oscillator, endpoint: OperatorEndpoint) -> FingerOutput:
    return FingerOutput(Settings(), oscillator, endpoint)


def peak(oscillator: Oscillator) -> float:
    """Peak of the vibration a tenth of a second after a command for full drive."""
    out = np.empty(1200, np.float32)
    for _ in range(4):
        oscillator.submit(HapticCommand(1.0, 60.0, 0.0))
        oscillator.render(out)
    return float(np.abs(out).max())


def test_the_ceiling_reaches_the_oscillator(
    finger: FingerOutput, oscillator: Oscillator
) -> None:
    assert 0.4 < peak(oscillator) <= 0.5
    assert finger.apply([Request("ceiling", 0.1)]) == []
    assert 0.0 < peak(oscillator) <= np.float32(0.1)


def test_who_replaces_a_failed_process_is_no_stronger_than_it_was(
    oscillator: Oscillator, endpoint: OperatorEndpoint
) -> None:
    """Ceiling and level that a page had lowered were forgotten."""
    settings = change(Settings(), ["rendering.output_level=0.8"])
    before = FingerState(ceiling=0.05, output_level=0.5, profile="lra")
    finger = FingerOutput(settings, oscillator, endpoint, before=before)
    state = finger.state()
    assert (state.ceiling, state.output_level, state.profile) == (0.05, 0.5, "lra")
    assert state.local_ceiling == Settings().rendering.ceiling
    stronger = FingerState(ceiling=1.0, output_level=1.0)
    state = FingerOutput(settings, Oscillator(), endpoint, before=stronger).state()
    assert (state.ceiling, state.output_level) == (state.local_ceiling, 0.8)


def test_a_ceiling_lowered_and_raised_in_a_run_scales_the_whole_profile(
    finger: FingerOutput, endpoint: OperatorEndpoint
) -> None:
    rough = Prediction((0.0, 0.0, 1.0), Touch.ROUGH, 1.0, -20.0, start=0.0, end=0.256)
    smooth = Prediction((0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, -20.0, start=0.0, end=0.256)
    for ceiling in (0.1, 0.3, 0.5):
        assert finger.apply([Request("ceiling", ceiling)]) == []
        amplitudes = [
            finger.gate.bound(endpoint.pipeline.command_for(prediction).amplitude)
            for prediction in (rough, smooth)
        ]
        assert amplitudes == pytest.approx([ceiling, ceiling * 10 ** (-25 / 20)])


def test_stopping_and_arming_reach_the_oscillator(
    finger: FingerOutput, oscillator: Oscillator
) -> None:
    finger.stop()
    assert peak(oscillator) == 0.0
    finger.apply([])
    finger.apply([Request("arm")])
    assert peak(oscillator) > 0.4


def test_who_begins_muted_vibrates_from_arming_on(
    oscillator: Oscillator, endpoint: OperatorEndpoint
) -> None:
    finger = FingerOutput(Settings(), oscillator, endpoint, muted_because="for a test")
    assert peak(oscillator) == 0.0
    finger.apply([Request("arm")])
    assert peak(oscillator) > 0.4


def test_threshold_and_profile_reach_the_pipeline_or_are_refused(
    finger: FingerOutput, endpoint: OperatorEndpoint
) -> None:
    assert (
        finger.apply(
            [Request("threshold_dbfs", -12.0), Request("profile", text="paper")]
        )
        == []
    )
    assert endpoint.pipeline.detector.threshold.dbfs == -12.0
    assert finger.apply(
        [Request("threshold_dbfs", 3.0), Request("profile", text="telephone")]
    ) == [
        "threshold_dbfs",
        "profile",
    ]
    assert finger.apply([Request("threshold_dbfs", float("nan"))]) == ["threshold_dbfs"]
    assert endpoint.pipeline.detector.threshold.dbfs == -12.0


def test_a_renderer_of_sound_gets_no_other_profile(endpoint: OperatorEndpoint) -> None:
    endpoint.pipeline.profile = GateProfile("direct")
    renderer = PassthroughRenderer(
        open_passthrough("direct", Limits(ceiling=1.0)),
        lambda size: np.zeros((size, 2), np.float32),
    )
    finger = FingerOutput(Settings(), renderer, endpoint)
    assert finger.profiles == ("direct",)
    assert finger.apply([Request("profile", text="erm")]) == ["profile"]
    finger.stop()
    assert renderer.stopped


def test_a_stop_while_an_arming_is_applied_reaches_the_renderer(
    endpoint: OperatorEndpoint,
) -> None:
    class Interrupted(Oscillator):
        def release(self) -> None:
            finger.stop()
            super().release()

    oscillator = Oscillator()
    finger = FingerOutput(Settings(), oscillator, endpoint, muted_because="for a test")
    oscillator.__class__ = Interrupted
    finger.apply([Request("arm")])
    assert oscillator.stopped


def test_controls_count_as_changed_after_each_request_stop_and_pipeline_only() -> None:
    session = ReceiveSession(Session(Identity.create("operator"), Peers()))
    endpoint = OperatorEndpoint(session, open_pipeline(sample_rate=48_000, channels=2))
    finger = FingerOutput(Settings(), Oscillator(), endpoint)
    assert [finger.changed(), finger.changed()] == [True, False]
    finger.apply([])
    assert not finger.changed()
    finger.apply([Request("ceiling", 0.2)])
    assert [finger.changed(), finger.changed()] == [True, False]
    finger.stop()
    assert [finger.changed(), finger.changed()] == [True, False]
    endpoint.hand = Hand([open_pipeline(sample_rate=48_000, channels=1)])
    assert [finger.changed(), finger.changed()] == [True, False]


def test_controls_count_as_changed_while_a_request_is_applied() -> None:
    # What the network thread computes meanwhile is bounded by old values or new ones,
    # and the log must leave that open.
    class Watched(Oscillator):
        meanwhile: tuple[bool, bool] = (False, False)

        def stop(self) -> None:
            self.meanwhile = finger.changed(), finger.changed()
            super().stop()

    session = ReceiveSession(Session(Identity.create("operator"), Peers()))
    endpoint = OperatorEndpoint(session, open_pipeline(sample_rate=48_000, channels=2))
    oscillator = Watched()
    finger = FingerOutput(Settings(), oscillator, endpoint)
    for alter in (lambda: finger.apply([Request("mute")]), finger.stop):
        finger.changed()
        assert not finger.changed()
        alter()
        assert oscillator.meanwhile == (True, True)
        assert [finger.changed(), finger.changed()] == [True, False]


def test_the_newest_command_is_rendered_as_the_gate_bounds_it(
    finger: FingerOutput, oscillator: Oscillator
) -> None:
    submitted: list[HapticCommand] = []
    oscillator.submit = submitted.append  # type: ignore[method-assign]
    commands = tuple(
        HapticCommand(amplitude, 60.0, 0.1) for amplitude in (0.1, 0.2, 0.9)
    )
    block = AudioBlock(np.zeros((1, 2), np.float32), 48_000, 0)
    step = finger.submit(PipelineStep(block, (), commands, 3))
    assert submitted == [HapticCommand(0.5, 60.0, 0.1)]
    assert (step.commands, step.finger) == ((*commands[:2], submitted[0]), 3)
    assert step.block is block
    assert finger.roughness == 0.0
    nothing = PipelineStep(block, (), (), 3)
    assert finger.submit(nothing) is nothing
    assert len(submitted) == 1


def heard(*predictions: tuple[Touch, float, float]) -> PipelineStep:
    """Predictions of a touch, a roughness and a level in dBFS; no command."""
    block = AudioBlock(np.zeros((1, 2), np.float32), 48_000, 0)
    found = [
        Prediction((0.0, 1 - rough, rough), touch, rough, level, 0.0, 0.0)
        for touch, rough, level in predictions
    ]
    return PipelineStep(block, tuple(found), (), 0)


def test_the_state_tells_the_newest_roughness_and_the_smoothed_level_without_contact(
    finger: FingerOutput,
) -> None:
    assert (finger.roughness, finger.state().noise_floor_dbfs) == (0.0, -math.inf)
    finger.submit(
        heard(
            (Touch.SMOOTH, 0.2, -10.0),
            (Touch.ROUGH, 0.9, -10.0),
            (Touch.SMOOTH, 0.4, -10.0),
        )
    )
    assert (finger.roughness, finger.state().noise_floor_dbfs) == (0.4, -math.inf)
    finger.submit(heard((Touch.NONE, 0.0, -math.inf), (Touch.NONE, 0.0, -60.0)))
    assert finger.state().noise_floor_dbfs == -60.0
    finger.submit(heard((Touch.NONE, 0.0, -64.0)))  # a hundredth of the way: -60.04
    assert finger.state().noise_floor_dbfs == -60.0
    finger.submit(heard(*[(Touch.NONE, 0.0, -50.0)] * 70))
    assert finger.state().noise_floor_dbfs == -55.0
    finger.submit(heard(*[(Touch.ROUGH, 1.0, -10.0)] * 69))
    assert finger.state().noise_floor_dbfs == -55.0


def test_the_threshold_may_be_set_from_the_rounding_of_24_bits_to_full_scale(
    finger: FingerOutput,
) -> None:
    for value in (-120.0, 0.0):
        assert finger.apply([Request("threshold_dbfs", value)]) == []
        assert finger.state().threshold_dbfs == value
    assert (
        finger.apply(
            [Request("threshold_dbfs", 0.5), Request("threshold_dbfs", -120.5)]
        )
        == ["threshold_dbfs"] * 2
    )


def test_a_profile_that_cannot_be_opened_is_refused(
    finger: FingerOutput, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(name: str, response: object) -> None:
        raise ConfigError("no such actuator")

    monkeypatch.setattr("tactophone.live.runtime.output_gate.open_profile", broken)
    assert finger.apply([Request("profile", text="lra")]) == ["profile"]


def test_controls_tell_the_threshold_only_where_it_is_fixed(
    finger: FingerOutput, endpoint: OperatorEndpoint
) -> None:
    endpoint.pipeline.detector.threshold.dbfs = -30.0
    assert finger.controls() == (True, 0.5, 1.0, endpoint.pipeline.profile.name, -30.0)
    session = ReceiveSession(Session(Identity.create("operator"), Peers()))
    following = OperatorEndpoint(session, open_pipeline(sample_rate=48_000, channels=2))
    following.pipeline.detector.threshold.follows_floor = True
    assert FingerOutput(Settings(), Oscillator(), following).controls()[-1] is None


def test_a_request_for_another_finger_is_none_of_this_ones(
    finger: FingerOutput,
) -> None:
    finger.changed()
    assert finger.apply([Request("mute", finger=1)]) == []
    assert finger.gate.armed
    assert not finger.changed()
    assert finger.apply([Request("mute", finger=0)]) == []
    assert not finger.gate.armed
    assert finger.changed()


def test_each_change_counts_and_none_is_under_way_after_it(
    finger: FingerOutput,
) -> None:
    for alter in (finger.stop, lambda: finger.apply([Request("arm")]), finger.stop):
        finger.changed()
        alter()
        assert [finger.changed(), finger.changed()] == [True, False]


def test_a_stop_and_the_arming_after_it_are_two_changes(finger: FingerOutput) -> None:
    finger.changed()
    finger.stop()
    finger.apply([])
    finger.apply([Request("arm")])
    assert finger.changed()


TURN = 0.007
"""Seconds of a turn of the network thread without a packet."""


def turns(
    finger: FingerOutput, oscillator: Oscillator, seconds: float, *, begin: float
) -> np.ndarray:
    """Let the network thread turn for some seconds without a packet; returns the peak
    of the vibration in each turn."""
    out = np.empty(round(TURN * 48_000), np.float32)
    peaks = []
    for turn in range(round(seconds / TURN)):
        finger.buzz(begin + turn * TURN)
        oscillator.render(out)
        peaks.append(float(np.abs(out).max()))
    return np.array(peaks)


def test_a_buzz_is_felt_without_sound_at_the_level_and_ends_by_itself(
    finger: FingerOutput, oscillator: Oscillator
) -> None:
    finger.apply([Request("ceiling", 0.4), Request("output_level", 0.5)])
    assert finger.apply([Request("buzz", time=10.0)]) == []
    peaks = turns(finger, oscillator, 1.0, begin=10.01)
    assert 0.19 < peaks.max() <= np.float32(0.2)
    during = round(BUZZ_DURATION / TURN)
    assert peaks[4 : during - 1].min() > 0.05
    assert peaks[during + 10 :].max() == 0.0
    assert not finger.buzzing


def test_a_stop_ends_a_buzz_at_once_and_arming_does_not_continue_it(
    finger: FingerOutput, oscillator: Oscillator
) -> None:
    finger.apply([Request("buzz", time=10.0)])
    assert turns(finger, oscillator, 0.1, begin=10.0).max() > 0.3
    finger.stop()
    assert turns(finger, oscillator, 0.1, begin=10.1)[-1] == 0.0
    finger.apply([])
    finger.apply([Request("arm")])
    assert turns(finger, oscillator, 0.1, begin=10.2).max() == 0.0


def test_no_buzz_begins_while_muted_or_long_after_it_was_asked_for(
    finger: FingerOutput, oscillator: Oscillator
) -> None:
    finger.apply([Request("buzz", time=10.0)])
    assert turns(finger, oscillator, 0.1, begin=18.0).max() == 0.0
    finger.apply([Request("mute")])
    assert finger.apply([Request("buzz", time=20.0)]) == ["buzz"]
    assert turns(finger, oscillator, 0.1, begin=20.0).max() == 0.0


def test_touch_does_not_interrupt_a_buzz_and_follows_it(
    finger: FingerOutput, oscillator: Oscillator
) -> None:
    submitted: list[HapticCommand] = []
    oscillator.submit = submitted.append  # type: ignore[method-assign]
    block = AudioBlock(np.zeros((1, 2), np.float32), 48_000, 0)
    touch = PipelineStep(block, (), (HapticCommand(0.1, 120.0, 0.1),), 0)
    finger.apply([Request("buzz", time=10.0)])
    finger.buzz(10.0)
    # What is published is the touch as detected, as a replay computes it.
    assert finger.submit(touch).commands == touch.commands
    assert [command.amplitude for command in submitted] == [0.5]
    finger.buzz(10.0 + BUZZ_DURATION)
    finger.submit(touch)
    assert [command.amplitude for command in submitted] == [0.5, 0.0, 0.1]


def test_a_renderer_of_sound_refuses_to_buzz(endpoint: OperatorEndpoint) -> None:
    renderer = PassthroughRenderer(
        open_passthrough("direct", Limits(ceiling=1.0)),
        lambda size: np.zeros((size, 2), np.float32),
    )
    finger = FingerOutput(Settings(), renderer, endpoint)
    assert not finger.state().can_buzz
    assert finger.apply([Request("buzz", time=10.0)]) == ["buzz"]
