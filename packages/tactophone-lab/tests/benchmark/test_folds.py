from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from tactophone import Touch
from tactophone.core.recordings.values import Dataset, Recording
from tactophone_lab.benchmark.folds import Cache, cross_validate, permute_labels
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split
from tactophone_lab.evaluation.predict import Predictor, TakePredictions
from tests.folders import audiofolder


@dataclass
class ShareOfRough:
    """A method that learns one number, the share of rough recordings in training."""

    name: str = "share of rough"
    identity: str = "share of rough, 1"
    seen: list[set[str]] = field(default_factory=list)

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        self.seen.append({recording.surface for recording in recordings})
        share = float(
            np.mean([recording.label is Touch.ROUGH for recording in recordings])
        )

        def predict(recording: Recording) -> TakePredictions:
            rows = np.array([[0, 1 - share, share]] * 3, np.float32)
            return TakePredictions(recording, np.arange(3.0), rows, np.ones(3, bool))

        return predict


def test_no_surface_is_predicted_by_a_model_trained_on_it(tmp_path: Path) -> None:
    folds = split(open_dataset(audiofolder(tmp_path)), "leave-one-surface-out")
    method = ShareOfRough()
    predictions = cross_validate(method, folds)
    assert [take.recording for take in predictions] == [
        recording for fold in folds for recording in fold.test
    ]
    for fold, seen in zip(folds, method.seen, strict=True):
        assert not seen & {recording.surface for recording in fold.test}


def test_a_second_run_trains_nothing_and_predicts_the_same(tmp_path: Path) -> None:
    folds = split(open_dataset(audiofolder(tmp_path)), "2-fold")
    cache = Cache(tmp_path / "cache")
    first = cross_validate(ShareOfRough(), folds, cache=cache)
    method = ShareOfRough()
    second = cross_validate(method, folds, cache=cache)
    assert method.seen == []
    assert all(
        np.array_equal(a.probabilities, b.probabilities)
        for a, b in zip(first, second, strict=True)
    )
    cross_validate(ShareOfRough(identity="share of rough, 2"), folds, cache=cache)
    assert len(list((tmp_path / "cache").iterdir())) == 4


def test_a_broken_cache_entry_is_computed_again(tmp_path: Path) -> None:
    folds = split(open_dataset(audiofolder(tmp_path)), "2-fold")
    cache = Cache(tmp_path / "cache")
    cross_validate(ShareOfRough(), folds, cache=cache)
    for entry in (tmp_path / "cache").iterdir():
        entry.write_bytes(entry.read_bytes()[:100])
    method = ShareOfRough()
    cross_validate(method, folds, cache=cache)
    assert len(method.seen) == 2


def test_progress_names_the_folds(tmp_path: Path) -> None:
    reports: list[tuple[int, str]] = []
    folds = split(open_dataset(audiofolder(tmp_path)), "2-fold")
    cross_validate(
        ShareOfRough(), folds, report=lambda done, name: reports.append((done, name))
    )
    assert reports == [(0, "fold 1"), (1, "fold 2")]


@pytest.mark.parametrize("seed", range(3))
def test_permuted_labels_are_equal_within_a_surface_and_keep_their_count(
    seed: int,
) -> None:
    recordings = tuple(
        Recording(Path(f"{s}_{t}.wav"), f"stone {s}", Touch(1 + s % 2))
        for s in range(10)
        for t in range(3)
    )
    permuted = permute_labels(Dataset("d", Path("d"), recordings), seed=seed).recordings
    labels = {(recording.surface, recording.label) for recording in permuted}
    assert len(labels) == 10
    assert sum(label is Touch.ROUGH for _, label in labels) == 5
    assert [take.path for take in permuted] == [take.path for take in recordings]
    assert [take.label for take in permuted] != [take.label for take in recordings]
