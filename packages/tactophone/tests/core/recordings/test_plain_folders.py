"""A researcher's own folder is read as it is: class folders, Hugging Face's class
names, numbered labels."""

from pathlib import Path

import pytest

from tactophone.core.errors import DatasetError
from tactophone.core.types import Touch
from tactophone_lab.datasets.open import open_dataset
from tests.folders import write_sound


def test_class_folders_are_a_data_set_without_an_import(tmp_path: Path) -> None:
    for label in ("rough", "smooth"):
        (tmp_path / label).mkdir()
        write_sound(tmp_path / label / "brick_01.wav")
    found = {(each.surface, each.label) for each in open_dataset(tmp_path).recordings}
    assert found == {("rough brick", Touch.ROUGH), ("smooth brick", Touch.SMOOTH)}


def test_files_of_single_microphones_name_the_import(tmp_path: Path) -> None:
    (tmp_path / "rough").mkdir()
    for name in ("brick_contact.wav", "brick_air.wav"):
        write_sound(tmp_path / "rough" / name)
    with pytest.raises(DatasetError, match="dataset import"):
        open_dataset(tmp_path)


CARD = """---
dataset_info:
  features:
  - name: label
    dtype:
      class_label:
        names:
          '0': rough
          '1': smooth
---
"""


@pytest.mark.parametrize("way", ["card", "toml", "option"])
def test_numbered_labels_have_names(tmp_path: Path, way: str) -> None:
    write_sound(tmp_path / "a_1.wav")
    write_sound(tmp_path / "b_1.wav")
    (tmp_path / "metadata.csv").write_text("file_name,label\na_1.wav,0\nb_1.wav,1\n")
    if way == "card":
        (tmp_path / "README.md").write_text(CARD)
    elif way == "toml":
        (tmp_path / "labels.toml").write_text('0 = "rough"\n1 = "smooth"\n')
    labels = {"0": "rough", "1": "smooth"} if way == "option" else None
    found = [
        (each.surface, each.label)
        for each in open_dataset(tmp_path, labels=labels).recordings
    ]
    assert found == [("a", Touch.ROUGH), ("b", Touch.SMOOTH)]


def test_a_broken_labels_file_says_what_to_write(tmp_path: Path) -> None:
    write_sound(tmp_path / "a_1.wav")
    (tmp_path / "metadata.csv").write_text("file_name,label\na_1.wav,0\n")
    (tmp_path / "labels.toml").write_text("0: rough")
    with pytest.raises(DatasetError, match='write a line such as 0 = "smooth"'):
        open_dataset(tmp_path)
