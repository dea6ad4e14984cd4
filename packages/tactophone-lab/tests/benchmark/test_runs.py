import os
import signal
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.recordings.values import Recording
from tactophone_lab.benchmark.folds import (
    Cache,
    MethodFold,
    cross_validate,
    fold_key,
    load_ray,
    run_folds,
)
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split
from tactophone_lab.evaluation.predict import Predictor, TakePredictions
from tests.folders import audiofolder


@dataclass(frozen=True)
class Constant:
    """Predicts the same for everything; where the file ``deadly`` is missing, it
    creates the file and dies."""

    deadly: Path | None = None
    name: str = "constant"

    @property
    def identity(self) -> str:
        return "constant"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        if self.deadly and not self.deadly.exists():
            self.deadly.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        share = np.array([[0.0, 0.25, 0.75]], np.float32)
        return lambda recording: TakePredictions(
            recording, np.array([1.0]), share, np.array([True])
        )


def method_folds(folder: Path, method: Constant) -> list[MethodFold]:
    return [
        (method, fold)
        for fold in split(open_dataset(audiofolder(folder)), "leave-one-surface-out")
    ]


def test_predictions_are_cached_and_a_second_run_runs_nothing(tmp_path: Path) -> None:
    folds, cache = method_folds(tmp_path, Constant()), Cache(tmp_path / "cache")
    done_counts: list[int] = []
    assert (
        run_folds(folds, cache, report=lambda done, name: done_counts.append(done)) == 4
    )
    assert done_counts == [1, 2, 3, 4]
    assert run_folds(folds, cache) == 0
    predictions = cross_validate(Constant(), [fold for _, fold in folds], cache=cache)
    assert len(predictions) == 8


@pytest.mark.slow
def test_a_worker_that_is_killed_loses_its_fold_and_nothing_else(
    tmp_path: Path,
) -> None:
    folds, cache = (
        method_folds(tmp_path, Constant(tmp_path / "dead")),
        Cache(tmp_path / "cache"),
    )
    assert run_folds(folds, cache, workers=2) == 4
    assert (tmp_path / "dead").exists()
    assert all(cache.get(fold_key(*fold), fold[1]) for fold in folds)


@pytest.mark.realtime
def test_a_local_ray_runs_folds_and_survives_a_killed_worker(tmp_path: Path) -> None:
    ray = pytest.importorskip("ray")
    folds, cache = (
        method_folds(tmp_path, Constant(tmp_path / "dead")),
        Cache(tmp_path / "cache"),
    )
    try:
        assert run_folds(folds, cache, workers=1, ray=True) == 4
    finally:
        ray.shutdown()
    assert all(cache.get(fold_key(*fold), fold[1]) for fold in folds)


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"tactophone-lab\[ray\]"):
        load_ray(1)
