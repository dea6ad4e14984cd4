from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest

from tactophone.benchmark.regression import HIGHEST, LOWEST, HeightMethod, compare_heights, height_correlation
from tactophone.dataset.values import Recording
from tactophone.evaluation.predict import TakePredictions
from tactophone.training.tracks import FeatureSpec
from tactophone.types import Touch
from tests.surfaces import surfaces


def heights(name: str, ra_um: float, log_ra: list[float]) -> TakePredictions:
    """Predictions of heights, as log10 of micrometres."""
    place = (np.array(log_ra) - LOWEST) / (HIGHEST - LOWEST)
    recording = Recording(
        Path(f"{name}.wav"), name, Touch.ROUGH, properties=MappingProxyType({"ra_um": f"{ra_um}"})
    )  # fmt: skip
    shares = np.stack((0 * place, 1 - place, place), axis=1).astype(np.float32)
    return TakePredictions(recording, np.arange(len(place), dtype=float), shares, np.ones(len(place), bool))


def test_errors_are_decades_over_surfaces() -> None:
    comparison = compare_heights(
        [heights("glass", 0.1, [-1.0, -1.0]), heights("slate", 1, [0.3, 0.1]), heights("lava", 10, [0.4])]
    )
    assert comparison.error_decades == pytest.approx(np.sqrt((0 + 0.2**2 + 0.6**2) / 3), abs=1e-5)
    assert comparison.spread_decades == pytest.approx(np.sqrt(2 / 3))
    assert comparison.correlation == pytest.approx(1)
    assert comparison.surfaces[2][1:] == pytest.approx((1, 10**0.2), rel=1e-5)


def test_two_surfaces_have_no_rank_correlation() -> None:
    assert np.isnan(height_correlation([heights("glass", 0.1, [-1.0]), heights("lava", 10, [1.0])]))


def test_heights_are_learned_from_sound(tmp_path: Path) -> None:
    recordings = surfaces(tmp_path, each=4).recordings
    predict = HeightMethod(FeatureSpec("texture", 2)).fit(recordings[:6])
    comparison = compare_heights(map(predict, recordings[6:]))
    assert comparison.error_decades < comparison.spread_decades
