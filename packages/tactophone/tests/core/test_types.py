import numpy as np
import pytest

from tactophone import AudioBlock, Touch
from tactophone.core.types import Prediction


def test_a_block_refuses_sound_of_another_shape() -> None:
    with pytest.raises(ValueError, match=r"float64 of shape \(4,\)"):
        AudioBlock(np.zeros(4), sample_rate=48_000)


def test_touch_keeps_the_class_order_of_the_published_models() -> None:
    assert [touch.name for touch in sorted(Touch)] == ["NONE", "SMOOTH", "ROUGH"]


@pytest.mark.parametrize(
    ("probabilities", "touch", "unknown"),
    [
        ((0.0, 0.35, 0.65), Touch.ROUGH, True),
        ((0.0, 0.3, 0.7), Touch.ROUGH, False),
        ((0.4, 0.35, 0.25), Touch.SMOOTH, True),
        ((0.9, 0.01, 0.09), Touch.SMOOTH, True),
        ((0.9, 0.05, 0.05), Touch.NONE, False),
    ],
)
def test_a_touch_is_unknown_near_the_boundary_or_unlike_training(
    probabilities: tuple[float, float, float], touch: Touch, unknown: bool
) -> None:
    assert (
        Prediction(probabilities, touch, 0.5, -20.0, start=0.0, end=0.032).unknown
        is unknown
    )
