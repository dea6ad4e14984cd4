"""The models inside the package: small, of the paper's kind, and honest about what they learnt from."""

import pytest

from tactophone.perception import default_model, model_path, read_model, shipped_models

OURS = {"paper": 2, "paper-mono": 1}


def test_they_take_a_few_megabytes() -> None:
    assert set(OURS) <= set(shipped_models())
    assert sum(model_path(name).stat().st_size for name in OURS) < 4_000_000


@pytest.mark.parametrize(("name", "channels"), OURS.items())
def test_each_card_tells_the_papers_settings_and_its_scores(name: str, channels: int) -> None:
    card = read_model(model_path(name)).card
    assert default_model(channels) == name
    assert (card.name, card.channels, card.sample_rate, card.window_size) == (name, channels, 2000, 512)
    assert (card.gate.threshold_dbfs, card.gate.rule) == (-26.0, "rms")
    assert card.training["settings"]["labelling"]["loudness"] == "rms"
    assert "simulated sound alone" in card.licence
    told = card.scores["simulated, held out"]
    accuracy, low, high = told["balanced_accuracy, two-class rule"]
    assert 0.6 < low <= accuracy <= high
    assert "real sound" in card.scores
