from pathlib import Path

import numpy as np
import pytest

from tactophone.benchmark.recipe_methods import recipe_method
from tactophone.cli.train import RECIPE_NAMES
from tactophone.dataset import Dataset
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.predictions import predictor_for, scores_of
from tactophone.perception import read_model
from tactophone.training.features.feature_tracks import FeatureSpec
from tactophone.training.features.training_set import prepare
from tactophone.training.recipes import RECIPES, train_way
from tests.surfaces import surfaces

TELLS = {"ours": 0.9, "logistic": 0.9, "boosting": 0.9, "rules": 0.8, "scalogram-cnn": 0.8, "surface": 0.8}
"""Balanced accuracy that each way reaches on surfaces so plainly different; the others hear too little."""


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return surfaces(tmp_path_factory.mktemp("scrapes"))


@pytest.fixture(autouse=True)
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A quarter of the network's steps: enough for surfaces so plainly different."""
    monkeypatch.setattr("tactophone.training.features.scalogram.STEPS", 100)


@pytest.mark.parametrize("name", RECIPES)
def test_each_way_is_a_detector_that_runs_live_and_says_the_same(name: str, dataset: Dataset, tmp_path: Path) -> None:
    path = tmp_path / "way.onnx"
    card = train_way(path, dataset, name)
    assert card.kind == RECIPES[name].kind
    fast, live = recipe_method(name, channels=2).fit(dataset.recordings), predictor_for(read_model(path))
    one, other = fast(dataset.recordings[1]), live(dataset.recordings[1])
    assert one.time == pytest.approx(other.time)
    assert one.probabilities == pytest.approx(other.probabilities, abs=2e-3)
    assert one.contact.tolist() == other.contact.tolist()


@pytest.mark.parametrize("name", TELLS)
def test_ways_tell_what_is_plainly_different(name: str, dataset: Dataset) -> None:
    judge = recipe_method(name, channels=2).fit(dataset.recordings[:6])
    scores = measure(scores_of(map(judge, dataset.recordings[6:]), "two-class"))
    assert scores["balanced_accuracy"] > TELLS[name]


@pytest.mark.parametrize("name", RECIPES)
def test_each_way_serves_one_channel(name: str, dataset: Dataset) -> None:
    told = recipe_method(name, channels=1).fit(dataset.recordings)(dataset.recordings[0])
    assert np.isfinite(told.probabilities).all()
    assert told.probabilities.sum(axis=1) == pytest.approx(np.ones(len(told.time)), abs=1e-4)


def test_boosted_trees_are_written_out_as_they_were_grown(dataset: Dataset) -> None:
    lesson = prepare(FeatureSpec("texture"), dataset.recordings)
    graph = RECIPES["boosting"].build(lesson)
    (trees,) = [node for node in graph.graph.node if node.op_type == "TreeEnsembleRegressor"]
    modes = next(one for one in trees.attribute if one.name == "nodes_modes").strings
    assert {b"LEAF", b"BRANCH_LEQ"} == set(modes)


def test_train_knows_every_way() -> None:
    assert set(RECIPE_NAMES) == {"paper", *RECIPES}
