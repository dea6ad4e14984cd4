"""Fits the head of our own detector: few weights, whose confidence is honest, and which is aware of what it knows.

For each set of channels that may be alive there is one logistic regression, every surface and either class weighing
the same, shrunk until it is no surer of surfaces that it has not met than it is right about them (docs/detector.md).
What is unlike any sound it knows is told by the Mahalanobis distance, with Ledoit and Wolf's shrunken covariance
(2004); the threshold is what one left-out window in two hundred exceeds.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

STRENGTH = 0.05
"""Inverse of the L2 penalty, per unit of mean loss times windows; docs/detector.md has what others gave."""

INNER_FOLDS = 5
KNOWN_SHARE = 0.995
MOST_WINDOWS = 12_000
"""Windows fitted on, evenly drawn: neighbours are nearly the same, and more change no score."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Windows to learn from: features ``(windows, features)``, whether rough, and the surface's number."""

    features: FloatArray
    rough: NDArray[np.bool_]
    surface: NDArray[np.intp]

    def where(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "Examples":
        """Keep some."""
        return Examples(self.features[which], self.rough[which], self.surface[which])

    def thinned(self, most: int = MOST_WINDOWS) -> "Examples":
        """Keep at most so many, evenly."""
        return self.where(np.arange(0, len(self.rough), max(1, -(-len(self.rough) // most))))


@dataclass(frozen=True, slots=True, eq=False)
class Head:
    """Parameters of the head.

    Parameters
    ----------
    centre, scale
        Of the features, which are standardised first.
    weights, biases
        A logistic regression for each set of living channels, shape ``(sets, features)``: all, then each alone.
    whitening
        Shape ``(features, features)``: turns a channel's standardised features into ones of no correlation and unit
        variance.
    limit
        Mean square of the living channels' whitened features over which sound is unknown.
    """

    centre: Floats
    scale: Floats
    weights: Floats
    biases: Floats
    whitening: Floats
    limit: float


def channel_sets(channels: int) -> list[tuple[int, ...]]:
    """List the sets of living channels that there is a regression for.

    >>> channel_sets(2), channel_sets(1)
    ([(0, 1), (0,), (1,)], [(0,)])
    """
    every = tuple(range(channels))
    return [every, *combinations(every, 1)] if channels > 1 else [every]


def fit_head(examples: Examples, *, channels: int) -> Head:
    """Fit and bound a head on windows of several surfaces of both classes."""
    thinned = examples.thinned()
    centre, scale = _moments(thinned.features)
    standard = Examples(_standardised(thinned.features, centre, scale), thinned.rough, thinned.surface)
    sets = channel_sets(channels)
    fitted = [_fitted(standard, _columns(one, channels, standard.features.shape[1])) for one in sets]
    whitening = _whitening(standard.features, channels)
    limit = float(np.quantile(_left_out_distances(standard, channels), KNOWN_SHARE))
    weights, biases = zip(*fitted, strict=True)
    return Head(centre, scale, np.array(weights), np.array(biases), whitening, limit)


def even_weights(rough: NDArray[np.bool_], surface: NDArray[np.intp]) -> Floats:
    """Weigh windows so that both classes, and in each its surfaces, weigh the same; the mean weight is 1."""
    weights = np.empty(len(rough))
    for called in (False, True):
        surfaces = np.unique(surface[rough == called])
        for one in surfaces:
            here = (surface == one) & (rough == called)
            weights[here] = len(rough) / 2 / len(surfaces) / here.sum()
    return weights


def inner_folds(rough: NDArray[np.bool_], surface: NDArray[np.intp]) -> Iterator[NDArray[np.bool_]]:
    """Give the windows left out of each inner fold: whole surfaces, both classes in each where there are enough."""
    dealt = {int(one): place % INNER_FOLDS for called in (True, False)
             for place, one in enumerate(np.unique(surface[rough == called]))}  # fmt: skip
    side = np.array([dealt[int(one)] for one in surface])
    for fold in range(INNER_FOLDS):
        out = side == fold
        if out.any() and 0 < rough[~out].mean() < 1:
            yield out


def _fitted(examples: Examples, columns: NDArray[np.intp]) -> tuple[Floats, float]:
    only = examples.features[:, columns].astype(np.float64)
    weights, bias = _logistic(only, examples.rough, examples.surface)
    full = np.zeros(examples.features.shape[1])
    full[columns] = weights
    return full, bias


def _logistic(features: Floats, rough: NDArray[np.bool_], surface: NDArray[np.intp]) -> tuple[Floats, float]:
    from sklearn.linear_model import LogisticRegression

    model = LogisticRegression(C=STRENGTH, solver="newton-cholesky", max_iter=50)
    model.fit(features, rough, sample_weight=even_weights(rough, surface))
    return np.asarray(model.coef_[0]), float(model.intercept_[0])


def _moments(features: FloatArray) -> tuple[Floats, Floats]:
    wide = features.astype(np.float64)
    return np.nanmean(wide, axis=0), np.maximum(np.nanstd(wide, axis=0), 1e-6)


def _standardised(features: FloatArray, centre: Floats, scale: Floats) -> FloatArray:
    # What is missing is taken to be average, here as in the graph.
    return np.asarray(np.nan_to_num((features - centre) / scale, nan=0.0), np.float32)


def _whitening(standard: FloatArray, channels: int) -> Floats:
    """Whiten each channel by itself: then the distance of those alive does not hang on those that are missing."""
    from sklearn.covariance import LedoitWolf

    whitening = np.zeros((standard.shape[1], standard.shape[1]))
    for one in range(channels):
        columns = _columns((one,), channels, standard.shape[1])
        precision = LedoitWolf(assume_centered=True).fit(standard[:, columns].astype(np.float64)).precision_
        whitening[np.ix_(columns, columns)] = np.linalg.cholesky(precision)
    return whitening


def _left_out_distances(examples: Examples, channels: int) -> Floats:
    distances = [
        np.square(examples.features[out] @ _whitening(examples.features[~out], channels)).mean(axis=1)
        for out in inner_folds(examples.rough, examples.surface)
    ]
    return np.concatenate(distances)


def _columns(living: tuple[int, ...], channels: int, features: int) -> NDArray[np.intp]:
    each = features // channels
    return np.concatenate([np.arange(one * each, (one + 1) * each) for one in living])
