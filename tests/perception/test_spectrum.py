import numpy as np

from tactophone.perception.features import magnitudes


def test_channels_follow_one_another_unnormalised() -> None:
    time = np.arange(512) / 2000
    window = np.stack((np.sin(2 * np.pi * 250 * time), 0.5 * np.sin(2 * np.pi * 500 * time)), axis=1)
    features = magnitudes(window.astype(np.float32))
    assert features.dtype == np.float32
    assert features[:257].argmax() == 64
    assert features[257:].argmax() == 128
    np.testing.assert_allclose((features[64], features[257 + 128]), (256, 128), rtol=1e-5)


def test_a_batch_equals_one_at_a_time() -> None:
    windows = np.random.default_rng(1).standard_normal((5, 512, 2)).astype(np.float32)
    assert np.array_equal(magnitudes(windows), np.stack([magnitudes(window) for window in windows]))
