from pathlib import Path

import numpy as np
import pytest

from tactophone.benchmark.recipe_methods import judge_by, recipe_method
from tactophone.dataset import Dataset
from tactophone.errors import DatasetError
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.predictions import predictor_for, scores_of
from tactophone.perception import open_window_detector, read_model
from tactophone.training.features.feature_tracks import FeatureSpec, listen
from tactophone.training.features.training_set import contact_threshold, prepare
from tactophone.training.recipes import RECIPES, train_way
from tactophone.types import AudioBlock, Prediction, Touch
from tests.sounds import UGLY_SIZES, blocks, tone
from tests.surfaces import RATE, TOUCHED, scrape, surfaces


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return surfaces(tmp_path_factory.mktemp("scrapes"))


@pytest.fixture(scope="module")
def model(dataset: Dataset) -> Path:
    path = dataset.root / "ours.onnx"
    train_way(path, dataset, "ours")
    return path


def predict(model: Path, samples: np.ndarray, size: int = 480, *, sample_rate: int = RATE) -> list[Prediction]:
    detector = open_window_detector(str(model), sample_rate=sample_rate)
    told = [one for block in blocks(samples, size, sample_rate=sample_rate) for one in detector.push(block)]
    return told + detector.flush()


def test_it_tells_surfaces_that_it_never_heard(model: Path) -> None:
    for rough in (False, True):
        told = [one for one in predict(model, scrape(rough=rough, seed=100 + rough)) if 0.5 < one.end < TOUCHED[1]]
        wanted = Touch.ROUGH if rough else Touch.SMOOTH
        assert np.mean([one.touch is wanted for one in told]) > 0.85


def test_no_contact_is_told_within_a_window(model: Path) -> None:
    told = predict(model, scrape(rough=True, seed=101))
    assert all(one.touch is Touch.NONE for one in told if one.end < TOUCHED[0] or one.start > TOUCHED[1])
    first = next(one.end for one in told if one.touch is not Touch.NONE)
    assert first < TOUCHED[0] + 0.032


@pytest.mark.parametrize("size", UGLY_SIZES)
def test_any_block_size_gives_the_same_bits(model: Path, size: int) -> None:
    samples = np.repeat(scrape(rough=True, seed=7)[:8000], 3, axis=0)
    whole = predict(model, samples, len(samples), sample_rate=48_000)
    assert predict(model, samples, size, sample_rate=48_000) == whole


def test_it_goes_on_when_the_air_microphone_dies(model: Path) -> None:
    samples = scrape(rough=True, seed=101)
    mono = predict(model, samples[:, :1])
    samples[:, 1] = 0
    assert predict(model, samples) == mono
    told = [one for one in mono if 0.5 < one.end < TOUCHED[1]]
    assert np.mean([one.touch is Touch.ROUGH for one in told]) > 0.9


def test_it_abstains_on_sound_unlike_any_it_knows_and_that_is_felt_as_plain_contact(model: Path) -> None:
    whistle = np.repeat(tone(3000, sample_rate=RATE), 2, axis=1)
    told = predict(model, whistle)[20:]
    assert all(one.probabilities[Touch.NONE] > 0.5 for one in told)
    assert {(one.touch, one.roughness) for one in told} == {(Touch.SMOOTH, 0.0)}


def test_the_fast_judge_says_what_the_live_detector_says(dataset: Dataset, model: Path) -> None:
    lesson = prepare(FeatureSpec(), dataset.recordings)
    graph = RECIPES["ours"].build(lesson)
    fast, live = judge_by(graph.SerializeToString(), lesson), predictor_for(read_model(model))
    for recording in dataset.recordings[:2]:
        one, other = fast(recording), live(recording)
        assert one.time == pytest.approx(other.time)
        assert one.probabilities == pytest.approx(other.probabilities, abs=1e-4)
        assert one.contact.tolist() == other.contact.tolist()


def test_a_method_is_fitted_and_scored(dataset: Dataset) -> None:
    judge = recipe_method("ours", channels=1).fit(dataset.recordings)
    scores = measure(scores_of(map(judge, dataset.recordings), "two-class"))
    assert scores["balanced_accuracy"] > 0.9


def test_the_gate_lets_one_quiet_window_in_a_hundred_through(dataset: Dataset) -> None:
    tracks = listen(dataset.recordings, FeatureSpec())
    threshold = contact_threshold(tracks)
    quiet = np.concatenate([track.level_dbfs[track.quiet()] for track in tracks])
    loud = np.concatenate([track.level_dbfs[track.touching()] for track in tracks])
    assert (quiet >= threshold).mean() <= 0.02
    assert (loud >= threshold).mean() > 0.9


def test_one_kind_of_surface_teaches_nothing(dataset: Dataset) -> None:
    smooth = [one for one in dataset.recordings if one.label is Touch.SMOOTH]
    with pytest.raises(DatasetError, match="smooth surfaces at most"):
        prepare(FeatureSpec(), smooth)


def test_garbage_is_a_fault_and_is_forgotten(model: Path) -> None:
    samples = scrape(rough=True, seed=101)
    samples[9000] = np.nan
    told = predict(model, samples)
    faulty = [one for one in told if one.faulty]
    assert faulty
    assert faulty[-1].end < 9000 / RATE + 0.05
    assert np.isfinite([one.probabilities for one in told]).all()


def test_a_block_of_one_channel_is_a_block_like_any_other(model: Path) -> None:
    detector = open_window_detector(str(model), sample_rate=RATE)
    assert detector.push(AudioBlock(np.zeros((512, 1), np.float32), RATE))
