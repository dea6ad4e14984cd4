import numpy as np
import pytest

from tactophone.signal.perception.health import FAULT_CLIPPED_SHARE, clipped_samples
from tactophone_lab.simulation.demonstration import demonstration
from tactophone_lab.simulation.render import touch_segments


@pytest.mark.slow
def test_the_finger_strokes_smooth_then_rough_and_slips_off() -> None:
    finger = demonstration()
    indices = []
    for _ in finger:
        indices.append(finger.truth.object_index)
    segments = touch_segments(np.concatenate(indices), finger.scene)
    touched = [
        segment.label_name for segment in segments if segment.label_name != "none"
    ]
    assert touched[0] == "smooth"
    assert touched[-2:] == ["rough", "contact"]
    assert 8 < segments[-1].end < 16


@pytest.mark.slow
def test_no_half_second_of_the_demonstration_is_clipped() -> None:
    finger = demonstration(3)  # the loudest of the first seeds
    half = finger.sample_rate // 2
    contact = np.concatenate([block.samples for block in finger])[:, :1].T
    shares = [
        clipped_samples(contact[:, n : n + half]).mean()
        for n in range(0, contact.shape[1], half)
    ]
    assert max(shares) <= FAULT_CLIPPED_SHARE
