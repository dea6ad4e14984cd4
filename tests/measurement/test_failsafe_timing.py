import itertools
import math

import numpy as np
import pytest

from tactophone.config import Settings
from tactophone.measurement.failsafe_timing import EndlessStroke, Listener


@pytest.fixture
def listener(monkeypatch: pytest.MonkeyPatch) -> Listener:
    """One that hears half a second of vibration and then silence, a period each 10 ms."""
    clock = itertools.count(1)
    monkeypatch.setattr("tactophone.measurement.failsafe_timing.time.monotonic", lambda: 0.01 * next(clock))
    listener = Listener()
    for peak in [0.5] * 50 + [0.0] * 50:
        listener.process([np.full(8, peak, np.float32)], [])
    return listener


def test_the_first_silent_period_ends_it(listener: Listener) -> None:
    assert listener.outlived(0.45) == pytest.approx(0.06)
    assert listener.peak == 0.0


def test_what_never_ends_is_infinite(listener: Listener) -> None:
    listener.process([np.full(8, 0.5, np.float32)], [])
    assert listener.outlived(0.45) == math.inf


def test_the_stroke_has_no_seam() -> None:
    blocks = list(itertools.islice(EndlessStroke(Settings()), 1000))
    sound = np.concatenate([block.samples[:, 0] for block in blocks])
    assert blocks[-1].end == len(sound)
    assert np.abs(np.diff(sound)).max() < 0.8 * 2 * np.pi * 300 / 48_000 * 1.01
