"""The classifier of the recipe ``texture``: few weights, calibrated probabilities, and
*none* for unknown sound.

There is one logistic regression for each set of working channels, every kind of surface
and either class weighted the same, regularised until its confidence on held-out
surfaces equals its accuracy there (docs/research/detector.md). Sound unlike the
training data is detected by the Mahalanobis distance, with Ledoit and Wolf's shrunken
covariance (2004); the threshold is what one held-out window in two hundred exceeds.
"""

from dataclasses import replace
from itertools import combinations

import numpy as np
import onnx
from numpy.typing import NDArray

from tactophone.core.types import FloatArray
from tactophone_lab.training.onnx_export import (
    Floats,
    LinearClassifier,
    build_classifier_graph,
)
from tactophone_lab.training.recipe_options import CREST_INDEX
from tactophone_lab.training.sets import HARD_TIPS, Examples, TrainingSet, inner_folds

STRENGTH = 0.005
"""Inverse of the L2 penalty, per unit of mean loss times windows;
docs/research/detector.md has others' scores."""

IMPULSES = (CREST_INDEX, CREST_INDEX + 1)
"""Under a hard tip each regression is the mean of one on all features and one on crest
and clicks, which grow with roughness by geometry (docs/research/detector.md)."""

KNOWN_SHARE = 0.995
"""Share of held-out windows that count as known sound."""


def build_texture(training_set: TrainingSet) -> onnx.ModelProto:
    channels = training_set.spec.channels
    classifier = fit_classifier(
        training_set.examples, channels=channels, hard_tip=training_set.tip in HARD_TIPS
    )
    return build_classifier_graph(classifier, channels=channels)


def channel_sets(channels: int) -> list[tuple[int, ...]]:
    """Return the sets of working channels that have a regression.

    >>> channel_sets(2), channel_sets(1)
    ([(0, 1), (0,), (1,)], [(0,)])
    """
    every = tuple(range(channels))
    return [every, *combinations(every, 1)] if channels > 1 else [every]


def fit_classifier(
    examples: Examples, *, channels: int, hard_tip: bool = False
) -> LinearClassifier:
    """Fit the regressions and the limit of known sound on windows of several surfaces
    of both classes."""
    thinned = examples.thinned()
    centre, scale = thinned.moments()
    standard = replace(
        thinned, features=np.asarray(thinned.standardised(centre, scale), np.float32)
    )
    share = 0.5 if hard_tip else 0.0
    each = len(centre) // channels // 2
    fitted = np.zeros((0, len(centre) + 1))
    for working in channel_sets(channels):
        columns = _columns(working, channels, len(centre))
        # Means and deviations alike.
        parts = [
            (1 - share, columns),
            (share, columns[np.isin(columns % each, IMPULSES)]),
        ]
        regressions = [
            part * _fit_regression(standard, chosen) for part, chosen in parts if part
        ]
        fitted = np.vstack((fitted, np.sum(regressions, axis=0)))
    whitening = _whitening(standard.features, channels)
    limit = float(np.quantile(_held_out_distances(standard, channels), KNOWN_SHARE))
    return LinearClassifier(
        centre, scale, fitted[:, :-1], fitted[:, -1], whitening, limit
    )


def _fit_regression(examples: Examples, columns: NDArray[np.intp]) -> Floats:
    """Fit a logistic regression on some columns; return the weights of all columns,
    with 0 for the unused ones, and the bias."""
    from sklearn.linear_model import LogisticRegression

    model = LogisticRegression(C=STRENGTH, solver="newton-cholesky", max_iter=50)
    model.fit(
        examples.features[:, columns].astype(np.float64),
        examples.rough,
        sample_weight=examples.weights(),
    )
    fitted = np.zeros(examples.features.shape[1] + 1)
    fitted[columns], fitted[-1] = model.coef_[0], model.intercept_[0]
    return fitted


def _whitening(standard: FloatArray, channels: int) -> Floats:
    """Whiten each channel by itself: then the distance of those that work does not
    depend on those that do not."""
    from sklearn.covariance import LedoitWolf

    whitening = np.zeros((standard.shape[1], standard.shape[1]))
    for channel in range(channels):
        columns = _columns((channel,), channels, standard.shape[1])
        precision = (
            LedoitWolf(assume_centered=True)
            .fit(standard[:, columns].astype(np.float64))
            .precision_
        )
        whitening[np.ix_(columns, columns)] = np.linalg.cholesky(precision)
    return whitening


def _held_out_distances(examples: Examples, channels: int) -> Floats:
    # Distances need no classes: of one smooth and one rough surface each can be held
    # out in turn.
    folds = list(inner_folds(examples.rough, examples.surface)) or [
        examples.surface == number for number in np.unique(examples.surface)
    ]
    distances = [
        np.square(
            examples.features[out] @ _whitening(examples.features[~out], channels)
        ).mean(axis=1)
        for out in folds
    ]
    return np.concatenate(distances)


def _columns(
    working: tuple[int, ...], channels: int, features: int
) -> NDArray[np.intp]:
    """Numbers of the features of some channels, which stand one after another."""
    each = features // channels
    return np.concatenate(
        [np.arange(channel * each, (channel + 1) * each) for channel in working]
    )
