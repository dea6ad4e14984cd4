import numpy as np
import pytest

from tactophone import AudioBlock, Touch


def test_a_block_refuses_sound_of_another_shape() -> None:
    with pytest.raises(ValueError, match=r"float64 of shape \(4,\)"):
        AudioBlock(np.zeros(4), sample_rate=48_000)


def test_touch_keeps_the_class_order_of_the_published_models() -> None:
    assert [touch.name for touch in sorted(Touch)] == ["NONE", "SMOOTH", "ROUGH"]
