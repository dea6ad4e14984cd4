from pathlib import Path

from tactophone import Touch
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split
from tests.folders import authors, write_sound, write_text


def test_the_authors_layout_knows_their_objects(tmp_path: Path) -> None:
    dataset = open_dataset(authors(tmp_path))
    by_name = {recording.path.stem: recording for recording in dataset.recordings}
    assert {stem: recording.label for stem, recording in by_name.items()} == {
        "00_long_light": Touch.ROUGH,
        "00_wiggle": Touch.ROUGH,
        "02_short_loud": Touch.SMOOTH,
        "22_long_medium": Touch.ROUGH,
        "21_wiggle": Touch.SMOOTH,
        "day_1_smooth": Touch.SMOOTH,
        "day_2_rough": Touch.ROUGH,
    }
    assert by_name["02_short_loud"].known("pressure") == "strong"
    assert by_name["day_2_rough"].session == "day 2"
    assert {recording.known("tip") for recording in dataset.recordings} == {"pad"}


def test_the_authors_split_tests_their_test_objects_and_the_competition(
    tmp_path: Path,
) -> None:
    folds = {
        fold.name: fold for fold in split(open_dataset(authors(tmp_path)), "predefined")
    }
    assert {recording.surface for recording in folds["test"].test} == {
        "object 21",
        "object 22",
    }
    assert {recording.surface for recording in folds["competition"].test} == {
        "competition smooth",
        "competition rough",
    }
    assert {recording.surface for recording in folds["test"].train} == {
        "object 00",
        "object 02",
    }


def test_the_competitions_stones_are_kin_of_its_runs_and_the_spare_one_is_on_no_side(
    tmp_path: Path,
) -> None:
    write_sound(authors(tmp_path) / "opus" / "stereo" / "20_wiggle.wav")
    recordings = open_dataset(tmp_path).recordings
    kin = {
        recording.surface: (recording.known("kin"), recording.known("split"))
        for recording in recordings
    }
    assert kin["object 20"] == ("competition rough", "")
    assert kin["object 22"] == ("competition rough", "test")
    assert kin["competition rough"] == ("competition rough", "competition")
    assert kin["object 21"][0] == kin["competition smooth"][0] == "competition smooth"
    assert kin["object 00"] == ("object 00", "train")
    for fold in split(open_dataset(tmp_path), "leave-one-kin-out"):
        assert not {take.known("kin") for take in fold.train} & {
            take.known("kin") for take in fold.test
        }


def test_a_file_that_does_not_fit_the_authors_names_is_named(tmp_path: Path) -> None:
    write_sound(authors(tmp_path) / "opus" / "stereo" / "object_one.wav")
    write_sound(tmp_path / "finals_recordings" / "day_one.wav")
    dataset = open_dataset(tmp_path)
    assert [problem.path.name for problem in dataset.problems] == [
        "object_one.wav",
        "day_one.wav",
    ]
    assert len(dataset.recordings) == 7


def test_a_manifest_brings_its_segments(tmp_path: Path) -> None:
    write_text(
        tmp_path / "manifest.csv",
        "file,surface,label,channel_meaning,tier,recording",
        "a.flac,cork,ambiguous,contact finger_0 | contact finger_1,other,01",
        "b.flac,table,tap/no_contact (see segments.csv),air,core,02",
    )
    write_text(
        tmp_path / "segments.csv",
        "file,start_s,end_s,label",
        "a.flac,0,1,no_contact",
        "b.flac,x,2,tap",
        "b.flac,1,2,tap",
    )
    dataset = open_dataset(tmp_path)
    cork, table = dataset.recordings
    assert (cork.channels, table.channels) == (("contact", "contact"), ("air",))
    assert [segment.contact for segment in (*cork.segments, *table.segments)] == [
        False,
        True,
    ]
    assert (cork.label, table.label, table.take) == (None, None, "02")
    assert [problem.kind for problem in dataset.problems] == ["segments"]


def test_reads_the_real_recordings(recordings: Path) -> None:
    sizes = {
        name: len(open_dataset(recordings / name).recordings)
        for name in ("lmt", "phac", "biotac", "tapsense")
    }
    assert sizes == {"lmt": 230, "phac": 74, "biotac": 400, "tapsense": 8}
    assert not any(open_dataset(recordings / name).problems for name in sizes)
