import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import cast

import numpy as np
import onnxruntime
import pytest
from sklearn.base import ClassifierMixin
from sklearn.linear_model import LogisticRegression

from tactophone.core.errors import ConfigError
from tactophone.core.recordings.values import Dataset
from tactophone.signal.perception.model_file import FEATURES, read_model
from tactophone_lab.benchmark.methods import recipe_method
from tactophone_lab.evaluation.metrics import measure
from tactophone_lab.evaluation.predict import model_predictor, scores_of
from tactophone_lab.training.baselines import FeatureRecipe
from tactophone_lab.training.recipe_options import (
    VARIANTS,
    FeatureSpec,
    TrainingOptions,
    Variant,
    network_settings,
)
from tactophone_lab.training.recipes import (
    FEATURE_RECIPES,
    RECIPES,
    RecipeFile,
    configure,
)
from tactophone_lab.training.sets import build_training_set
from tests.surfaces import surfaces

SEPARATES = {"texture": 0.9, "rules": 0.8}
"""Balanced accuracy that each recipe reaches on surfaces so plainly different; the
others use too little."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return surfaces(tmp_path_factory.mktemp("scrapes"))


@pytest.mark.slow
@pytest.mark.parametrize("name", FEATURE_RECIPES)
def test_each_recipe_makes_a_detector_that_runs_live_with_the_same_output(
    name: str, dataset: Dataset, tmp_path: Path
) -> None:
    path = tmp_path / f"{name}.onnx"  # the name on the card is the file's
    configure(name).train(path, dataset)
    model = read_model(path)
    assert (model.card.name, model.card.kind) == (name, RECIPES[name].features)
    offline, live = (
        recipe_method(name, channels=2).fit(dataset.recordings),
        model_predictor(model),
    )
    first, second = offline(dataset.recordings[1]), live(dataset.recordings[1])
    assert first.time == pytest.approx(second.time)
    assert first.probabilities == pytest.approx(second.probabilities, abs=2e-3)
    assert first.contact.tolist() == second.contact.tolist()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tip", "memory", "rough_on"),
    [("pad", 0.12, 0.8), ("stylus", 0.25, 0.6), ("", 0.25, 0.6)],
)
def test_a_model_of_the_pad_has_the_response_of_the_pad(
    tip: str, memory: float, rough_on: float, dataset: Dataset, tmp_path: Path
) -> None:
    configure("texture", TrainingOptions(tip=tip)).train(
        tmp_path / "model.onnx", dataset
    )
    card = read_model(tmp_path / "model.onnx").card
    assert (card.settings["memory"], card.decision.rough_on) == (memory, rough_on)


@pytest.mark.slow
@pytest.mark.parametrize("name", SEPARATES)
def test_recipes_separate_what_is_plainly_different(
    name: str, dataset: Dataset
) -> None:
    predict = recipe_method(name, channels=2).fit(dataset.recordings[:6])
    scores = measure(scores_of(map(predict, dataset.recordings[6:]), "two-class"))
    assert scores["balanced_accuracy"] > SEPARATES[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", FEATURE_RECIPES)
def test_each_recipe_works_on_one_channel(name: str, dataset: Dataset) -> None:
    take = recipe_method(name, channels=1).fit(dataset.recordings)(
        dataset.recordings[0]
    )
    assert np.isfinite(take.probabilities).all()
    assert take.probabilities.sum(axis=1) == pytest.approx(
        np.ones(len(take.time)), abs=1e-4
    )


@pytest.mark.slow
def test_the_graph_predicts_what_scikit_learn_does(
    dataset: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Weights are written as they were fitted: checked on the windows that they were
    fitted to."""
    fitted: list[tuple[ClassifierMixin, np.ndarray]] = []
    fit = LogisticRegression.fit

    def keep(
        model: ClassifierMixin, features: np.ndarray, *given: object, **named: object
    ) -> object:
        fitted.append((model, features))
        return fit(model, features, *given, **named)

    monkeypatch.setattr(LogisticRegression, "fit", keep)
    training_set = build_training_set(FeatureSpec("cues"), dataset.recordings)
    graph = cast(FeatureRecipe, configure("level")).build(training_set)
    ((model, features),) = fitted
    session = onnxruntime.InferenceSession(
        graph.SerializeToString(), providers=["CPUExecutionProvider"]
    )
    (log_probabilities,) = session.run(
        None, {FEATURES: training_set.examples.thinned().features}
    )
    assert np.exp(log_probabilities[:, 2]) == pytest.approx(
        model.predict_proba(features)[:, 1], abs=1e-5
    )


def test_listing_recipes_imports_no_classifier() -> None:
    script = (
        "import sys; from tactophone_lab.training.recipes import RECIPES; "
        "list(RECIPES); "
        "print([name for name in ('torch', 'sklearn', 'onnx', 'scipy') if name in "
        "sys.modules])"
    )
    assert (
        subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True
        ).stdout
        == "[]\n"
    )


def test_a_recipe_file_names_a_recipe_and_what_differs_from_it(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(
        'recipe = "paper"\nvariant = "one-channel"\nepochs = 2\nlearning_rate = '
        '0.001\ncontact_threshold = "off"\n'
    )
    recipe = RecipeFile.read(tmp_path / "mine.toml").configured(
        start=tmp_path / "a.onnx"
    )
    options = TrainingOptions(
        variant="one-channel", contact_threshold="off", epochs=2, learning_rate=0.001
    )
    assert recipe == configure("paper", options, start=tmp_path / "a.onnx")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("epochs = 0", "mine.toml.*>= 1.*epochs"),
        ("epoch = 3", "unknown field `epoch`.*may hold channels"),
        ("recipe = 'textures'", "no recipe textures.*did you mean texture"),
        ("recipe = ", "mine.toml"),
        ("#" * 20_000, "mine.toml: 20000 bytes, but at most 16384"),
    ],
)
def test_a_recipe_file_that_cannot_be_followed_says_why(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigError, match=message):
        RecipeFile.read(tmp_path / "mine.toml")


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("reference_code", [False, True])
def test_what_paper_and_reference_code_agree_on(
    variant: Variant, reference_code: bool
) -> None:
    settings = network_settings(variant, reference_code=reference_code)
    assert (settings.epochs, settings.learning_rate) == (5, 1e-4)
    assert settings.channels == (1 if variant == "one-channel" else 2)
    assert settings.name == f"{'authors' if reference_code else 'paper'}/{variant}"


def test_where_the_paper_and_its_reference_code_differ() -> None:
    paper, code = (
        asdict(network_settings("general", reference_code=code))
        for code in (False, True)
    )
    assert {key for key in paper if paper[key] != code[key]} == {
        "reference_code",
        "labelling",
        "class_weights",
    }
    assert code["class_weights"] == (1.0, 0.05, 0.05)
    assert paper["labelling"] == {
        "loudness": "rms",
        "threshold": pytest.approx(0.0501, abs=1e-4),
        "relative": False,
        "quiet_rough": True,
    }
    assert code["labelling"] == {
        "loudness": "mean_absolute",
        "threshold": 1.0,
        "relative": True,
        "quiet_rough": False,
    }


def test_every_recipe_file_of_the_examples_can_be_followed() -> None:
    files = sorted((Path(__file__).parents[4] / "examples" / "recipes").glob("*.toml"))
    assert len(files) >= 6
    channels = {
        file.stem: RecipeFile.read(file).configured().channels for file in files
    }
    assert [name for name, count in channels.items() if count == 1] == [
        "all-contact",
        "paper-mono",
        "plastic",
        "stylus",
    ]
