from fractions import Fraction

import numpy as np
import pytest

from tactophone.signal.perception.resample import Windower


@pytest.mark.parametrize("size", [1, 7, 21, 1000])
def test_any_block_size_gives_the_same_windows(size: int) -> None:
    samples = np.arange(2000, dtype=np.float32)[:, None]
    windower = Windower(512, Fraction(64, 3), channels=1)
    found = []
    for start in range(0, len(samples), size):
        found += [
            (end, window.copy())
            for end, window in windower.push(samples[start : start + size])
        ]
    assert [end for end, _ in found] == [512 + k * 64 // 3 for k in range(70)]
    assert all(window[-1, 0] == end - 1 and len(window) == 512 for end, window in found)


def test_a_hop_under_one_sample_is_refused() -> None:
    with pytest.raises(ValueError, match="hop of 1/2"):
        Windower(512, Fraction(1, 2), channels=1)
