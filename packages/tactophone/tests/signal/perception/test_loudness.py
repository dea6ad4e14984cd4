import numpy as np
import pytest

from tactophone.signal.perception.levels import mean_absolute_dbfs, rms_dbfs


def test_a_full_scale_sine_by_both_rules() -> None:
    sine = np.sin(2 * np.pi * np.arange(48_000) / 100).astype(np.float32)
    assert rms_dbfs(sine) == pytest.approx(20 * np.log10(np.sqrt(0.5)), abs=1e-3)
    assert mean_absolute_dbfs(sine) == pytest.approx(20 * np.log10(2 / np.pi), abs=1e-2)
