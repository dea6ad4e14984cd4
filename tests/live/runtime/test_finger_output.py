from pathlib import Path

import numpy as np
import pytest
from benchmarks.virtual_link import paired_sessions

from tactophone.core.settings import Settings
from tactophone.core.types import HapticCommand, Prediction, Touch
from tactophone.live.runtime.gate import FingerOutput
from tactophone.live.telemetry.layout import Request
from tactophone.net.endpoints import OperatorEndpoint
from tactophone.net.link.codec import Codec
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.session import Session
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.haptics.passthrough import PASSTHROUGH, GateProfile, PassthroughRenderer
from tactophone.signal.pipeline import Hand, open_pipeline
from tests.models import write_tiny_model


@pytest.fixture
def oscillator() -> Oscillator:
    return Oscillator(Limits(ceiling=0.5))


@pytest.fixture
def endpoint(tmp_path: Path) -> OperatorEndpoint:
    _, session = paired_sessions(Codec())
    return OperatorEndpoint(
        session, open_pipeline(str(write_tiny_model(tmp_path / "tiny.onnx")), sample_rate=48_000, channels=2)
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


def test_the_ceiling_reaches_the_oscillator(finger: FingerOutput, oscillator: Oscillator) -> None:
    assert 0.4 < peak(oscillator) <= 0.5
    assert finger.apply([Request("ceiling", 0.1)]) == []
    assert 0.0 < peak(oscillator) <= np.float32(0.1)


def test_a_ceiling_lowered_and_raised_in_a_run_scales_the_whole_profile(
    finger: FingerOutput, endpoint: OperatorEndpoint
) -> None:
    rough = Prediction((0.0, 0.0, 1.0), Touch.ROUGH, 1.0, -20.0, start=0.0, end=0.256)
    smooth = Prediction((0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, -20.0, start=0.0, end=0.256)
    for ceiling in (0.1, 0.3, 0.5):
        assert finger.apply([Request("ceiling", ceiling)]) == []
        amplitudes = [
            finger.gate.bound(endpoint.pipeline.command_for(prediction).amplitude) for prediction in (rough, smooth)
        ]
        assert amplitudes == pytest.approx([ceiling, ceiling * 10 ** (-25 / 20)])


def test_stopping_and_arming_reach_the_oscillator(finger: FingerOutput, oscillator: Oscillator) -> None:
    finger.stop()
    assert peak(oscillator) == 0.0
    finger.apply([])
    finger.apply([Request("arm")])
    assert peak(oscillator) > 0.4


def test_who_begins_muted_vibrates_from_arming_on(oscillator: Oscillator, endpoint: OperatorEndpoint) -> None:
    finger = FingerOutput(Settings(), oscillator, endpoint, muted_because="for a test")
    assert peak(oscillator) == 0.0
    finger.apply([Request("arm")])
    assert peak(oscillator) > 0.4


def test_threshold_and_profile_reach_the_pipeline_or_are_refused(
    finger: FingerOutput, endpoint: OperatorEndpoint
) -> None:
    assert finger.apply([Request("threshold_dbfs", -12.0), Request("profile", text="paper")]) == []
    assert endpoint.pipeline.detector.threshold.dbfs == -12.0
    assert finger.apply([Request("threshold_dbfs", 3.0), Request("profile", text="telephone")]) == [
        "threshold_dbfs",
        "profile",
    ]
    assert finger.apply([Request("threshold_dbfs", float("nan"))]) == ["threshold_dbfs"]
    assert endpoint.pipeline.detector.threshold.dbfs == -12.0


def test_a_renderer_of_sound_gets_no_other_profile(endpoint: OperatorEndpoint) -> None:
    endpoint.pipeline.profile = GateProfile("direct")
    renderer = PassthroughRenderer(
        PASSTHROUGH["direct"](Limits(ceiling=1.0)), lambda size: np.zeros((size, 2), np.float32)
    )
    finger = FingerOutput(Settings(), renderer, endpoint)
    assert finger.profiles == ("direct",)
    assert finger.apply([Request("profile", text="erm")]) == ["profile"]
    finger.stop()
    assert renderer.stopped


def test_a_stop_while_an_arming_is_applied_reaches_the_renderer(endpoint: OperatorEndpoint) -> None:
    class Interrupted(Oscillator):
        def release(self) -> None:
            finger.stop()
            super().release()

    oscillator = Oscillator()
    finger = FingerOutput(Settings(), oscillator, endpoint, muted_because="for a test")
    oscillator.__class__ = Interrupted
    finger.apply([Request("arm")])
    assert oscillator.stopped


def test_controls_count_as_changed_after_each_request_stop_and_pipeline_and_not_between() -> None:
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
    # What the network thread computes meanwhile is bounded by old values or new ones, and the log must leave that open.
    class Watched(Oscillator):
        meanwhile: tuple[bool, bool] = (False, False)

        def stop(self) -> None:
            self.meanwhile = finger.changed(), finger.changed()
            super().stop()

    session = ReceiveSession(Session(Identity.create("operator"), Peers()))
    endpoint = OperatorEndpoint(session, open_pipeline(sample_rate=48_000, channels=2))
    oscillator = Watched()
    finger = FingerOutput(Settings(), oscillator, endpoint)
    for change in (lambda: finger.apply([Request("mute")]), finger.stop):
        finger.changed()
        assert not finger.changed()
        change()
        assert oscillator.meanwhile == (True, True)
        assert [finger.changed(), finger.changed()] == [True, False]
