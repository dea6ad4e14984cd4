import math
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import ModelError
from tactophone.core.types import Detector, Prediction, Touch
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone.signal.perception.window_detector import WindowDetector
from tests.models import write_tiny_model
from tests.sounds import ODD_SIZES, blocks, noise, tone


def open_model(path: Path) -> WindowDetector:
    return WindowDetector(read_model(path), sample_rate=48_000)


@pytest.fixture
def detector(tmp_path: Path) -> Detector:
    return open_model(write_tiny_model(tmp_path / "tiny.onnx"))


def predict(
    detector: Detector, samples: np.ndarray, size: int = 480
) -> list[Prediction]:
    predictions = [
        prediction
        for block in blocks(samples, size)
        for prediction in detector.push(block)
    ]
    return predictions + detector.flush()


def test_an_update_every_512_samples_of_the_papers_sound(detector: Detector) -> None:
    predictions = predict(detector, tone(100, duration=2))
    ends = np.array([prediction.end for prediction in predictions])
    assert ends[0] == 0.256
    assert np.abs(np.diff(ends) - 512 / 48_000).max() < 1 / 2000
    assert detector.hop == pytest.approx(512 / 48_000)


@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_bits(detector: Detector, size: int) -> None:
    samples = noise(duration=0.5)
    samples[12_000:12_100] = np.nan
    whole = predict(detector, samples, len(samples))
    detector.reset()
    assert predict(detector, samples, size) == whole


def test_predictions_follow_the_network(detector: Detector) -> None:
    assert {prediction.touch for prediction in predict(detector, tone(100))} == {
        Touch.SMOOTH
    }
    detector.reset()
    assert {prediction.touch for prediction in predict(detector, tone(400))} == {
        Touch.ROUGH
    }
    detector.reset()
    assert {
        prediction.touch for prediction in predict(detector, tone(400, amplitude=0.005))
    } == {Touch.NONE}


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30])
def test_invalid_samples_are_faulty_while_a_window_holds_it(
    detector: Detector, value: float
) -> None:
    samples = tone(400, duration=2)
    samples[48_000] = value
    faulty = [
        prediction for prediction in predict(detector, samples) if prediction.faulty
    ]
    assert all(prediction.touch is Touch.NONE for prediction in faulty)
    assert faulty[0].end <= 1.0 + 2 * detector.hop
    assert faulty[-1].start >= 1.0 - 2 * detector.hop
    assert detector.faults["sound"] == len(faulty)


def test_invalid_output_of_the_model_is_faulty(tmp_path: Path) -> None:
    # A file whose weights are not finite is refused. These are, but their sums are not.
    detector = open_model(write_tiny_model(tmp_path / "bad.onnx", gain=3e38))
    predictions = predict(detector, tone(400))
    assert all(
        prediction.faulty and prediction.touch is Touch.NONE
        for prediction in predictions
    )
    assert detector.faults["model"] == len(predictions)


def test_a_window_is_classified_once_its_end_and_the_latency_have_passed(
    detector: Detector,
) -> None:
    for block in blocks(tone(100), 1):
        if predictions := detector.push(block):
            assert block.end / 48_000 == pytest.approx(
                predictions[0].end + detector.latency, abs=1e-9
            )
            return


def test_one_channel_for_a_model_of_two_is_refused(tmp_path: Path) -> None:
    detector = open_model(write_tiny_model(tmp_path / "two.onnx", channels=2))
    with pytest.raises(ModelError, match="needs 2"):
        predict(detector, tone(100))


def test_a_kind_of_the_future_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="kind crystal-ball"):
        open_model(write_tiny_model(tmp_path / "new.onnx", kind="crystal-ball"))


def test_a_model_that_is_not_there_lists_those_that_are() -> None:
    with pytest.raises(ModelError, match="no model papper"):
        model_path("papper")
