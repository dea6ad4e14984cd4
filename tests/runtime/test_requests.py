from pathlib import Path

import numpy as np
import pytest

from tactophone.endpoints import OperatorEndpoint, open_pipeline
from tactophone.haptics import PASSTHROUGH, GateProfile, Limits, Oscillator, PassthroughRenderer
from tactophone.link import Codec
from tactophone.runtime.output_gate import OutputGate
from tactophone.runtime.requests import RequestHandler
from tactophone.simulation.network.virtual_link import paired_ends
from tactophone.telemetry import Request
from tactophone.types import HapticCommand

from ..models import write_tiny_model


@pytest.fixture
def oscillator() -> Oscillator:
    return Oscillator(Limits(ceiling=0.5))


@pytest.fixture
def receiver(tmp_path: Path) -> OperatorEndpoint:
    _, end = paired_ends(Codec())
    return OperatorEndpoint(
        end, open_pipeline(str(write_tiny_model(tmp_path / "tiny.onnx")), sample_rate=48_000, channels=2)
    )


@pytest.fixture
def desk(oscillator: Oscillator, receiver: OperatorEndpoint) -> RequestHandler:
    return RequestHandler(OutputGate(ceiling=0.5), oscillator, receiver)


def peak(oscillator: Oscillator) -> float:
    """What is felt a tenth of a second after a command for all there is."""
    out = np.empty(1200, np.float32)
    for _ in range(4):
        oscillator.submit(HapticCommand(1.0, 60.0, 0.0))
        oscillator.render(out)
    return float(np.abs(out).max())


def test_the_ceiling_reaches_the_oscillator(desk: RequestHandler, oscillator: Oscillator) -> None:
    assert 0.4 < peak(oscillator) <= 0.5
    assert desk.obey([Request("ceiling", 0.1)]) == []
    assert 0.0 < peak(oscillator) <= np.float32(0.1)


def test_stopping_and_arming_reach_the_oscillator(desk: RequestHandler, oscillator: Oscillator) -> None:
    desk.stop()
    assert peak(oscillator) == 0.0
    desk.obey([Request("arm")])
    assert peak(oscillator) > 0.4


def test_who_begins_muted_vibrates_from_arming_on(oscillator: Oscillator, receiver: OperatorEndpoint) -> None:
    desk = RequestHandler(OutputGate(ceiling=0.5, muted_because="for a test"), oscillator, receiver)
    assert peak(oscillator) == 0.0
    desk.obey([Request("arm")])
    assert peak(oscillator) > 0.4


def test_threshold_and_profile_reach_the_walk_or_are_refused(desk: RequestHandler, receiver: OperatorEndpoint) -> None:
    assert desk.obey([Request("threshold_dbfs", -12.0), Request("profile", text="paper")]) == []
    assert receiver.walk.judge.threshold_dbfs == -12.0
    assert desk.obey([Request("threshold_dbfs", 3.0), Request("profile", text="telephone")]) == [
        "threshold_dbfs",
        "profile",
    ]
    assert desk.obey([Request("threshold_dbfs", float("nan"))]) == ["threshold_dbfs"]
    assert receiver.walk.judge.threshold_dbfs == -12.0


def test_a_relay_of_sound_is_given_no_other_profile(receiver: OperatorEndpoint) -> None:
    receiver.walk.profile = GateProfile("direct")
    relay = PassthroughRenderer(PASSTHROUGH["direct"](None), lambda size: np.zeros((size, 2), np.float32))
    desk = RequestHandler(OutputGate(ceiling=0.5), relay, receiver)
    assert desk.profiles == ("direct",)
    assert desk.obey([Request("profile", text="erm")]) == ["profile"]
    desk.stop()
    assert relay.stopped
