from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import DatasetError
from tactophone_lab.datasets.checks import check
from tactophone_lab.datasets.convert import convert, set_columns, write_card
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split
from tests.folders import audiofolder, authors


def test_the_authors_layout_becomes_ours_without_a_change_of_sound(
    tmp_path: Path,
) -> None:
    source = open_dataset(authors(tmp_path / "theirs"))
    convert(source, tmp_path / "ours")
    made = open_dataset(tmp_path / "ours")
    assert check(made) == ()
    assert [
        (recording.surface, recording.label, recording.take, recording.known("split"))
        for recording in made.recordings
    ] == [
        (recording.surface, recording.label, recording.take, recording.known("split"))
        for recording in source.recordings
    ]
    before, after = (
        soundfile.read(dataset.recordings[0].path)[0] for dataset in (source, made)
    )
    np.testing.assert_array_equal(before, after)
    assert {recording.path.suffix for recording in made.recordings} == {".flac"}


def test_nothing_is_written_over_another_data_set(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    with pytest.raises(DatasetError, match="a new folder"):
        convert(dataset, tmp_path)


def test_a_copy_replaces_a_link_and_never_what_it_leads_to(tmp_path: Path) -> None:
    dataset, victim = open_dataset(audiofolder(tmp_path / "a")), tmp_path / "victim.txt"
    victim.write_text("mine")
    for recording in dataset.recordings:
        copy = (
            tmp_path
            / "b"
            / recording.path.relative_to(dataset.root).with_suffix(".flac")
        )
        copy.parent.mkdir(parents=True, exist_ok=True)
        for name in (copy, copy.with_name(f".{copy.name}.part")):
            name.symlink_to(victim)
    convert(dataset, tmp_path / "b")
    assert victim.read_text() == "mine"
    assert check(open_dataset(tmp_path / "b")) == ()


def test_a_file_that_cannot_be_converted_is_named_and_leaves_no_half(
    tmp_path: Path,
) -> None:
    dataset = open_dataset(audiofolder(tmp_path / "a"))
    dataset.recordings[0].path.write_text("no sound")
    with pytest.raises(DatasetError, match="00_0"):
        convert(dataset, tmp_path / "b")
    assert not list((tmp_path / "b").rglob("*.flac"))


def test_a_split_is_written_and_read_back(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    sides = {
        "stone 00": "test",
        "stone 01": "test",
        "stone 02": "train",
        "stone 03": "train",
    }
    set_columns(dataset, {surface: {"split": side} for surface, side in sides.items()})
    (fold,) = split(open_dataset(tmp_path), "predefined")
    assert {recording.surface for recording in fold.test} == {"stone 00", "stone 01"}


def test_a_split_wants_a_manifest_of_ours(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="dataset import"):
        set_columns(open_dataset(authors(tmp_path)), {})


def test_columns_are_not_written_where_words_of_a_person_would_be_lost(
    tmp_path: Path,
) -> None:
    manifest = audiofolder(tmp_path) / "metadata.csv"
    manifest.write_text(manifest.read_text().replace(",rough,", ",raugh,", 1))
    before = manifest.read_text()
    dataset = open_dataset(tmp_path)
    with pytest.raises(DatasetError, match="would lose this: correct it first"):
        set_columns(dataset, {"stone 00": {"split": "test"}})
    assert manifest.read_text() == before


def test_a_card_that_a_person_completed_is_not_replaced(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    card = write_card(dataset)
    assert write_card(dataset) == card
    completed = card.read_text().replace("Licence: not stated", "Licence: CC0")
    card.write_text(completed)
    with pytest.raises(DatasetError, match="may hold words of yours"):
        write_card(dataset)
    assert card.read_text() == completed


def test_the_card_lists_the_contents(tmp_path: Path) -> None:
    card = write_card(open_dataset(audiofolder(tmp_path))).read_text()
    assert card.startswith("---\n")
    assert (
        "8 recordings of 4 surfaces, 0.1 minutes, at 4000 Hz. Channels: contact and "
        "air." in card
    )
    assert "| stone 00 | rough | not stated | hand, table | 2 |" in card
