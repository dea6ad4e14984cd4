"""Folders as other people's systems leave them: read, or named with their cure."""

import hashlib
import os
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.metadata import read_metadata
from tactophone.core.recordings.read import find_recording
from tactophone_lab.datasets.checks import check
from tactophone_lab.datasets.convert import convert
from tactophone_lab.datasets.open import open_dataset
from tests.folders import write_sound, write_text

RESOURCE_FORK = b"\0\x05\x16\x07\0\x02\0\0Mac OS X        " + bytes(4032)


def classes(folder: Path) -> Path:
    """Two recordings in each of the folders rough/ and smooth/."""
    for number, label in enumerate(("rough", "smooth")):
        for take in (1, 2):
            write_sound(
                folder / label / f"thing{number}_{take}.wav", seed=2 * number + take
            )
    return folder


def snapshot(folder: Path) -> Path:
    """A data set as Hugging Face's client leaves it: links into ``blobs/``."""
    hub = folder / "datasets--lab--finger"
    revision = hub / "snapshots" / "0123abcd"
    (hub / "blobs").mkdir(parents=True)
    rows = ["file_name,surface,label"]

    def keep(content: bytes, name: str) -> None:
        blob = hub / "blobs" / hashlib.sha256(content).hexdigest()
        blob.write_bytes(content)
        (revision / name).parent.mkdir(parents=True, exist_ok=True)
        (revision / name).symlink_to(os.path.relpath(blob, (revision / name).parent))

    for number, label in enumerate(("rough", "smooth")):
        sound = write_sound(folder / "sound.wav", seed=number)
        keep(sound.read_bytes(), f"data/{label}.wav")
        rows.append(f"data/{label}.wav,thing {number},{label}")
    keep("\n".join(rows).encode(), "metadata.csv")
    return revision


def test_a_snapshot_of_a_hub_is_read_and_imported_whole(tmp_path: Path) -> None:
    revision = snapshot(tmp_path)
    dataset = open_dataset(revision)
    assert len(dataset.recordings) == 2
    assert not [problem for problem in check(dataset) if problem.fatal]
    converted = convert(dataset, tmp_path / "own")
    assert [recording.path for recording in converted.recordings] == [
        tmp_path / "own/data/rough.flac",
        tmp_path / "own/data/smooth.flac",
    ]


def test_a_recording_of_a_snapshot_keeps_its_label_when_it_is_felt_alone(
    tmp_path: Path,
) -> None:
    found = find_recording(snapshot(tmp_path) / "data" / "rough.wav")
    assert found
    assert found.rough


def test_a_link_out_of_a_snapshot_is_named_with_its_target(tmp_path: Path) -> None:
    revision = snapshot(tmp_path)
    private = write_sound(tmp_path / "private.wav")
    (revision / "data" / "rough.wav").unlink()
    (revision / "data" / "rough.wav").symlink_to(private)
    dataset = open_dataset(revision)
    assert len(dataset.recordings) == 1
    (problem,) = dataset.problems
    assert str(private) in problem.message


def test_blobs_that_are_a_link_themselves_open_no_other_folder(tmp_path: Path) -> None:
    revision = snapshot(tmp_path / "hub")
    blobs = revision.parent.parent / "blobs"
    elsewhere = tmp_path / "elsewhere"
    blobs.rename(elsewhere)
    blobs.symlink_to(elsewhere)
    with pytest.raises(DatasetError, match=str(elsewhere)):
        read_metadata(revision)


def test_writing_a_manifest_in_a_snapshot_leaves_its_blobs_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    revision = snapshot(tmp_path)
    blob = (revision / "metadata.csv").resolve()
    before = blob.read_bytes()
    command = ["dataset", "split", str(revision), "--by", "2-fold", "--write"]
    assert main(command) == 0
    assert blob.read_bytes() == before
    assert not (revision / "metadata.csv").is_symlink()


def test_what_a_mac_leaves_on_a_stick_is_no_recording(tmp_path: Path) -> None:
    folder = classes(tmp_path)
    for path in sorted(folder.rglob("*.wav")):
        (path.parent / f"._{path.name}").write_bytes(RESOURCE_FORK)
    archive = folder / "__MACOSX" / "rough"
    archive.mkdir(parents=True)
    (archive / "thing_1.wav").write_bytes(RESOURCE_FORK)
    dataset = open_dataset(folder)
    assert len(dataset.recordings) == 4
    assert not check(dataset)


def test_import_uses_the_rest_of_a_folder_with_a_broken_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = classes(tmp_path / "theirs")
    (folder / "rough" / "a_broken_1.wav").write_bytes(b"no sound at all")
    assert main(["dataset", "import", str(folder), str(tmp_path / "own")]) == 0
    printed = capsys.readouterr()
    assert "4 recordings" in printed.out
    assert "a_broken_1.wav: broken" in printed.err
    assert "1 left out; the rest is used" in printed.err
    assert main(["dataset", "check", str(folder)]) == 1


