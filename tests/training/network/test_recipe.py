from dataclasses import asdict

import pytest

from tactophone.training.network.recipe import FOLLOWING, VARIANTS, Following, Variant, paper


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("following", FOLLOWING)
def test_what_paper_and_authors_agree_on(variant: Variant, following: Following) -> None:
    recipe = paper(variant, following=following)
    assert (recipe.epochs, recipe.learning_rate) == (5, 1e-4)
    assert recipe.channels == (1 if variant == "one-channel" else 2)
    assert recipe.name == f"{following}/{variant}"


def test_where_the_paper_and_its_authors_code_differ() -> None:
    told, coded = (asdict(paper("general", following=following)) for following in FOLLOWING)
    assert {key for key in told if told[key] != coded[key]} == {"following", "labelling", "class_weights"}
    assert coded["class_weights"] == (1.0, 0.05, 0.05)
    assert told["labelling"] == {
        "loudness": "rms", "threshold": pytest.approx(0.0501, abs=1e-4), "relative": False, "quiet_rough": True,
    }  # fmt: skip
    assert coded["labelling"] == {
        "loudness": "mean_absolute", "threshold": 1.0, "relative": True, "quiet_rough": False,
    }  # fmt: skip
