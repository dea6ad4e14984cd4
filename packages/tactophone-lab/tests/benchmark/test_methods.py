from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactophone import Touch
from tactophone.core.recordings.values import Recording
from tactophone_lab.benchmark.methods import (
    RENDERERS,
    NetworkMethod,
    RendererMethod,
    method_of,
    recipe_method,
)
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.metrics import measure
from tactophone_lab.evaluation.predict import TakePredictions, scores_of
from tactophone_lab.training.recipe_options import OPEN_GATE, network_settings
from tactophone_lab.training.trainer import NetworkRecipe
from tests.folders import audiofolder
from tests.surfaces import surfaces

SETTINGS = replace(
    network_settings("fine-tuned"),
    hop=32,
    batch_size=64,
    epochs=1,
    least_steps=80,
    learning_rate=3e-4,
)


def accuracy(predictions: list[TakePredictions]) -> float:
    called = [
        np.mean(take.probabilities[:, 2] > take.probabilities[:, 1]) > 0.5
        for take in predictions
    ]
    return float(
        np.mean(
            [
                rough == (take.recording.label is Touch.ROUGH)
                for rough, take in zip(called, predictions, strict=True)
            ]
        )
    )


@pytest.mark.slow
def test_level_alone_separates_recordings_that_differ_in_level(tmp_path: Path) -> None:
    recordings = open_dataset(audiofolder(tmp_path)).recordings
    level = recipe_method("level", channels=2).fit(recordings)
    network = method_of(NetworkRecipe(SETTINGS, gate=OPEN_GATE)).fit(recordings)
    predictions = [level(recording) for recording in recordings]
    assert accuracy(predictions) == 1
    assert predictions[0].time == pytest.approx(network(recordings[0]).time, abs=1e-3)


@pytest.mark.slow
def test_the_papers_network_trains_and_predicts_through_a_model_file(
    tmp_path: Path,
) -> None:
    recordings = open_dataset(audiofolder(tmp_path)).recordings
    predict = NetworkMethod(NetworkRecipe(SETTINGS, gate=OPEN_GATE)).fit(recordings)
    predictions = [predict(recording) for recording in recordings]
    assert all(take.contact.all() and len(take.time) for take in predictions)
    assert accuracy(predictions) > 0.7


def test_what_changes_the_predictions_changes_the_identity() -> None:
    job = NetworkRecipe(SETTINGS)
    others = [
        replace(job, seed=1),
        replace(job, settings=network_settings("general")),
        replace(job, gate=OPEN_GATE),
    ]
    assert len({NetworkMethod(variant).identity for variant in (job, *others)}) == 4
    texture = recipe_method("texture", channels=2)
    assert (
        len(
            {
                texture.identity,
                replace(texture, dropped=1).identity,
                recipe_method("level", channels=2).identity,
            }
        )
        == 3
    )


def test_a_regression_learns_separable_features_and_predicts_every_window(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    recordings = [
        Recording(
            Path(f"{n}.wav"),
            f"surface {n}",
            Touch.ROUGH if n % 2 else Touch.SMOOTH,
            ("contact",),
        )
        for n in range(6)
    ]
    rng = np.random.default_rng(0)

    def features(recording: Recording, renderer: str) -> tuple[np.ndarray, np.ndarray]:
        rough = recording.label is Touch.ROUGH
        return np.arange(50) / 100, rng.normal(3.0 * rough, 1.0, (50, 2))

    monkeypatch.setattr("tactophone_lab.benchmark.methods.vibration_features", features)
    predict = RendererMethod("direct").fit(recordings[:4])
    smooth, rough = (predict(recording) for recording in recordings[4:])
    assert smooth.contact.all()
    assert smooth.time.tolist() == (np.arange(50) / 100).tolist()
    np.testing.assert_allclose(rough.probabilities.sum(axis=1), 1.0, rtol=1e-6)
    assert (rough.probabilities.argmax(axis=1) == Touch.ROUGH).mean() > 0.9
    assert (smooth.probabilities.argmax(axis=1) == Touch.SMOOTH).mean() > 0.9


@pytest.mark.parametrize("name", RENDERERS)
def test_a_renderers_vibration_separates_plainly_different_surfaces(
    name: str, tmp_path: Path
) -> None:
    recordings = surfaces(tmp_path).recordings
    predict = RendererMethod(name).fit(recordings[:4])
    assert (
        measure(scores_of(map(predict, recordings[4:]), "two-class"))[
            "balanced_accuracy"
        ]
        > 0.6
    )
