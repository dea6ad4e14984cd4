from pathlib import Path

import numpy as np
import pytest

from tactophone.dataset import Recording
from tactophone.errors import DatasetError
from tactophone.evaluation import TakePredictions, accuracy_of, by_surface, by_take, compare_models
from tactophone.types import Touch


def predicted(correct: float, *, contact: bool = True) -> list[TakePredictions]:
    """Four surfaces with two takes each, of which a share of windows is classified correctly."""
    made = []
    for number in range(8):
        label = Touch.ROUGH if number % 4 < 2 else Touch.SMOOTH
        right = np.arange(100) < 100 * correct
        rough = right if label is Touch.ROUGH else ~right
        rows = np.stack([np.zeros(100), 1.0 - rough, rough], axis=1).astype(np.float32)
        recording = Recording(Path(f"{number}.wav"), f"stone {number // 2}", label)
        made.append(TakePredictions(recording, np.arange(100) / 100, rows, np.full(100, contact)))
    return made


def test_gain_and_loss_are_paired() -> None:
    changes = compare_models(predicted(0.6), predicted(0.9), by=by_surface)
    accuracy = changes["balanced_accuracy"]
    assert (accuracy.before.value, accuracy.after.value) == pytest.approx((0.6, 0.9))
    assert accuracy.difference.value == pytest.approx(0.3)
    assert accuracy.difference.low == pytest.approx(0.3)
    assert changes["false_positive_rate"].difference.value == pytest.approx(-0.3)
    assert compare_models(predicted(0.6), predicted(0.9), by=by_take)["balanced_accuracy"] == accuracy


def test_objects_of_one_label_are_scored_on_it_alone() -> None:
    rough = [take for take in predicted(0.7) if take.recording.label is Touch.ROUGH]
    changes = compare_models(rough, rough, by=by_take)
    assert changes["balanced_accuracy"].after.value == pytest.approx(0.7)
    assert np.isnan(changes["false_positive_rate"].after.value)
    assert accuracy_of(rough) == pytest.approx(0.7)


def test_no_contact_is_named() -> None:
    with pytest.raises(DatasetError, match="never opened"):
        compare_models(predicted(0.5, contact=False), predicted(0.5, contact=False), by=by_surface)
