"""Labelled windows that classifiers are trained on, and how they are weighted."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.types import FloatArray

MOST_WINDOWS = 12_000
"""Windows trained on, evenly drawn: neighbours are nearly the same, and more change no score."""

INNER_FOLDS = 5

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Examples:
    """Windows to train on."""

    features: FloatArray
    """Shape ``(windows, features)``; NaN where a channel is missing."""
    rough: NDArray[np.bool_]
    """Whether rough, shape ``(windows,)``."""
    surface: NDArray[np.intp]
    """Number of the surface, shape ``(windows,)``; kin have the same."""
    importance: Floats | None = None
    """Weight of each window's surface beside others, shape ``(windows,)``; none: all weigh the same."""

    def where(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "Examples":
        """Return the windows of a mask or with these numbers."""
        importance = None if self.importance is None else self.importance[which]
        return Examples(self.features[which], self.rough[which], self.surface[which], importance)

    def thinned(self, most: int = MOST_WINDOWS) -> "Examples":
        """Return at most so many windows, evenly drawn."""
        return self.where(np.arange(0, len(self.rough), max(1, -(-len(self.rough) // most))))

    def weights(self) -> Floats:
        """Return the weights of :func:`even_weights`."""
        return even_weights(self.rough, self.surface, self.importance)

    def moments(self) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of each feature, missing values left out."""
        wide = self.features.astype(np.float64)
        return np.nanmean(wide, axis=0), np.maximum(np.nanstd(wide, axis=0), 1e-6)

    def standardised(self, mean: Floats, scale: Floats) -> Floats:
        """Return the features standardised; missing ones are taken as average, here as in the graph."""
        return np.asarray(np.nan_to_num((self.features - mean) / scale))


def even_weights(rough: NDArray[np.bool_], surface: NDArray[np.intp], importance: Floats | None = None) -> Floats:
    """Return weights of windows that give both classes, and in each class its surfaces, the same weight; mean 1.

    With an importance, ``(windows,)``, the surfaces of a class weigh as it says; it may differ within a surface.
    """
    weights = np.ones(len(rough)) if importance is None else importance.astype(np.float64)
    for label in (False, True):
        for number in np.unique(surface[rough == label]):
            here = (surface == number) & (rough == label)
            weights[here] /= here.sum()
        weights[rough == label] *= len(rough) / 2 / weights[rough == label].sum()
    return weights


def inner_folds(rough: NDArray[np.bool_], surface: NDArray[np.intp]) -> Iterator[NDArray[np.bool_]]:
    """Yield masks of the windows held out in each inner fold: whole surfaces, of both classes where possible."""
    fold_of = {
        int(number): place % INNER_FOLDS
        for label in (True, False)
        for place, number in enumerate(np.unique(surface[rough == label]))
    }
    folds = np.array([fold_of[int(number)] for number in surface])
    for fold in range(INNER_FOLDS):
        held_out = folds == fold
        if held_out.any() and len(set(rough[~held_out])) == 2:
            yield held_out
