"""Manifests as spreadsheets, other systems and other people's scripts write them."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tactophone.core.recordings.metadata import (
    read_metadata,
    write_metadata,
)
from tests.folders import write_sound

ROWS = (
    ("file_name", "surface", "label"),
    ("rough/a_1.wav", "slate", "rough"),
    ("smooth/b_1.wav", "glass", "smooth"),
)


def table(folder: Path, text: str, encoding: str = "utf-8") -> Path:
    """A data set of two recordings, with this manifest."""
    for name, *_ in ROWS[1:]:
        write_sound(folder / name)
    (folder / "metadata.csv").write_bytes(text.encode(encoding))
    return folder


def joined(delimiter: str, line_end: str = "\n") -> str:
    return line_end.join(map(delimiter.join, ROWS)) + line_end


@pytest.mark.parametrize(
    ("text", "encoding"),
    [
        (joined("|"), "utf-8"),
        (joined(",", "\r"), "utf-8"),
        (joined("\t"), "utf-16-le"),
        (joined("\t"), "utf-16-be"),
        ("sep=;\r\n" + joined(";", "\r\n"), "utf-8-sig"),
        ("\n\n" + joined(",") + ",,\n\n", "utf-8"),
    ],
)
def test_a_table_is_read_however_its_cells_lines_and_letters_are_written(
    tmp_path: Path, text: str, encoding: str
) -> None:
    dataset = read_metadata(table(tmp_path, text, encoding))
    assert not dataset.problems
    assert dataset.surfaces == ("glass", "slate")
    assert all(recording.path.is_file() for recording in dataset.recordings)


@pytest.mark.parametrize(
    "before",
    [
        "/home/ada/corpus/",
        "D:\\corpus\\",
        "file:///home/ada/my%20corpus/",
        "corpus/",
        "./",
    ],
)
def test_folders_of_another_machine_before_a_name_are_left_out(
    tmp_path: Path, before: str
) -> None:
    lines = [",".join(ROWS[0]), *(",".join((before + r[0], *r[1:])) for r in ROWS[1:])]
    text = "\n".join(lines)
    if "\\" in before:
        text = text.replace("/", "\\")
    dataset = read_metadata(table(tmp_path, text))
    assert not dataset.problems
    assert all(recording.path.is_file() for recording in dataset.recordings)


def test_the_last_folder_of_a_relative_name_is_never_left_out(tmp_path: Path) -> None:
    write_sound(tmp_path / "a_1.wav")
    table(tmp_path, "file_name,surface,label\nelsewhere/a_1.wav,slate,rough\n")
    (recording,) = read_metadata(tmp_path).recordings
    assert not recording.path.exists()


@pytest.mark.parametrize("ending", [".flac", ".txt", ""])
def test_a_sound_that_was_converted_is_found_by_the_rest_of_its_name(
    tmp_path: Path, ending: str
) -> None:
    dataset = read_metadata(table(tmp_path, joined(",").replace(".wav", ending)))
    assert [recording.path.name for recording in dataset.recordings] == [
        "a_1.wav",
        "b_1.wav",
    ]


def test_a_name_that_two_sounds_may_be_is_not_guessed(tmp_path: Path) -> None:
    folder = table(tmp_path, joined(",").replace(".wav", ""))
    write_sound(folder / "rough" / "a_1.flac")
    rough, _ = read_metadata(folder).recordings
    assert not rough.path.exists()


@pytest.mark.parametrize(
    ("encoding", "surface"), [("latin-1", "Gr\xfcn"), ("cp949", "\ub3cc")]
)
def test_letters_of_a_code_page_are_kept_as_bytes_and_said(
    tmp_path: Path, encoding: str, surface: str
) -> None:
    text = joined(",").replace("slate", surface)
    dataset = read_metadata(table(tmp_path, text, encoding))
    (problem,) = dataset.problems
    assert not problem.fatal
    assert "iconv -f" in problem.message
    assert len(dataset.recordings) == 2
    before = (tmp_path / "metadata.csv").read_bytes()
    write_metadata(tmp_path, dataset.recordings)
    written = (tmp_path / "metadata.csv").read_bytes()
    assert surface.encode(encoding) in before
    assert surface.encode(encoding) in written


def test_a_decimal_comma_in_segments_is_read(tmp_path: Path) -> None:
    text = joined(";").replace("label\n", "label;segments\n")
    text = text.replace(";rough\n", ";rough;0,1-0,4=rough\n")
    rough, _ = read_metadata(table(tmp_path, text)).recordings
    assert [(each.start, each.end) for each in rough.segments] == [(0.1, 0.4)]


def test_a_manifest_of_missing_files_reads_its_folder_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a day passed for a manifest whose files were not copied."""
    for number in range(50):
        (tmp_path / f"take {number}.bin").touch()
    lines = [
        "file_name,surface,label",
        *(f"missing {number}.wav,slate,rough" for number in range(99)),
    ]
    (tmp_path / "metadata.csv").write_text("\n".join(lines) + "\n")
    looks = []
    iterdir = Path.iterdir

    def look(folder: Path) -> Iterator[Path]:
        looks.append(folder)
        return iterdir(folder)

    monkeypatch.setattr(Path, "iterdir", look)
    read_metadata(tmp_path)
    assert looks.count(tmp_path) < 5
