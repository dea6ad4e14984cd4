from dataclasses import asdict

import pytest

from tactophone.training.recipes import VARIANTS, Variant, network_settings


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("reference_code", [False, True])
def test_what_paper_and_reference_code_agree_on(variant: Variant, reference_code: bool) -> None:
    settings = network_settings(variant, reference_code=reference_code)
    assert (settings.epochs, settings.learning_rate) == (5, 1e-4)
    assert settings.channels == (1 if variant == "one-channel" else 2)
    assert settings.name == f"{'authors' if reference_code else 'paper'}/{variant}"


def test_where_the_paper_and_its_reference_code_differ() -> None:
    paper, code = (asdict(network_settings("general", reference_code=code)) for code in (False, True))
    assert {key for key in paper if paper[key] != code[key]} == {"reference_code", "labelling", "class_weights"}
    assert code["class_weights"] == (1.0, 0.05, 0.05)
    assert paper["labelling"] == {
        "loudness": "rms", "threshold": pytest.approx(0.0501, abs=1e-4), "relative": False, "quiet_rough": True,
    }  # fmt: skip
    assert code["labelling"] == {
        "loudness": "mean_absolute", "threshold": 1.0, "relative": True, "quiet_rough": False,
    }  # fmt: skip
