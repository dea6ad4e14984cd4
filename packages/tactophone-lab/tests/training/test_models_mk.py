"""Each shipped model's card says what `models.mk` trains; nothing is rendered here, so
sounds are not compared."""

import itertools
import json
import re
import shlex
import shutil
import subprocess
from collections.abc import Mapping
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path, shipped_models
from tactophone_lab.simulation.catalogue import catalogue
from tactophone_lab.training.baselines import FeatureRecipe
from tactophone_lab.training.recipes import RecipeFile

ROOT = Path(__file__).parents[4]
LMT_SURFACES = 17
"""Labelled smooth or rough."""

pytestmark = pytest.mark.skipif(not shutil.which("make"), reason="needs make")


def option(words: list[str], name: str) -> str:
    return words[words.index(name) + 1]


@cache
def commands(recordings: Path) -> list[list[str]]:
    """Return the words of every command of `make model`, with `lmt` among the
    recordings."""
    arguments = ["make", "-n", "model", f"TACTOPHONE_RECORDINGS={recordings}"]
    printed = subprocess.run(
        arguments, cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    return [
        shlex.split(line)
        for line in re.sub(r"\\\n", "", printed).splitlines()
        if " -m tactophone " in line
    ]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> list[list[str]]:
    recordings = tmp_path_factory.mktemp("recordings")
    (recordings / "lmt").mkdir()
    return commands(recordings)


def rendered(made: list[list[str]]) -> Mapping[str, tuple[set[int], str]]:
    """Return the numbers of the objects and the seed of each simulated set, by its
    folder's name."""
    sets = {}
    for words in made:
        if "dataset" in words and "&&" not in words:
            folder = next(word for word in words if word.startswith("build/sets/"))
            sets[Path(folder).name] = (
                {int(each) for each in option(words, "--objects").split(",")},
                option(words, "--seed"),
            )
    return sets


def training_of(name: str, made: list[list[str]]) -> tuple[list[str], RecipeFile]:
    """Return the names of the sets that a model is trained on, and its recipe."""
    found = [
        words
        for words in made
        if "train" in words and Path(option(words, "--out")).stem == name
    ]
    (words,) = found
    words = [word for word in words if word != "--no-score"]
    folders = [words[words.index("train") + 1]]
    folders += [later for word, later in itertools.pairwise(words) if word == "--also"]
    return [Path(folder).name for folder in folders], RecipeFile.read(
        ROOT / option(words, "--recipe")
    )


@pytest.mark.parametrize("name", shipped_models())
def test_each_card_names_the_sets_and_as_many_surfaces_as_its_command(
    name: str, made: list[list[str]]
) -> None:
    training = read_model(model_path(name)).card.training
    folders, _ = training_of(name, made)
    objects = set().union(
        *(rendered(made)[folder][0] for folder in folders if folder != "lmt")
    )
    surfaces = {each.surface.name for each in catalogue() if each.number in objects}
    assert training["dataset"] == " + ".join(folders)
    assert training["surfaces"] == len(surfaces) + LMT_SURFACES * ("lmt" in folders)


@pytest.mark.parametrize("name", shipped_models())
def test_each_card_has_the_recipe_of_its_command(
    name: str, made: list[list[str]]
) -> None:
    card, recipe = (
        read_model(model_path(name)).card,
        training_of(name, made)[1].configured(),
    )
    if isinstance(recipe, FeatureRecipe):
        through = [
            f"{codec.name}, {codec.bitrate_bps} bit/s, {codec.bandwidth:g} Hz"
            for codec in recipe.codecs
        ]
        expected: dict[str, Any] = {
            "recipe": recipe.name,
            "through": ["nothing", *through],
        }
        assert card.decision == recipe.recipe.response_for(card.tip).decision
    else:
        settings = json.loads(json.dumps(asdict(recipe.settings)))
        expected = {
            "recipe": recipe.settings.name,
            "settings": settings,
            "seed": recipe.seed,
        }
    assert {key: card.training[key] for key in expected} == expected


@pytest.mark.parametrize("name", shipped_models())
def test_each_model_is_scored_on_other_objects_and_seeds_than_it_is_trained_on(
    name: str, made: list[list[str]]
) -> None:
    card, sets = read_model(model_path(name)).card, rendered(made)
    trained = [sets[folder] for folder in training_of(name, made)[0] if folder != "lmt"]
    objects, seed = sets[card.scores["simulated, held out"]["dataset"]]
    assert all(
        objects.isdisjoint(others) and seed != other for others, other in trained
    )
    assert card.scores["simulated, held out"]["surfaces"] == len(objects)
