"""Labels in a person's own words: the names of her folders, and her table."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.core.types import Touch
from tactophone_lab.datasets.open import open_dataset

WORDS = {"rau": "rough", "glatt": "smooth"}


def write_sounds(folder: Path) -> None:
    """Two surfaces a label, in folders with German names."""
    rng = np.random.default_rng(0)
    for label, loudness in (("rau", 0.2), ("Glatt", 0.02)):
        for surface in ("a", "b"):
            path = folder / label / surface / "1.wav"
            path.parent.mkdir(parents=True)
            sound = 1e-4 * rng.standard_normal((72_000, 1))
            sound[24_000:] += loudness * rng.standard_normal((48_000, 1))
            soundfile.write(path, sound, 48_000)


def test_folders_in_her_own_words_get_their_labels(tmp_path: Path) -> None:
    write_sounds(tmp_path)
    found = open_dataset(tmp_path, labels=WORDS)
    labels = {each.path.parts[-3]: each.label for each in found.recordings}
    assert labels == {"rau": Touch.ROUGH, "Glatt": Touch.SMOOTH}
    assert len(found.recordings) == 4


def test_a_word_that_is_no_label_is_refused(tmp_path: Path) -> None:
    write_sounds(tmp_path)
    with pytest.raises(DatasetError, match="rau=rugged: a label is one of"):
        open_dataset(tmp_path, labels={"rau": "rugged"})


def test_a_table_that_was_passed_over_is_named_with_what_to_do(tmp_path: Path) -> None:
    write_sounds(tmp_path)
    (tmp_path / "labels.tsv").write_text("file\tlabel\n")
    with pytest.raises(DatasetError) as refused:
        open_dataset(tmp_path)
    assert "labels.tsv was passed over" in str(refused.value)
    assert "--labels rau=rough,glatt=smooth" in str(refused.value)


def test_every_verb_that_scores_or_trains_takes_her_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sounds(tmp_path / "sound")
    model = tmp_path / "mine.onnx"
    words = ["--labels", "rau=rough,glatt=smooth"]
    sound = str(tmp_path / "sound")
    recipe = ["--recipe", "level"]
    assert main(["train", sound, *words, *recipe, "--out", str(model)]) == 0
    said = capsys.readouterr().err
    assert "trained on 4 recordings of 2 smooth and 2 rough surfaces" in said
    assert f"tactophone evaluate --data {sound} --labels rau=rough" in said
    scored = ["evaluate", str(model), "--data", sound, *words, "--json"]
    assert main(scored) == 0
