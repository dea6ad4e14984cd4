from pathlib import Path

import pytest

from tactophone import DatasetError, Touch
from tactophone.core.recordings.read import find_recording, ground_truth
from tactophone_lab.datasets.open import open_dataset
from tests.folders import audiofolder, authors, write_sound, write_text


def test_a_manifest_may_be_named_itself(tmp_path: Path) -> None:
    assert len(open_dataset(audiofolder(tmp_path) / "metadata.csv").recordings) == 8


def test_a_folder_of_datasets_lists_them(tmp_path: Path) -> None:
    audiofolder(tmp_path / "one")
    authors(tmp_path / "two")
    with pytest.raises(DatasetError, match="name one: one, two"):
        open_dataset(tmp_path)


def test_a_folder_without_a_data_set_says_what_is_missing(tmp_path: Path) -> None:
    with pytest.raises(
        DatasetError, match="with the columns file_name, surface and label"
    ):
        open_dataset(tmp_path)
    with pytest.raises(DatasetError, match="no such folder"):
        open_dataset(tmp_path / "nowhere")


def test_the_label_of_a_file_is_found_in_its_own_dataset(tmp_path: Path) -> None:
    folder = audiofolder(tmp_path / "ours")
    assert [
        segment.label
        for segment in ground_truth(folder / "audio" / "00_0.flac", duration=1.0)
    ] == [Touch.ROUGH]
    theirs = authors(tmp_path / "theirs") / "opus" / "stereo" / "02_short_loud.wav"
    assert [segment.label for segment in ground_truth(theirs, duration=1.0)] == [
        Touch.SMOOTH
    ]
    assert find_recording(write_sound(folder / "audio" / "stray.flac")) is None


def test_a_file_beside_someone_elses_metadata_has_no_label(tmp_path: Path) -> None:
    write_text(tmp_path / "metadata.csv", "title,year", "x,2020")
    assert ground_truth(write_sound(tmp_path / "a.wav"), duration=1.0) == ()
