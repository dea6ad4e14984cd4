import numpy as np
import pytest

from tactophone.signal.perception.health import find_invalid


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -9])
def test_samples_that_no_microphone_produces_are_found(value: float) -> None:
    samples = np.zeros((10, 2), np.float32)
    samples[4, 1] = value
    assert find_invalid(samples).tolist() == [4]
