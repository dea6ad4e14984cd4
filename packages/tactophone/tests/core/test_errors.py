"""Messages about unknown names end in the nearest known one."""

from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.core.errors import TactophoneError, did_you_mean
from tactophone.signal.haptics.profiles import open_profile
from tactophone.signal.perception.models import model_path
from tactophone_lab.benchmark.methods import methods_for
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split
from tactophone_lab.simulation.catalogue import find
from tests.folders import audiofolder


def test_the_nearest_name_or_one_that_holds_the_word() -> None:
    assert did_you_mean("papr", ["paper", "texture"]) == "; did you mean paper?"
    assert (
        did_you_mean("marble", ["polished marble", "slate"])
        == "; did you mean polished marble?"
    )
    assert (
        did_you_mean("granitt", ["flamed granite", "slate"])
        == "; did you mean flamed granite?"
    )
    assert did_you_mean("xyz", ["paper"]) == ""


@pytest.mark.parametrize(
    ("words", "hint"),
    [(["feal"], "feel"), (["feel", "a.wav", "--profile", "papr"], "paper")],
)
def test_verbs_and_choices_are_suggested(
    words: list[str], hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(words)
    assert f"did you mean {hint}?" in capsys.readouterr().err


def test_objects_models_profiles_methods_and_splits_are_suggested(
    tmp_path: Path,
) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    for call, hint in (
        (lambda: find("polished marbel"), "polished marble"),
        (lambda: model_path("textur"), "texture"),
        (lambda: open_profile("perceptul"), "perceptual"),
        (lambda: methods_for(dataset, ["textures"]), "texture"),
        (lambda: split(dataset, "predefind"), "predefined"),
    ):
        with pytest.raises(TactophoneError, match=f"did you mean {hint}"):
            call()
