from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import DatasetError, Touch
from tactophone.core.recordings.values import Dataset, Recording, Segment
from tactophone_lab.datasets.checks import check, usable
from tactophone_lab.datasets.open import open_dataset
from tests.folders import SAMPLE_RATE, audiofolder, write_sound


def truncated(path: Path) -> None:
    write_sound(path, seconds=4)
    path.write_bytes(path.read_bytes()[:3000])


def written(
    samples: float, *, seconds: float = 1, channels: int = 2, rate: int = SAMPLE_RATE
) -> Callable[[Path], None]:
    return lambda path: soundfile.write(
        path, np.full((int(seconds * rate), channels), samples), rate, subtype="FLOAT"
    )


FAULTS: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "missing": ("a.wav", lambda path: None, "missing"),
    "no bytes": ("a.wav", lambda path: path.touch(), "empty"),
    "no sound": ("a.wav", written(0.5, seconds=0), "empty"),
    "not sound": (
        "a.wav",
        lambda path: path.write_text("no sound at all, only words"),
        "broken",
    ),
    "truncated flac": ("a.flac", truncated, "broken"),
    "nan": ("a.wav", written(np.nan), "broken"),
    "silent": ("a.wav", written(1e-6), "silent"),
    "too slow": ("a.wav", written(0.5, rate=1000), "rate"),
    "short": ("a.wav", written(0.5, seconds=0.1), "short"),
    "one channel": ("a.wav", written(0.5, channels=1), "channels"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_is_named_and_only_its_file_is_left_out(
    tmp_path: Path, fault: str
) -> None:
    name, make, kind = FAULTS[fault]
    make(tmp_path / name)
    bad = Recording(tmp_path / name, "slate", Touch.ROUGH, ("contact", "air"))
    good = Recording(
        write_sound(tmp_path / "good.wav"), "glass", Touch.SMOOTH, ("contact", "air")
    )
    rest, problems = usable(Dataset("d", tmp_path, (bad, good)))
    assert [
        (problem.path, problem.fatal) for problem in problems if problem.kind == kind
    ] == [(bad.path, True)]
    assert rest.recordings == (good,)


def test_clipping_and_one_dead_channel_are_suspicious_but_usable(
    tmp_path: Path,
) -> None:
    sound = np.zeros((SAMPLE_RATE, 2))
    sound[:, 0] = np.clip(np.sin(np.arange(SAMPLE_RATE)) * 2, -1, 1)
    soundfile.write(tmp_path / "a.wav", sound, SAMPLE_RATE)
    rest, problems = usable(
        Dataset("d", tmp_path, (Recording(tmp_path / "a.wav", "slate"),))
    )
    assert {problem.kind: problem.message.split(";")[0] for problem in problems} == {
        "silent": "channel 2 of 2 stays under -90 dBFS",
        "clipped": "33.25% of its samples lie at full scale",
    }
    assert len(rest.recordings) == 1


def test_labels_and_segments_that_cannot_be_true_are_named(tmp_path: Path) -> None:
    path = write_sound(tmp_path / "a.wav")
    first = Recording(path, "slate", Touch.ROUGH)
    second = Recording(
        path, "slate", Touch.SMOOTH, segments=(Segment(0.1, 0.9, "rough"),)
    )
    problems = check(Dataset("d", tmp_path, (first, second)))
    assert [problem.kind for problem in problems] == ["label", "segments"]
    assert "slate is smooth here, rough in a.wav" in str(problems[0])


def test_a_good_dataset_has_no_problems_and_progress_is_reported(
    tmp_path: Path,
) -> None:
    reported: list[int] = []
    assert check(open_dataset(audiofolder(tmp_path)), progress=reported.append) == ()
    assert reported == list(range(1, 9))


def test_a_file_of_nan_is_broken_and_nothing_else(tmp_path: Path) -> None:
    written(np.nan)(tmp_path / "a.wav")
    problems = check(
        Dataset("d", tmp_path, (Recording(tmp_path / "a.wav", "slate", Touch.ROUGH),))
    )
    assert [problem.kind for problem in problems] == ["broken"]


def test_a_set_without_recordings_is_named(tmp_path: Path) -> None:
    empty = Dataset("d", tmp_path, ())
    assert [(problem.kind, problem.fatal) for problem in check(empty)] == [
        ("empty", True)
    ]
    with pytest.raises(DatasetError, match="no usable recording"):
        empty.labelled()