def test_import_ends_with_1_where_nothing_is_left(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for label in ("rough", "smooth"):
        path = tmp_path / "theirs" / label / "a_1.wav"
        path.parent.mkdir(parents=True)
        path.write_bytes(b"no sound at all")
    command = ["dataset", "import", str(tmp_path / "theirs"), str(tmp_path / "own")]
    assert main(command) == 1
    assert "none of its 2 recordings can be used" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("written", "name"),
    [
        ("rough\\stone1.wav", "rough/stone1.wav"),
        (".\\rough\\stone1.wav", "rough/stone1.wav"),
        ("Rough/Stone1.WAV", "rough/stone1.wav"),
        ("rough/Stra\u00dfe \u00fc.wav", "rough/Stra\u00dfe u\u0308.wav"),
    ],
    ids=["Windows", "Windows from the folder", "another case", "a Mac's letters"],
)
def test_a_name_in_a_manifest_is_found_as_a_person_would(
    written: str, name: str, tmp_path: Path
) -> None:
    path = write_sound(tmp_path / name)
    write_text(
        tmp_path / "metadata.csv", "file_name,surface,label", f"{written},s,rough"
    )
    (recording,) = open_dataset(tmp_path).recordings
    assert recording.path.resolve() == path.resolve()


@pytest.mark.parametrize(
    "name", ["..\\private.wav", "../private.wav", "rough\\..\\..\\private.wav"]
)
def test_a_name_that_leads_out_of_the_folder_is_refused(
    name: str, tmp_path: Path
) -> None:
    write_sound(tmp_path / "private.wav")
    write_sound(tmp_path / "set" / "rough" / "a.wav")
    write_text(
        tmp_path / "set" / "metadata.csv", "file_name,surface,label", f"{name},s,rough"
    )
    dataset = open_dataset(tmp_path / "set")
    assert not dataset.recordings
    assert dataset.problems[0].kind == "file_name"


def test_two_names_that_differ_by_case_are_two_files(tmp_path: Path) -> None:
    write_sound(tmp_path / "A.wav")
    write_sound(tmp_path / "a.wav", seed=1)
    write_text(tmp_path / "metadata.csv", "file_name,surface", "a.wav,s", "A.wav,t")
    assert [each.path.name for each in open_dataset(tmp_path).recordings] == [
        "a.wav",
        "A.wav",
    ]


@pytest.mark.parametrize(
    ("header", "encoding"),
    [
        ("File_Name;Surface;Label", "utf-8-sig"),
        ("filename\tsurface\tclass", "utf-16"),
        ("path,surface,label", "utf-8"),
    ],
)
def test_a_table_is_read_as_a_spreadsheet_wrote_it(
    header: str, encoding: str, tmp_path: Path
) -> None:
    write_sound(tmp_path / "a.wav")
    between = next(mark for mark in ";\t," if mark in header)
    lines = [header, between.join(("a.wav", "Stra\u00dfe", "rough"))]
    content = "\r\n".join(lines).encode(encoding)
    (tmp_path / "metadata.csv").write_bytes(content)
    (recording,) = open_dataset(tmp_path).recordings
    assert (recording.surface, recording.known("label")) == ("Stra\u00dfe", "rough")


@pytest.mark.skipif(os.name != "posix", reason="names of other systems are text")
def test_a_name_that_is_no_utf8_is_read_and_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = classes(tmp_path / "theirs")
    old = os.fsencode(folder / "rough") + b"/gr\xfcn_1.wav"
    noise = np.random.default_rng(9).uniform(-0.1, 0.1, (4000, 2))
    soundfile.write(folder / "new.wav", noise, 4000)
    os.rename(folder / "new.wav", old)
    dataset = open_dataset(folder)
    assert len(dataset.recordings) == 5
    assert len(dataset.fingerprint) == 64
    assert main(["dataset", "show", str(folder)]) == 0
    assert "gr\\xfcn" in capsys.readouterr().out
    assert main(["dataset", "import", str(folder), str(tmp_path / "own")]) == 0
    assert len(open_dataset(tmp_path / "own").recordings) == 5


def test_a_folder_of_a_phone_names_the_command_that_converts_it(
    tmp_path: Path,
) -> None:
    for name in ("rough/stone1.m4a", "smooth/glass1.M4A"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_bytes(b"\0\0\0\x18ftypM4A ")
    with pytest.raises(DatasetError, match=r"2 \.m4a files.*ffmpeg -i"):
        open_dataset(tmp_path)


def field_recorder(path: Path) -> Path:
    """Four channels: two of a room, then contact and air."""
    path.parent.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(3)
    sound = np.stack([rng.uniform(-level, level, 4000) for level in (1, 2, 3, 4)], 1)
    soundfile.write(path, sound / 10, 4000)
    return path


def test_two_of_many_channels_are_imported_in_the_order_that_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for label in ("rough", "smooth"):
        field_recorder(tmp_path / "theirs" / label / f"{label}thing_1.wav")
    folder = str(tmp_path / "theirs")
    assert main(["dataset", "check", folder]) == 1
    assert "--channels 3,4" in capsys.readouterr().out
    assert main(["dataset", "check", folder, "--channels", "4,3"]) == 0
    own = str(tmp_path / "own")
    assert main(["dataset", "import", folder, own, "--channels", "4,3"]) == 0
    recording = open_dataset(own).recordings[0]
    assert recording.channels == ("contact", "air")
    peaks = np.abs(recording.read().samples).max(axis=0)
    assert peaks == pytest.approx([0.4, 0.3], abs=0.01)


def test_a_manifest_names_the_channels_that_are_not_the_fingers(
    tmp_path: Path,
) -> None:
    field_recorder(tmp_path / "a.wav")
    write_text(
        tmp_path / "metadata.csv",
        "file_name,surface,label,channels",
        "a.wav,thing,rough,-|-|air|contact",
    )
    dataset = open_dataset(tmp_path)
    assert not check(dataset)
    (recording,) = dataset.recordings
    peaks = np.abs(recording.read(channels=2).samples).max(axis=0)
    assert peaks == pytest.approx([0.4, 0.3], abs=0.01)
