import numpy as np

from tactophone.pipeline import open_pipeline
from tactophone.simulation.operator import OfflinePipeline


def test_every_call_starts_from_the_initial_state() -> None:
    pipeline = OfflinePipeline(open_pipeline(sample_rate=48_000, channels=2))
    sound = (0.3 * np.random.default_rng(0).standard_normal((48_000, 2))).astype(np.float32)
    first, second = pipeline(sound), pipeline(sound)
    np.testing.assert_array_equal(first, second)
    assert first.shape == (48_000,)
    assert np.abs(first).max() > 0.01


def test_silence_is_rendered_as_silence() -> None:
    pipeline = OfflinePipeline(open_pipeline(sample_rate=48_000, channels=2))
    assert not pipeline(np.zeros((24_000, 2), np.float32)).any()
