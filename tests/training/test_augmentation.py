from dataclasses import replace

import numpy as np
import pytest

from tactophone.dataset.values import Dataset
from tactophone.training.recipes import BAND_COUNT, BAND_VALUES, CREST_INDEX, Augmentation
from tactophone.training.sets import build_training_set
from tactophone.training.tracks import FeatureSpec, accumulate, extract_features
from tests.surfaces import surfaces


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return surfaces(tmp_path_factory.mktemp("scrapes"), each=1)


def test_an_offset_after_the_running_statistics_equals_one_before(dataset: Dataset) -> None:
    spec = FeatureSpec(memory=0.25)
    (track,) = extract_features(dataset.recordings[:1], spec)
    offset = Augmentation().draw(np.random.default_rng(1), channels=2)
    prior = np.zeros((2, 2, BAND_VALUES))
    metric = np.zeros((2, BAND_VALUES, BAND_VALUES))
    moved = replace(track, description=track.description + offset.astype(np.float32))
    plain, other = accumulate([track, moved], [-60.0, -60.0], metric, fading=spec.fading)
    after = plain.offset(offset).features(prior, track.present)
    before = other.features(prior, track.present)
    assert after == pytest.approx(before, abs=2e-3, nan_ok=True)


def test_gain_and_equaliser_move_bands_and_level_and_leave_ratios() -> None:
    rng = np.random.default_rng(0)
    offsets = np.array([Augmentation().draw(rng, channels=2) for _ in range(4000)])
    assert not offsets[..., [CREST_INDEX, CREST_INDEX + 1]].any()
    # At a knot the spreads of gain and equaliser add up, in tenths of a decade.
    assert offsets[..., 0].std() == pytest.approx(np.hypot(0.6, 0.35), rel=0.05)
    # Between microphones nothing is shared; neighbouring bands are nearly equal.
    assert abs(np.corrcoef(offsets[:, 0, 0], offsets[:, 1, 0])[0, 1]) < 0.05
    assert np.corrcoef(offsets[:, 0, 0], offsets[:, 0, 1])[0, 1] > 0.95
    assert offsets[..., :BAND_COUNT].mean() == pytest.approx(0, abs=0.03)


def test_each_take_is_used_in_copies(dataset: Dataset) -> None:
    spec = FeatureSpec()
    plain = build_training_set(spec, dataset.recordings)
    varied = build_training_set(spec, dataset.recordings, augmentation=Augmentation(copies=3))
    assert len(varied.examples.rough) == 3 * len(plain.examples.rough)
    assert varied.examples.rough.sum() == 3 * plain.examples.rough.sum()
    again = build_training_set(spec, dataset.recordings, augmentation=Augmentation(copies=3))
    assert np.array_equal(varied.examples.features, again.examples.features, equal_nan=True)
