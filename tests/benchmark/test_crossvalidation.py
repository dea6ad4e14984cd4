from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from tactophone import Touch
from tactophone.benchmark.crossvalidation import Cache, cross_validate, shuffle_labels
from tactophone.dataset import Dataset, Recording, open_dataset, split
from tactophone.evaluation.predictions import Judge, TakePredictions
from tests.dataset.folders import audiofolder


@dataclass
class ShareOfRough:
    """A method that learns but one number, the share of rough recordings it was given."""

    name: str = "share of rough"
    identity: str = "share of rough, 1"
    seen: list[set[str]] = field(default_factory=list)

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        self.seen.append({one.surface for one in recordings})
        share = float(np.mean([one.label is Touch.ROUGH for one in recordings]))

        def judge(recording: Recording) -> TakePredictions:
            rows = np.array([[0, 1 - share, share]] * 3, np.float32)
            return TakePredictions(recording, np.arange(3.0), rows, np.ones(3, bool))

        return judge


def test_nobody_judges_a_surface_it_has_met(tmp_path: Path) -> None:
    folds = split(open_dataset(audiofolder(tmp_path)), "leave-one-surface-out")
    method = ShareOfRough()
    judged = cross_validate(method, folds)
    assert [one.recording for one in judged] == [one for fold in folds for one in fold.test]
    for fold, seen in zip(folds, method.seen, strict=True):
        assert not seen & {one.surface for one in fold.test}


def test_a_second_run_fits_nothing_and_answers_the_same(tmp_path: Path) -> None:
    folds = split(open_dataset(audiofolder(tmp_path)), "2-fold")
    cache = Cache(tmp_path / "cache")
    first = cross_validate(ShareOfRough(), folds, cache=cache)
    method = ShareOfRough()
    second = cross_validate(method, folds, cache=cache)
    assert method.seen == []
    assert all(np.array_equal(a.probabilities, b.probabilities) for a, b in zip(first, second, strict=True))
    cross_validate(ShareOfRough(identity="share of rough, 2"), folds, cache=cache)
    assert len(list((tmp_path / "cache").iterdir())) == 4


def test_a_broken_cache_entry_is_made_anew(tmp_path: Path) -> None:
    folds = split(open_dataset(audiofolder(tmp_path)), "2-fold")
    cache = Cache(tmp_path / "cache")
    cross_validate(ShareOfRough(), folds, cache=cache)
    for entry in (tmp_path / "cache").iterdir():
        entry.write_bytes(entry.read_bytes()[:100])
    method = ShareOfRough()
    cross_validate(method, folds, cache=cache)
    assert len(method.seen) == 2


def test_progress_names_the_folds(tmp_path: Path) -> None:
    told: list[tuple[int, str]] = []
    folds = split(open_dataset(audiofolder(tmp_path)), "2-fold")
    cross_validate(ShareOfRough(), folds, report=lambda done, name: told.append((done, name)))
    assert told == [(0, "fold 1"), (1, "fold 2")]


@pytest.mark.parametrize("seed", range(3))
def test_shuffled_labels_stay_whole_by_surface_and_keep_their_count(seed: int) -> None:
    recordings = tuple(
        Recording(Path(f"{s}_{t}.wav"), f"stone {s}", Touch(1 + s % 2)) for s in range(10) for t in range(3)
    )
    shuffled = shuffle_labels(Dataset("d", Path("d"), recordings), seed=seed).recordings
    labels = {(one.surface, one.label) for one in shuffled}
    assert len(labels) == 10
    assert sum(label is Touch.ROUGH for _, label in labels) == 5
    assert [one.path for one in shuffled] == [one.path for one in recordings]
    assert [one.label for one in shuffled] != [one.label for one in recordings]
