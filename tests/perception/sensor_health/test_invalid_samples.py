import numpy as np
import pytest

from tactophone.perception.sensor_health.invalid_samples import find_garbage


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30, -9])
def test_what_no_microphone_can_say_is_found(value: float) -> None:
    samples = np.zeros((10, 2), np.float32)
    samples[4, 1] = value
    assert find_garbage(samples).tolist() == [4]
