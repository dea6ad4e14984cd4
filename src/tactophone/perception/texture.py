"""Our own detector's ear: short windows, and a memory of the touch so far that starts unsure.

A window of 32 ms is quick but knows little; the paper's of 256 ms knows more but still holds the last surface. So
each short window is described (:mod:`tactophone.perception.bands`), and the mean and deviation of its description are
remembered with an exponential fading. A touch begins with what touches are like *on average*, worth a few windows:
nothing is believed before there is evidence, and the first evidence moves belief at once.

A channel that is digital silence is missing: its features are NaN, and the model judges by the other.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.bands import VALUES, Bands, Description
from tactophone.perception.model import ModelCard
from tactophone.types import FloatArray

FADING = 10.0
"""Windows (of 10 ms) by which a memory fades to 1/e: belief follows an edge half way in 70 ms."""

PRIOR_WINDOWS = 4.0
"""Windows that the average touch is worth at the start of a touch."""

FORGET_AFTER = 10
"""Windows without contact after which the next one is a new touch: a stroke that turns is not."""

LEAST_VARIANCE = 1e-4
"""Keeps the root of what is left of a variance after rounding from being NaN; of no weight against any real one."""

SILENT_PEAK = 1e-7
"""Peak, -140 dBFS, under which a channel carries nothing at all: even a good microphone's noise is far over it."""


class Memory:
    """Remembers what a touch was like so far.

    Parameters
    ----------
    prior
        Mean and mean square of a touch's description, shape ``(2, ..., values)``.

    Attributes
    ----------
    mean, square
        Mean and mean square of the descriptions so far, the newest weighing most.
    left
        Weight that the prior still has in both.

    Examples
    --------
    >>> memory = Memory(np.array([[0.0], [1.0]]))
    >>> for _ in range(100):
    ...     memory.push(np.array([3.0]), contact=True)
    >>> memory.mean.round(2).tolist(), memory.square.round(2).tolist(), round(memory.left, 4)
    ([3.0], [9.0], 0.0)
    """

    def __init__(self, prior: NDArray[np.float64]) -> None:
        self._prior = prior
        self.reset()

    def reset(self) -> None:
        """Begin a new touch."""
        self.mean, self.square = self._prior
        self.left = 1.0
        self._count = self._quiet = 0

    def push(self, description: Description, *, contact: bool) -> None:
        """Take a window's description in; without contact it is not learnt."""
        if contact:
            self._learn(description)
            self._quiet = 0
            return
        self._quiet += 1
        if self._quiet == FORGET_AFTER:
            self.reset()

    def _learn(self, description: Description) -> None:
        self._count += 1
        weight = max(1 / FADING, 1 / (self._count + PRIOR_WINDOWS))
        self.mean = self.mean + weight * (description - self.mean)
        self.square = self.square + weight * (np.square(description) - self.square)
        self.left *= 1 - weight


class TextureExtractor:
    """Gives the features of kind ``texture``: channel after channel, means then deviations, ``2 * VALUES`` each.

    Parameters
    ----------
    card
        Its settings hold ``prior``: mean and mean square of a touch, ``(2, channels, VALUES)``.
    """

    def __init__(self, card: ModelCard) -> None:
        self._bands = Bands(card.window_size, card.sample_rate)
        self._memory = Memory(read_prior(card.settings["prior"], channels=card.channels))

    def push(self, window: FloatArray, *, contact: bool) -> FloatArray:
        """Give the features of the touch so far; NaN for a channel that is missing."""
        self._memory.push(self._bands.describe(window), contact=contact)
        features = texture_features(self._memory.mean, self._memory.square)
        features[np.abs(window).max(axis=0) < SILENT_PEAK] = np.nan
        return features.reshape(-1)

    def reset(self) -> None:
        """Become as new."""
        self._memory.reset()


def texture_features(mean: NDArray[np.float64], square: NDArray[np.float64]) -> FloatArray:
    """Give means and deviations of what is remembered: shape ``(..., 2 * values)`` from twice ``(..., values)``."""
    deviation = np.sqrt(np.maximum(square - np.square(mean), LEAST_VARIANCE))
    return np.concatenate((mean, deviation), axis=-1).astype(np.float32)


def read_prior(entries: Sequence[object], *, channels: int) -> NDArray[np.float64]:
    """Read a card's ``prior`` back.

    Raises
    ------
    ValueError
        If it has not the shape ``(2, channels, VALUES)``.
    """
    prior = np.asarray(entries, np.float64)
    if prior.shape != (2, channels, VALUES):
        raise ValueError(f"prior of shape {prior.shape}, wanted {(2, channels, VALUES)}")
    return prior
