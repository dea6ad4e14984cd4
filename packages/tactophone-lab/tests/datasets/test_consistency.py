from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile

from tactophone.core.recordings.values import Dataset
from tactophone.core.types import Touch
from tactophone_lab.datasets.checks import check_consistency
from tactophone_lab.datasets.open import open_dataset
from tests.folders import audiofolder


def kinds(dataset: Dataset, **options: float) -> list[str]:
    return [problem.kind for problem in check_consistency(dataset, **options)]


def changed(dataset: Dataset, *places: int, **fields: object) -> Dataset:
    reported = tuple(
        replace(recording, **fields) if n in places else recording
        for n, recording in enumerate(dataset.recordings)
    )
    return replace(dataset, recordings=reported)


def test_a_good_set_has_nothing_wrong_and_progress_is_reported(tmp_path: Path) -> None:
    reported: list[int] = []
    assert (
        check_consistency(open_dataset(audiofolder(tmp_path)), progress=reported.append)
        == ()
    )
    assert reported == list(range(1, 9))


def test_a_surface_on_both_sides_is_a_leak(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    leaking = changed(
        changed(dataset, 0, properties={"split": "train"}),
        1,
        properties={"split": "test"},
    )
    (problem,) = check_consistency(leaking)
    assert (problem.kind, problem.message.split(";")[0]) == (
        "leak",
        "stone 00 is in test and train",
    )


def test_the_same_sound_in_another_container_is_a_duplicate(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    first, second = dataset.recordings[:2]
    samples, rate = soundfile.read(first.path)
    second.path.unlink()
    copy = second.path.with_suffix(".wav")
    soundfile.write(copy, samples, rate, "PCM_24")
    copied = changed(dataset, 1, path=copy)
    assert kinds(copied) == ["duplicate"]
    (problem,) = check_consistency(
        changed(copied, 1, label=Touch.SMOOTH, surface="other")
    )
    assert "labelled smooth here and rough there" in problem.message


def test_a_set_of_one_label_is_unbalanced(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    assert kinds(dataset.where(lambda recording: recording.label is Touch.ROUGH)) == [
        "unbalanced"
    ]


def test_a_take_in_which_nothing_is_touched_is_named_by_the_calibrated_level(
    tmp_path: Path,
) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    quiet = dataset.recordings[0].path
    soundfile.write(quiet, np.random.default_rng(0).normal(0, 1e-4, (4000, 2)), 4000)
    assert kinds(dataset) == ["no contact"]
    assert kinds(dataset, threshold_dbfs=-90.0) == []


def test_what_cannot_be_read_is_left_to_the_other_check(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    dataset.recordings[0].path.write_text("no sound")
    assert kinds(dataset) == []


def test_a_line_that_stands_twice_is_named_as_such(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    (problem,) = check_consistency(
        replace(
            dataset, recordings=(*dataset.recordings, replace(dataset.recordings[0]))
        )
    )
    assert problem.message == "the manifest names it twice; drop either line"


def test_an_unusable_file_has_no_level(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    soundfile.write(dataset.recordings[0].path, np.zeros((0, 2)), 4000)
    assert kinds(dataset) == []
