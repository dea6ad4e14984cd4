"""Folders as laboratories keep them: labels and microphones in the names."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import Touch
from tactophone.core.errors import DatasetError
from tactophone_lab.datasets.checks import check
from tactophone_lab.datasets.convert import convert
from tactophone_lab.datasets.open import find_importable, open_dataset
from tests.folders import SAMPLE_RATE, write_sound, write_text


def touches(
    seed: int, *, seconds: float = 3.0, late: float = 0.0, stretch: float = 1.0
) -> np.ndarray:
    """Noise with bursts of touch, ``late`` s late, on a clock that is ``stretch`` times
    as slow."""
    generator = np.random.default_rng(1)
    sound = np.random.default_rng(seed).normal(0, 1e-3, int(seconds * SAMPLE_RATE))
    for start in generator.uniform(0.1, seconds - 0.4, 8):
        begin = int((start * stretch + late) * SAMPLE_RATE)
        sound[begin : begin + 400] += np.random.default_rng(seed + 1).normal(
            0, 0.1, 400
        )[: len(sound[begin:][:400])]
    return sound


def write(path: Path, sound: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    soundfile.write(path, sound, SAMPLE_RATE, "PCM_16")
    return path


def test_class_folders_bring_labels_and_surfaces(tmp_path: Path) -> None:
    for name in (
        "rough/granite_01",
        "rough/granite_02",
        "rough/slate/a",
        "smooth/glass_1",
        "none/room_1",
    ):
        write_sound(tmp_path / f"{name}.wav")
    found = find_importable(tmp_path)
    assert {
        (take.surface, take.label, take.take) for take in found.dataset.recordings
    } == {
        ("granite", Touch.ROUGH, "01"),
        ("granite", Touch.ROUGH, "02"),
        ("slate", Touch.ROUGH, "a"),
        ("glass", Touch.SMOOTH, "1"),
        ("room", Touch.NONE, "1"),
    }
    assert found.guessed
    made = convert(found.dataset, tmp_path / "ours", targets=found.targets)
    assert check(open_dataset(tmp_path / "ours")) == ()
    assert len(made.recordings) == 5


def test_a_name_under_both_labels_is_two_surfaces_and_sides_are_kept(
    tmp_path: Path,
) -> None:
    for name in ("train/rough/stone_1", "test/smooth/stone_1"):
        write_sound(tmp_path / f"{name}.wav")
    recordings = find_importable(tmp_path).dataset.recordings
    assert {(take.surface, take.known("split")) for take in recordings} == {
        ("rough stone", "train"),
        ("smooth stone", "test"),
    }


@pytest.mark.parametrize(
    "names",
    [
        ("piezo/rough/a_1.wav", "mems/rough/a_1.wav"),
        ("rough/a_1_contact.wav", "rough/a_1_air.wav"),
    ],
)
def test_a_mono_pair_becomes_one_recording_of_two_channels(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    contact, air = (
        write(tmp_path / "theirs" / name, touches(seed))
        for seed, name in enumerate(names)
    )
    found = find_importable(tmp_path / "theirs")
    assert found.dataset.problems == ()
    convert(
        found.dataset, tmp_path / "ours", air_of=found.air_of, targets=found.targets
    )
    (take,) = open_dataset(tmp_path / "ours").recordings
    assert (take.surface, take.label, take.channels) == (
        "a",
        Touch.ROUGH,
        ("contact", "air"),
    )
    both = soundfile.read(take.path, dtype="int16")[0]
    np.testing.assert_array_equal(both[:, 0], soundfile.read(contact, dtype="int16")[0])
    np.testing.assert_array_equal(both[:, 1], soundfile.read(air, dtype="int16")[0])


def test_a_pair_whose_air_file_is_a_link_that_leaves_the_folder_is_refused(
    tmp_path: Path,
) -> None:
    write(tmp_path / "theirs/rough/a_1_contact.wav", touches(0))
    (tmp_path / "theirs/rough/a_1_air.wav").symlink_to(
        write(tmp_path / "private.wav", touches(1))
    )
    found = find_importable(tmp_path / "theirs")
    assert not found.air_of
    (problem,) = found.dataset.problems
    assert problem.fatal
    assert str(tmp_path / "private.wav") in problem.message
    with pytest.raises(DatasetError, match="a link to"):
        convert(
            found.dataset,
            tmp_path / "ours",
            air_of={
                recording.path: tmp_path / "theirs/rough/a_1_air.wav"
                for recording in found.dataset.recordings
            },
            targets=found.targets,
        )
    assert not list((tmp_path / "ours").rglob("*.flac"))


@pytest.mark.parametrize(
    ("sound", "message"),
    [
        (touches(2, late=0.04), r"\+40 ms out of step"),
        (touches(2, stretch=1.01), "drifts"),
        (touches(2)[: 2 * SAMPLE_RATE], "differs in length by 1.000 s"),
        (np.stack([touches(2)] * 2, axis=1), "two mono files"),
    ],
)
def test_a_pair_out_of_step_is_left_out(
    tmp_path: Path, sound: np.ndarray, message: str
) -> None:
    for stem in ("a_1", "b_1"):
        write(tmp_path / "piezo" / "rough" / f"{stem}.wav", touches(0))
    write(tmp_path / "mems" / "rough" / "a_1.wav", touches(2))
    write(tmp_path / "mems" / "rough" / "b_1.wav", sound)
    dataset = find_importable(tmp_path).dataset
    assert [take.surface for take in dataset.recordings] == ["a"]
    (problem,) = dataset.problems
    with pytest.raises(AssertionError, match=message):
        raise AssertionError(problem.message)
    assert problem.fatal


def test_a_pair_without_common_levels_is_joined_with_a_warning(tmp_path: Path) -> None:
    write_sound(tmp_path / "rough" / "a_piezo.wav", channels=1, seed=1)
    write_sound(tmp_path / "rough" / "a_mems.wav", channels=1, seed=2)
    dataset = find_importable(tmp_path).dataset
    assert len(dataset.recordings) == 1
    assert [problem.fatal for problem in dataset.problems] == [False]


def test_a_lone_microphone_keeps_its_name_and_a_file_without_label_is_named(
    tmp_path: Path,
) -> None:
    write_sound(tmp_path / "rough" / "a_air.wav", channels=1)
    write_sound(tmp_path / "odd.wav")
    dataset = find_importable(tmp_path).dataset
    assert [take.channels for take in dataset.recordings] == [("air",)]
    assert [problem.path.name for problem in dataset.problems] == ["odd.wav"]


def test_a_number_after_the_label_in_a_name_is_no_part_of_it(tmp_path: Path) -> None:
    write_sound(tmp_path / "rough1.wav")
    write_sound(tmp_path / "smooth02_slate.wav")
    assert [take.label for take in find_importable(tmp_path).dataset.recordings] == [
        Touch.ROUGH,
        Touch.SMOOTH,
    ]


def test_nothing_with_a_label_says_what_to_do(tmp_path: Path) -> None:
    write_sound(tmp_path / "odd.wav")
    with pytest.raises(DatasetError, match="rough/, smooth/"):
        find_importable(tmp_path)


@pytest.mark.parametrize("comma", [",", ";", "\t"])
def test_a_manifest_with_labels_alone_takes_surfaces_from_names(
    tmp_path: Path, comma: str
) -> None:
    for name in ("granite_1", "granite_2", "glass_1"):
        write_sound(tmp_path / "audio" / f"{name}.wav")
    rows = [
        ("file_name", "label"),
        ("audio/granite_1.wav", "rough"),
        ("audio/granite_2.wav", "rough"),
        ("audio/glass_1.wav", "smooth"),
    ]
    write_text(tmp_path / "metadata.csv", *(comma.join(row) for row in rows))
    assert [take.surface for take in open_dataset(tmp_path).recordings] == [
        "granite",
        "granite",
        "glass",
    ]
    found = find_importable(tmp_path)
    assert found.guessed
    assert [take.surface for take in found.dataset.recordings] == [
        "granite",
        "granite",
        "glass",
    ]
