from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import AudioBlock, Prediction, Touch
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.window_detector import WindowDetector
from tactophone_lab.benchmark.methods import graph_predictor, recipe_method
from tactophone_lab.evaluation.metrics import measure
from tactophone_lab.evaluation.predict import model_predictor, scores_of
from tactophone_lab.training.baselines import feature_recipe, tip_settings
from tactophone_lab.training.linear import build_texture
from tactophone_lab.training.recipe_options import FeatureSpec, TrainingOptions
from tactophone_lab.training.recipes import RECIPES, configure
from tactophone_lab.training.sets import build_training_set
from tactophone_lab.training.tracks import extract_features, noise_level
from tests.sounds import ODD_SIZES, blocks, tone
from tests.surfaces import RATE, TOUCHED, scrape, surfaces


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return surfaces(tmp_path_factory.mktemp("scrapes"))


@pytest.fixture(scope="module")
def model(dataset: Dataset) -> Path:
    path = dataset.root / "texture.onnx"
    configure("texture").train(path, dataset)
    return path


def predict(
    model: Path, samples: np.ndarray, size: int = 480, *, sample_rate: int = RATE
) -> list[Prediction]:
    detector = WindowDetector(read_model(model), sample_rate=sample_rate)
    predictions = [
        each
        for block in blocks(samples, size, sample_rate=sample_rate)
        for each in detector.push(block)
    ]
    return predictions + detector.flush()


@pytest.mark.slow
def test_it_classifies_surfaces_it_was_not_trained_on(model: Path) -> None:
    for rough in (False, True):
        predictions = [
            each
            for each in predict(model, scrape(rough=rough, seed=100 + rough))
            if 0.5 < each.end < TOUCHED[1]
        ]
        expected = Touch.ROUGH if rough else Touch.SMOOTH
        assert np.mean([each.touch is expected for each in predictions]) > 0.85


def test_a_model_of_simulated_touch_says_that_its_tip_sounds_as_simulated() -> None:
    real = Recording(Path("real.wav"), "slate")
    simulated = real.with_properties(source="simulated")
    assert tip_settings("pad", [real]) == {"tip": "pad"}
    assert tip_settings("", [simulated]) == {"tip": ""}
    learnt = tip_settings("pad", [real, simulated])
    assert learnt == {"tip": "pad", "tip_sound": "simulated"}


def test_contact_is_detected_within_a_window(model: Path) -> None:
    predictions = predict(model, scrape(rough=True, seed=101))
    assert all(
        each.touch is Touch.NONE
        for each in predictions
        if each.end < TOUCHED[0] or each.start > TOUCHED[1]
    )
    first = next(each.end for each in predictions if each.touch is not Touch.NONE)
    assert first < TOUCHED[0] + 0.032


@pytest.mark.slow
@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_bits(model: Path, size: int) -> None:
    samples = np.repeat(scrape(rough=True, seed=7)[:8000], 3, axis=0)
    whole = predict(model, samples, len(samples), sample_rate=48_000)
    assert predict(model, samples, size, sample_rate=48_000) == whole


def test_it_continues_when_the_air_microphone_dies(model: Path) -> None:
    samples = scrape(rough=True, seed=101)
    mono = predict(model, samples[:, :1])
    samples[:, 1] = 0
    assert predict(model, samples) == mono
    predictions = [each for each in mono if 0.5 < each.end < TOUCHED[1]]
    assert np.mean([each.touch is Touch.ROUGH for each in predictions]) > 0.9


def test_unknown_sound_is_none_and_rendered_as_plain_contact(model: Path) -> None:
    whistle = np.repeat(tone(3000, sample_rate=RATE), 2, axis=1)
    predictions = predict(model, whistle)[20:]
    assert all(each.probabilities[Touch.NONE] > 0.5 for each in predictions)
    assert {(each.touch, each.roughness) for each in predictions} == {
        (Touch.SMOOTH, 0.0)
    }


@pytest.mark.slow
@pytest.mark.parametrize("tip", ["pad", "stylus"])
def test_the_offline_predictor_equals_the_live_detector(
    dataset: Dataset, tmp_path: Path, tip: str
) -> None:
    job = feature_recipe(RECIPES["texture"], TrainingOptions(channels=2, tip=tip))
    job.train(tmp_path / "model.onnx", dataset)
    training_set = job.training_set(dataset.recordings)
    assert training_set.spec.unevenness == (tip == "stylus")
    graph = build_texture(training_set).SerializeToString()
    offline, live = (
        graph_predictor(graph, training_set),
        model_predictor(read_model(tmp_path / "model.onnx")),
    )
    for recording in dataset.recordings[:2]:
        first, other = offline(recording), live(recording)
        assert first.time == pytest.approx(other.time)
        assert first.probabilities == pytest.approx(other.probabilities, abs=1e-4)
        assert first.contact.tolist() == other.contact.tolist()


def test_a_method_is_fitted_and_scored(dataset: Dataset) -> None:
    predict_take = recipe_method("texture", channels=1).fit(dataset.recordings)
    scores = measure(scores_of(map(predict_take, dataset.recordings), "two-class"))
    assert scores["balanced_accuracy"] > 0.9


def test_the_gate_lets_one_quiet_window_in_a_hundred_through(dataset: Dataset) -> None:
    tracks = extract_features(dataset.recordings, FeatureSpec())
    threshold = noise_level(tracks)
    quiet = np.concatenate([track.level_dbfs[track.quiet()] for track in tracks])
    loud = np.concatenate([track.level_dbfs[track.touching()] for track in tracks])
    assert (quiet >= threshold).mean() <= 0.02
    assert (loud >= threshold).mean() > 0.9


def test_one_label_alone_is_an_error(dataset: Dataset) -> None:
    smooth = [take for take in dataset.recordings if take.label is Touch.SMOOTH]
    with pytest.raises(DatasetError, match="on smooth surfaces alone"):
        build_training_set(FeatureSpec(), smooth)


def test_invalid_samples_are_a_fault_and_have_no_lasting_effect(model: Path) -> None:
    samples = scrape(rough=True, seed=101)
    samples[9000] = np.nan
    predictions = predict(model, samples)
    faulty = [each for each in predictions if each.faulty]
    assert faulty
    assert faulty[-1].end < 9000 / RATE + 0.05
    assert np.isfinite([each.probabilities for each in predictions]).all()


def test_a_block_of_one_channel_is_accepted(model: Path) -> None:
    detector = WindowDetector(read_model(model), sample_rate=RATE)
    assert detector.push(AudioBlock(np.zeros((512, 1), np.float32), RATE))
