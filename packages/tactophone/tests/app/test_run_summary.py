import numpy as np
import pytest

from tactophone.app.vibration_wav import score_run
from tactophone.core.recordings.values import Segment
from tactophone.core.types import Touch


def test_a_run_is_scored_against_its_labels() -> None:
    truth = (
        Segment(0, 1, "none"),
        Segment(1, 2, "smooth"),
        Segment(2, 3, "rough"),
        Segment(3, 4, "none"),
    )
    time = np.arange(0.05, 4, 0.1)
    touch = np.select(
        [time < 1.1, time < 2.5, time < 3.1],
        [Touch.NONE, Touch.SMOOTH, Touch.ROUGH],
        Touch.NONE,
    )
    timeline = {"time": time, "touch": touch, "amplitude": (touch != Touch.NONE) * 0.5}
    scores = score_run(timeline, truth)
    assert scores.smooth_right == pytest.approx(0.9)
    assert scores.rough_right == pytest.approx(0.5)
    assert scores.false_bumps == 0
    assert scores.touch_to_vibration == pytest.approx(0.15)
    assert scores.lift_to_silence == pytest.approx(0.15)
