"""Sound that stands on both sides of a split is found by its content, wherever a clip
begins."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone_lab.datasets.checks import check_consistency
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.shared_sound import (
    find_shared,
    leak_warnings,
    leaks_across,
    passages_of,
)
from tactophone_lab.datasets.splits import split

RATE = 16000


def noise(seed: int, seconds: float = 6.0) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, 0.1, (round(seconds * RATE), 2))


def clips(folder: Path, *, overlap: int) -> Path:
    """Two recordings, each cut into four clips that name surfaces of their own."""
    for number, (label, word) in enumerate(
        (("rough", "granite"), ("smooth", "window"))
    ):
        whole = noise(number)
        (folder / label).mkdir(parents=True, exist_ok=True)
        for clip, letter in enumerate("abcd"):
            begin = clip * RATE
            part = whole[begin : begin + RATE + overlap]
            path = folder / label / f"{word} part {letter}.wav"
            soundfile.write(path, part, RATE, "PCM_16")
    return folder


@pytest.mark.parametrize("overlap", [RATE // 2, RATE // 2 + 137])
def test_overlapping_clips_under_names_of_their_own_are_found(
    overlap: int, tmp_path: Path
) -> None:
    dataset = open_dataset(clips(tmp_path, overlap=overlap))
    problems = [each for each in check_consistency(dataset) if each.kind == "leak"]
    assert len(problems) == 6
    assert "part a.wav" in problems[0].message
    folds = split(dataset, "leave-one-surface-out")
    assert len(leaks_across(folds, find_shared(dataset.recordings))) == 8
    (warning,) = leak_warnings(dataset, folds)
    assert "hold sound that was trained on" in warning


def test_clips_without_overlap_share_nothing(tmp_path: Path) -> None:
    dataset = open_dataset(clips(tmp_path, overlap=0))
    assert not find_shared(dataset.recordings)
    assert not leak_warnings(dataset, split(dataset, "leave-one-surface-out"))


@pytest.mark.parametrize("shift", [1, 37, 4801])
@pytest.mark.parametrize("subtype", ["PCM_16", "PCM_24", "FLOAT"])
def test_a_shifted_copy_in_another_container_is_the_same_sound(
    shift: int, subtype: str, tmp_path: Path
) -> None:
    (tmp_path / "rough").mkdir()
    sound = np.rint(noise(3) * (1 << 15)) / (1 << 15)
    soundfile.write(tmp_path / "rough" / "stone.wav", sound, RATE, "PCM_16")
    soundfile.write(tmp_path / "rough" / "wood.wav", sound[shift:], RATE, subtype)
    (pair,) = find_shared(open_dataset(tmp_path).recordings)
    assert {pair.first.surface, pair.second.surface} == {"stone", "wood"}


def test_silence_and_a_railed_input_are_no_shared_sound(tmp_path: Path) -> None:
    (tmp_path / "rough").mkdir()
    for number, name in enumerate(("stone", "wood")):
        sound = noise(number)
        sound[RATE:] = 0
        sound[3 * RATE :] = 0.99
        soundfile.write(tmp_path / "rough" / f"{name}.wav", sound, RATE, "PCM_16")
    assert not find_shared(open_dataset(tmp_path).recordings)


@pytest.mark.parametrize("level", [0.0, 0.25, 1.0])
def test_where_all_samples_are_alike_none_is_a_peak(level: float) -> None:
    """A night of silence took hours: each of its samples was compared."""
    loud = noise(0)[:, 0].astype(np.float32)
    flat = np.full(10 * RATE, level, np.float32)
    assert not passages_of(flat)
    found = passages_of(np.concatenate((flat, loud, flat)))
    assert 0 < len(found) < 60
    # The first and the last reach of the noise have the flat sound beside them.
    assert len(found.keys() & passages_of(loud).keys()) >= len(found) - 3
