from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.dataset import Recording, Segment
from tactophone.evaluation import TakePredictions, in_true_contact
from tactophone.types import Touch

RATE = 8000
TIME = 0.01 * np.arange(1, 401)
STROKES = ((0.5, 1.5), (2.5, 3.5))


def recorded(path: Path, *, rests: bool = True) -> Recording:
    rng = np.random.default_rng(0)
    level = np.full(4 * RATE, 1e-3)
    for start, end in STROKES if rests else ((0.0, 4.0),):
        level[round(start * RATE) : round(end * RATE)] = 0.1
    soundfile.write(path, rng.normal(0, 1, (4 * RATE, 1)) * level[:, None], RATE, subtype="FLOAT")
    return Recording(path, "slate", Touch.ROUGH)


def contact(recording: Recording) -> np.ndarray:
    shape = len(TIME), 3
    take = TakePredictions(recording, TIME, np.full(shape, 1 / 3, np.float32), np.zeros(shape[0], bool))
    return in_true_contact(take).contact


def test_rests_without_segments_are_no_contact(tmp_path: Path) -> None:
    found = contact(recorded(tmp_path / "a.wav"))
    expected = np.any([(start < TIME) & (end >= TIME) for start, end in STROKES], axis=0)
    assert found[expected].mean() > 0.98
    # A touch lasts on over 0.1 s of silence, and noise is over its floor now and then.
    assert found[~expected].mean() < 0.35


@pytest.mark.parametrize("exists", [True, False])
def test_sound_without_a_rest_is_contact_throughout(tmp_path: Path, exists: bool) -> None:
    recording = recorded(tmp_path / "a.wav", rests=False) if exists else Recording(tmp_path / "b.wav", "slate")
    assert contact(recording).all()


def test_segments_come_before_the_sound(tmp_path: Path) -> None:
    recording = recorded(tmp_path / "a.wav")
    labelled = Recording(recording.path, "slate", Touch.ROUGH, segments=(Segment(0.0, 1.0, "rough"),))
    assert contact(labelled).tolist() == (TIME <= 1.0).tolist()
