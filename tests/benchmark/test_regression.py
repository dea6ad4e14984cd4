from pathlib import Path
from types import MappingProxyType

import numpy as np

from tactophone.benchmark.regression import height_correlation
from tactophone.dataset.values import Recording
from tactophone.evaluation.predict import TakePredictions
from tactophone.types import Touch


def scored(name: str, ra_um: float, share: float) -> TakePredictions:
    recording = Recording(Path(f"{name}.wav"), name, Touch.ROUGH, properties=MappingProxyType({"ra_um": f"{ra_um}"}))
    return TakePredictions(recording, np.zeros(1), np.array([[0, 1 - share, share]], np.float32), np.ones(1, bool))


def test_scores_that_rise_with_ra_correlate_over_surfaces() -> None:
    glass, slate, lava = scored("glass", 0.1, 0.2), scored("slate", 1, 0.4), scored("lava", 10, 0.9)
    assert height_correlation([slate, lava, glass]) == 1
    assert np.isnan(height_correlation([glass, lava]))
