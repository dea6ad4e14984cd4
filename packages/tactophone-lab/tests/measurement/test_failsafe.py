import itertools
import math

import numpy as np
import pytest

from benchmarks.failsafe import STROKE_TONE, EndlessStroke, PeakRecorder
from tactophone.core.settings import Settings


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> PeakRecorder:
    """A recorder of half a second of vibration and then silence, one period every 10
    ms."""
    clock = itertools.count(1)
    monkeypatch.setattr(
        "benchmarks.failsafe.time.monotonic", lambda: 0.01 * next(clock)
    )
    recorder = PeakRecorder()
    for peak in [0.5] * 50 + [0.0] * 50:
        recorder.process([np.full(8, peak, np.float32)], [])
    return recorder


def test_the_first_silent_period_ends_it(recorder: PeakRecorder) -> None:
    assert recorder.time_to_silence(0.45) == pytest.approx(0.06)
    assert recorder.peak == 0.0


def test_an_endless_vibration_is_infinite(recorder: PeakRecorder) -> None:
    recorder.process([np.full(8, 0.5, np.float32)], [])
    assert recorder.time_to_silence(0.45) == math.inf


def test_the_stroke_has_no_seam() -> None:
    blocks = list(itertools.islice(EndlessStroke(Settings()), 1000))
    sound = np.concatenate([block.samples[:, 0] for block in blocks])
    assert blocks[-1].end == len(sound)
    assert np.abs(np.diff(sound)).max() < 0.8 * 2 * np.pi * STROKE_TONE / 48_000 * 1.01
