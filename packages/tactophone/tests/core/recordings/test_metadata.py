from pathlib import Path

import pytest

from tactophone import DatasetError, Touch
from tactophone.core.recordings.links import find_file
from tactophone.core.recordings.metadata import add_to_metadata, write_metadata
from tactophone.core.recordings.values import Recording, Segment
from tactophone_lab.datasets.open import open_dataset
from tests.folders import audiofolder, write_sound, write_text


def test_reads_the_columns_it_knows_and_keeps_the_others(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    first = dataset.recordings[0]
    assert (first.surface, first.label, first.channels) == (
        "stone 00",
        Touch.ROUGH,
        ("contact", "air"),
    )
    assert (first.take, first.scenario, first.properties["pressure"]) == (
        "0",
        "hand",
        "light",
    )
    assert dataset.problems == ()


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    written = Recording(
        write_sound(tmp_path / "takes" / "a.flac"),
        "slate, grey",
        Touch.ROUGH,
        ("contact", "air"),
        take="long_light",
        scenario="box",
        session="day 1",
        segments=(Segment(0.0, 0.125, "none"), Segment(0.125, 0.5, "rough")),
        properties={"material": "natural stone", "pressure": "light"},
    )
    write_metadata(tmp_path, [written])
    assert open_dataset(tmp_path).recordings == (written,)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["metadata.csv", "takes"]


@pytest.mark.parametrize("end", ["\r", "\n", "\r\n"])
def test_a_line_end_in_a_cell_ends_no_line(tmp_path: Path, end: str) -> None:
    path = write_sound(tmp_path / "a.flac")
    text = f"slate{end}grey"
    written = [
        Recording(path, f"slate{end}", Touch.ROUGH, session="monday"),
        Recording(path, text, Touch.ROUGH, take=text, properties={"material": text}),
    ]
    write_metadata(tmp_path, written)
    first, second = open_dataset(tmp_path).recordings
    assert (first.surface, first.label, first.session) == (
        "slate",
        Touch.ROUGH,
        "monday",
    )
    assert second == written[1]


def test_refuses_to_write_what_lies_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "inner").mkdir()
    with pytest.raises(ValueError, match="subpath"):
        write_metadata(tmp_path / "inner", [Recording(tmp_path / "a.wav", "slate")])


def test_parts_with_a_manifest_each_become_one_dataset_with_a_split(
    tmp_path: Path,
) -> None:
    for part in ("train", "test"):
        write_sound(tmp_path / part / "a.wav")
        write_text(
            tmp_path / part / "metadata.csv",
            "file_name,surface,label",
            f"a.wav,{part} stone,rough",
        )
    splits = [
        recording.known("split") for recording in open_dataset(tmp_path).recordings
    ]
    assert splits == ["train", "test"]


def test_a_recording_is_added_to_the_lines_of_all_parts(tmp_path: Path) -> None:
    for part in ("train", "test"):
        path = write_sound(tmp_path / part / "a.wav")
        write_text(path.with_name("metadata.csv"), "file_name,surface", f"a.wav,{part}")
    add_to_metadata(tmp_path, [Recording(write_sound(tmp_path / "b.wav"), "slate")])
    found = {
        each.surface: each.known("split") for each in open_dataset(tmp_path).recordings
    }
    assert found == {"train": "train", "test": "test", "slate": ""}


def test_a_bad_line_is_named_and_the_others_are_read(tmp_path: Path) -> None:
    write_text(
        tmp_path / "metadata.csv",
        "file_name,surface,label,segments",
        "../../etc/passwd,slate,rough,",
        ",slate,rough,",
        "a.wav,slate,ruogh,0.1-0.2=rough nonsense",
        "b.wav,slate,Rough,",
    )
    dataset = open_dataset(tmp_path)
    assert [problem.kind for problem in dataset.problems] == [
        "file_name",
        "file_name",
        "label",
        "segments",
    ]
    assert "'ruogh' is not a label; write one of none" in str(dataset.problems[2])
    assert [
        (recording.path.name, recording.label) for recording in dataset.recordings
    ] == [
        ("a.wav", None),
        ("b.wav", Touch.ROUGH),
    ]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"surface,label\nslate,rough\n", "no column file_name"),
        (b"\x80\x81", "no column file_name"),
        (b"PK\x03\x04 a workbook", "a spreadsheet, not text"),
        (b"\xff\xfe\x00", "not a CSV file"),
    ],
)
def test_a_manifest_that_cannot_be_read_says_why(
    tmp_path: Path, content: bytes, message: str
) -> None:
    (tmp_path / "metadata.csv").write_bytes(content)
    with pytest.raises(DatasetError, match=message):
        open_dataset(tmp_path)


def test_a_file_name_with_a_null_byte_is_outside(tmp_path: Path) -> None:
    assert find_file(tmp_path, "a\0b.wav") is None
