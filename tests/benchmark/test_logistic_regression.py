from pathlib import Path

import numpy as np

from tactophone.benchmark.logistic_regression import fit_regression
from tactophone.dataset import Recording
from tactophone.types import Touch


def test_what_parts_the_labels_is_learnt_and_every_window_is_judged() -> None:
    recordings = [
        Recording(Path(f"{n}.wav"), f"surface {n}", Touch.ROUGH if n % 2 else Touch.SMOOTH, ("contact",))
        for n in range(6)
    ]
    rng = np.random.default_rng(0)

    def describe(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
        rough = recording.label is Touch.ROUGH
        return np.arange(50) / 100, rng.normal(3.0 * rough, 1.0, (50, 2))

    judge = fit_regression(describe, recordings[:4])
    smooth, rough = (judge(recording) for recording in recordings[4:])
    assert smooth.contact.all()
    assert smooth.time.tolist() == (np.arange(50) / 100).tolist()
    np.testing.assert_allclose(rough.probabilities.sum(axis=1), 1.0, rtol=1e-6)
    assert (rough.probabilities.argmax(axis=1) == Touch.ROUGH).mean() > 0.9
    assert (smooth.probabilities.argmax(axis=1) == Touch.SMOOTH).mean() > 0.9
