"""A judge that is a logistic regression on whatever is told of each window."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.evaluation.predictions import Judge, TakePredictions
from tactophone.training.features.linear_classifier import even_weights
from tactophone.types import Touch

Floats = NDArray[np.float64]


def fit_regression(describe: Callable[[Recording], tuple[Floats, Floats]], recordings: Sequence[Recording]) -> Judge:
    """Learn to tell rough from smooth, every surface weighing the same; the judge is always in contact.

    Parameters
    ----------
    describe
        Gives the end of each window, in s, and what is told of it, shape ``(windows, values)``.
    recordings
        Labelled.
    """
    from sklearn.linear_model import LogisticRegression
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    told = [describe(one)[1] for one in recordings]
    sizes, names = [len(rows) for rows in told], sorted({one.surface for one in recordings})
    rough = np.repeat([one.label is Touch.ROUGH for one in recordings], sizes)
    surface = np.repeat([names.index(one.surface) for one in recordings], sizes)
    model = make_pipeline(StandardScaler(), LogisticRegression(C=0.03, solver="newton-cholesky"))
    model.fit(np.concatenate(told), rough, logisticregression__sample_weight=even_weights(rough, surface))

    def judge(recording: Recording) -> TakePredictions:
        time, rows = describe(recording)
        share = model.predict_proba(rows)[:, 1].astype(np.float32)
        shares = np.stack([np.zeros_like(share), 1 - share, share], axis=1)
        return TakePredictions(recording, time, shares, np.ones(len(time), bool))

    return judge
