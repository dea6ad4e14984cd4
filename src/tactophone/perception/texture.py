"""Features of the texture detector: running statistics of short windows, restarted where the surface changes.

A window of 32 ms is quick but holds little information; the paper's of 256 ms holds more, but also still the last
surface. So each short window is described (:mod:`tactophone.perception.features`), and the exponentially weighted
mean and deviation of these descriptions are the features. A touch starts with a *prior*, the moments of an average
touch, worth a few windows: the first prediction is uncertain, and the first evidence changes it at once.

An edge under a finger that does not lift is a new surface without a new touch, and the old one would linger in the
statistics. So the newest windows are compared with the statistics before them: where they differ more than a finger's
changes of speed and pressure ever make them differ, the statistics restart with the newest windows.

A channel that is digital silence is missing: its features are NaN, and the model uses the other.
"""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.decision import FORGET_AFTER
from tactophone.types import FloatArray

MEMORY = 0.1
"""Seconds after which the weight of a window has fallen to 1/e, for models whose card does not say."""

PRIOR_WINDOWS = 3.0
"""Windows that the prior is worth at the start of a touch."""

NEWEST = 3.0
"""Windows by which the newest mean fades: two of 32 ms hardly overlap at this distance."""

BEFORE = 5
"""Windows by which the running mean precedes the newest mean that it is compared with, or an edge would be in both."""

SETTLED = 6
"""Windows that the running mean holds at least before a change can be detected."""

MIN_VARIANCE = 1e-4
"""Keeps the root of a variance from being NaN after rounding; negligible beside any real variance."""

SILENT_POWER = 1e-14
"""Mean square, -140 dBFS, under which a channel carries no signal: even a good microphone's noise is far over it."""

Moments = NDArray[np.float64]
"""Mean and mean square of descriptions, shape ``(2, channels, values)``."""

ChangeMetric = NDArray[np.float64]
"""A matrix for each channel, shape ``(channels, values, values)``. It maps the shift of the mean to a vector longer
than 1 for one window in a hundred on one and the same surface; zeros never detect a change."""


class RunningStatistics:
    """Exponentially weighted moments of descriptions, restarted where the surface changes.

    ``fading`` is in windows: after so many, the weight of a window has fallen to 1/e.

    Attributes
    ----------
    prior_weight
        Weight that the prior still has: ``moments + prior_weight * prior`` are the moments to use.

    >>> statistics = RunningStatistics(np.zeros((1, 1, 1)))
    >>> for _ in range(100):
    ...     statistics.push(np.array([[3.0]]), contact=True)
    >>> statistics.moments.round(2).tolist(), round(statistics.prior_weight, 4)
    ([[[3.0]], [[9.0]]], 0.0)
    """

    def __init__(self, change_metric: ChangeMetric, *, fading: float = 10.0) -> None:
        self._change_metric = change_metric
        self._fading = fading
        # Two sets of moments, (2, 2, channels, values), fade side by side, each with its own weight: the running ones
        # and the newest ones.
        self._zeros = np.zeros((2, 2, *change_metric.shape[:2]))
        self._weights = np.zeros((2, 1, 1, 1))
        self._window = np.zeros((2, *change_metric.shape[:2]))
        self.reset()

    @property
    def moments(self) -> Moments:
        """Moments of the descriptions so far, the newest weighing most, the prior counting as zero; a view."""
        running: Moments = self._both[0]
        return running

    def reset(self) -> None:
        """Begin a new touch."""
        self._both = self._zeros
        self.prior_weight = 1.0
        self._count = self._since = self._quiet = 0
        self._history: deque[tuple[Moments, float]] = deque(maxlen=BEFORE)

    def push(self, description: FloatArray, *, contact: bool) -> None:
        """Add a window's description, shape ``(channels, values)``; without contact it is left out."""
        if contact:
            self._add(description)
            self._quiet = 0
            return
        self._quiet += 1
        if self._quiet == FORGET_AFTER:
            self.reset()

    def shift(self) -> NDArray[np.float64] | None:
        """Return the newest mean less the running mean before it, ``(channels, values)``; None until settled."""
        if self._count < BEFORE + SETTLED:
            return None
        before, prior_weight = self._history[0]
        return np.asarray(self._both[1, 0] - before[0] / (1 - prior_weight))

    def _add(self, description: FloatArray) -> None:
        self._window[0] = description
        np.square(description, out=self._window[1])
        self._history.append((self._both[0], self.prior_weight))
        self._count += 1
        self._since += 1
        # A plain average over the first windows (of which the prior is worth PRIOR_WINDOWS), exponential afterwards.
        weight = max(1 / self._fading, 1 / (self._count + PRIOR_WINDOWS))
        self._weights[0], self._weights[1] = weight, max(1 / NEWEST, 1 / self._since)
        # A new array, as the history holds views of the old one.
        self._both = self._both + self._weights * (self._window - self._both)
        self.prior_weight *= 1 - weight
        shift = self.shift()
        if shift is None:
            return
        distance = shift[:, None] @ self._change_metric
        if np.maximum.reduce(np.vecdot(distance, distance), axis=None) <= 1:
            return
        # Another surface: the newest moments replace the running ones, as if only their windows had been in the touch.
        # The prior counts again as it would after so few, or the first guess would be too certain.
        self._count = round(NEWEST)
        self.prior_weight = PRIOR_WINDOWS / (self._count + PRIOR_WINDOWS)
        self._both = np.stack(((1 - self.prior_weight) * self._both[1], self._both[1]))


def fading_of(memory: float, hop: float) -> float:
    """Return the windows, ``hop`` s apart, that a memory in s is long.

    >>> fading_of(0.25, 0.01)
    25.0

    Raises `ValueError` if the memory is shorter than a hop.
    """
    if not memory >= hop:
        raise ValueError(f"memory {memory:g} s, but it must be at least a hop, {hop:g} s")
    return memory / hop


def texture_features(moments: Moments) -> FloatArray:
    """Return means and deviations: shape ``(..., 2 * values)`` from moments ``(2, ..., values)``."""
    mean, square = moments
    values = mean.shape[-1]
    features = np.empty((*mean.shape[:-1], 2 * values), np.float32)
    features[..., :values] = mean
    np.sqrt(np.maximum(square - mean * mean, MIN_VARIANCE), out=features[..., values:], casting="same_kind")
    return features
