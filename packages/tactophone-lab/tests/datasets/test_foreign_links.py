"""Links out of a data set's folder: named with their target, read only where that is
asked for, and never copied or written through."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.read import find_recording
from tactophone_lab.datasets.convert import convert, write_card
from tactophone_lab.datasets.open import open_dataset
from tests.folders import audiofolder, authors, write_sound, write_text


def class_folders(root: Path) -> Path:
    for label in ("rough", "smooth"):
        write_sound(root / label / f"{label}_1.wav", level=0.3, seed=len(label))
    return root


def manifest(root: Path) -> Path:
    class_folders(root)
    return write_text(
        root / "manifest.csv",
        "file,surface,label",
        "rough/rough_1.wav,slate,rough",
        "smooth/smooth_1.wav,glass,smooth",
    ).parent


LAYOUTS = {
    "class folders": (class_folders, "rough/rough_1.wav"),
    "manifest": (manifest, "rough/rough_1.wav"),
    "metadata": (audiofolder, "audio/00_0.flac"),
    "authors": (authors, "opus/stereo/00_wiggle.wav"),
}


def linked(tmp_path: Path, layout: str) -> tuple[Path, Path]:
    """Make a data set whose one file is a link out of it; returns it and the target."""
    make, name = LAYOUTS[layout]
    folder = make(tmp_path / "set")
    target = tmp_path / "elsewhere" / Path(name).name
    target.parent.mkdir()
    shutil.move(folder / name, target)
    (folder / name).symlink_to(target)
    return folder, target


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_foreign_link_is_named_in_every_layout_and_read_where_asked_for(
    layout: str, tmp_path: Path
) -> None:
    folder, target = linked(tmp_path, layout)
    dataset = open_dataset(folder)
    (problem,) = dataset.problems
    assert str(target) in problem.message
    assert "--follow-links" in problem.message
    followed = open_dataset(folder, follow_links=True)
    assert not followed.problems
    assert len(followed.recordings) == len(dataset.recordings) + 1


@pytest.mark.parametrize("layout", LAYOUTS)
def test_what_a_foreign_link_leads_to_is_never_copied(
    layout: str, tmp_path: Path
) -> None:
    folder, target = linked(tmp_path, layout)
    followed = open_dataset(folder, follow_links=True)
    with pytest.raises(DatasetError, match="not copied") as caught:
        convert(followed, tmp_path / "own")
    assert str(target) in str(caught.value)


def test_check_and_show_follow_links_only_with_the_option(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, target = linked(tmp_path, "metadata")
    assert main(["dataset", "check", str(folder)]) == 1
    assert str(target) in capsys.readouterr().out
    assert main(["dataset", "check", str(folder), "--follow-links"]) == 0
    assert main(["dataset", "show", str(folder), "--follow-links", "--json"]) == 0
    assert '"recordings": 8' in capsys.readouterr().out


def test_a_linked_recording_keeps_what_its_manifest_says_when_it_is_felt(
    tmp_path: Path,
) -> None:
    folder, _ = linked(tmp_path, "metadata")
    found = find_recording(folder / "audio" / "00_0.flac")
    assert found
    assert found.channels == ("contact", "air")


def label_names(root: Path) -> Path:
    class_folders(root)
    return root / "README.md"


def event_table(root: Path) -> Path:
    class_folders(root)
    return write_text(
        root / "events.tsv",
        "filename\tonset\toffset\tevent_label",
        "rough_1.wav\t0.1\t0.4\trough",
    )


def track(root: Path) -> Path:
    class_folders(root)
    return write_text(root / "rough" / "rough_1.txt", "0.1\t0.4\trough")


@pytest.mark.parametrize("make", [event_table, track])
def test_labels_over_time_behind_a_foreign_link_are_named_and_not_read(
    make: Callable[[Path], Path], tmp_path: Path
) -> None:
    table = make(tmp_path / "set")
    target = tmp_path / "private.txt"
    shutil.move(table, target)
    table.symlink_to(target)
    dataset = open_dataset(tmp_path / "set")
    assert [problem.kind for problem in dataset.problems] == ["link"]
    assert not any(recording.segments for recording in dataset.recordings)
    followed = open_dataset(tmp_path / "set", follow_links=True)
    assert any(recording.segments for recording in followed.recordings)


@pytest.mark.parametrize("name", ["metadata.csv", "README.md", "labels.toml"])
def test_a_table_behind_a_foreign_link_is_not_read(name: str, tmp_path: Path) -> None:
    folder = audiofolder(tmp_path / "set")
    private = write_text(tmp_path / "private", "secret,words")
    (folder / name).unlink(missing_ok=True)
    (folder / name).symlink_to(private)
    with pytest.raises(DatasetError, match="outside") as caught:
        open_dataset(folder)
    assert "secret" not in str(caught.value)


def test_nothing_is_written_through_a_link(tmp_path: Path) -> None:
    folder = audiofolder(tmp_path / "set")
    private = write_text(tmp_path / "private", "mine")
    dataset = open_dataset(folder)
    (folder / "README.md").symlink_to(private)
    write_card(dataset)
    assert private.read_text() == "mine\n"
    assert not (folder / "README.md").is_symlink()
