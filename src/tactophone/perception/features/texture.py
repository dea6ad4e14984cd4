"""Our own detector's ear: short windows, and a memory of the surface so far that starts unsure and can be surprised.

A window of 32 ms is quick but knows little; the paper's of 256 ms knows more but still holds the last surface. So
each short window is described (:mod:`tactophone.perception.features.bands`), and the mean and deviation of its description are
remembered with an exponential fading. A touch begins with what touches are like *on average*, worth a few windows:
nothing is believed before there is evidence, and the first evidence moves belief at once.

An edge under a finger that does not lift is a new surface without a new touch, and what fades would linger. So the
newest windows are held against what was remembered before them: where they lie farther off than a finger's changes of
speed and press ever bring them, the memory begins anew with them.

A channel that is digital silence is missing: its features are NaN, and the model judges by the other.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.features.bands import VALUES, BandFeatures, Bands
from tactophone.perception.features.loudness import band_of_powers
from tactophone.perception.model_file import ModelCard
from tactophone.types import CONTACT, FloatArray

FADING = 10.0
"""Windows (of 10 ms) by which a memory fades to 1/e."""

PRIOR_WINDOWS = 3.0
"""Windows that the average touch is worth at the start of a touch."""

FORGET_AFTER = 25
"""Windows without contact after which the next one is a new touch: a stroke that turns stands still, and is heard no
more, for up to a quarter of a second; a finger that lifts stays away for longer (both on simulated strokes)."""

NEWEST = 3.0
"""Windows by which what is held against the memory fades: two of 32 ms hardly overlap at this distance."""

BEFORE = 5
"""Windows that the memory is older than what is held against it, or an edge would be in both."""

SETTLED = 6
"""Windows that a memory holds at least before anything can surprise it."""

LEAST_VARIANCE = 1e-4
"""Keeps the root of what is left of a variance after rounding from being NaN; of no weight against any real one."""

SILENT_POWER = 1e-14
"""Mean square, -140 dBFS, under which a channel carries nothing: even a good microphone's noise is far over it."""

Moments = NDArray[np.float64]
"""Mean and mean square of descriptions, shape ``(2, channels, values)``."""

Surprise = NDArray[np.float64]
"""Turns how far a channel's mean has moved into a vector that is longer than 1 once in a hundred windows on one and
the same surface, shape ``(channels, values, values)``; zeros are never surprised."""


class RunningStatistics:
    """Remembers what a surface was like so far.

    Parameters
    ----------
    surprise
        See :data:`Surprise`.

    Attributes
    ----------
    moments
        Of the descriptions so far, the newest weighing most, those of the average touch counting as zero; a view.
    left
        Weight that the average touch still has: ``moments + left * prior`` is what is believed.

    Examples
    --------
    >>> memory = RunningStatistics(np.zeros((1, 1, 1)))
    >>> for _ in range(100):
    ...     memory.push(np.array([[3.0]]), contact=True)
    >>> memory.moments.round(2).tolist(), round(memory.left, 4)
    ([[[3.0]], [[9.0]]], 0.0)
    """

    def __init__(self, surprise: Surprise) -> None:
        self._surprise = surprise
        # The memory and what is held against it fade side by side, each with its own weight.
        self._nothing = np.zeros((2, 2, *surprise.shape[:2]))
        self._weights = np.zeros((2, 1, 1, 1))
        self._now = np.zeros((2, *surprise.shape[:2]))
        self.reset()

    @property
    def moments(self) -> Moments:
        """What is remembered of the descriptions so far."""
        remembered: Moments = self._both[0]
        return remembered

    def reset(self) -> None:
        """Begin a new touch."""
        self._both = self._nothing
        self.left = 1.0
        self._count = self._since = self._quiet = 0
        self._before: deque[tuple[Moments, float]] = deque(maxlen=BEFORE)

    def push(self, description: FloatArray, *, contact: bool) -> None:
        """Take a window's description in, shape ``(channels, values)``; without contact it is not learnt."""
        if contact:
            self._learn(description)
            self._quiet = 0
            return
        self._quiet += 1
        if self._quiet == FORGET_AFTER:
            self.reset()

    def moved(self) -> NDArray[np.float64] | None:
        """Tell how far the newest mean lies from what was remembered before it; nothing while too little was."""
        if self._count < BEFORE + SETTLED:
            return None
        before, left = self._before[0]
        return np.asarray(self._both[1, 0] - before[0] / (1 - left))

    def _learn(self, description: FloatArray) -> None:
        self._now[0] = description
        np.square(description, out=self._now[1])
        self._before.append((self._both[0], self.left))
        self._count += 1
        self._since += 1
        weight = max(1 / FADING, 1 / (self._count + PRIOR_WINDOWS))
        self._weights[0], self._weights[1] = weight, max(1 / NEWEST, 1 / self._since)
        self._both = self._both + self._weights * (self._now - self._both)
        self.left *= 1 - weight
        moved = self.moved()
        if moved is not None and self._surprises(moved):
            self._begin_anew()

    def _surprises(self, moved: NDArray[np.float64]) -> bool:
        far = moved[:, None] @ self._surprise
        return bool(np.maximum.reduce(np.vecdot(far, far), axis=None) > 1)

    def _begin_anew(self) -> None:
        self._count = round(NEWEST)
        self.left = PRIOR_WINDOWS / (self._count + PRIOR_WINDOWS)
        self._both = np.stack(((1 - self.left) * self._both[1], self._both[1]))


class TextureExtractor:
    """Gives the features of kind ``texture``: channel after channel, means then deviations, ``2 * VALUES`` each.

    Parameters
    ----------
    card
        Its settings hold ``prior``, the moments of the average touch, and ``surprise``: see :data:`Surprise`.
    """

    def __init__(self, card: ModelCard) -> None:
        self._bands = Bands(card.window_size, card.sample_rate)
        self._window: FloatArray | None = None
        self._heard = self._bands.hear(np.zeros((card.window_size, card.channels), np.float32))
        self._prior = _read(card.settings["prior"], "prior", (2, card.channels, VALUES))
        self._memory = RunningStatistics(_read(card.settings["surprise"], "surprise", (card.channels, VALUES, VALUES)))

    def level_dbfs(self, window: FloatArray) -> float:
        """Give the banded level of the first channel, from the spectrum that the features need too."""
        return band_of_powers(self._hear(window).powers[CONTACT], len(window))

    def push(self, window: FloatArray, *, contact: bool) -> FloatArray:
        """Give the features of the touch so far; NaN for a channel that is missing."""
        heard, self._window = self._hear(window), None
        self._memory.push(self._bands.describe(heard), contact=contact)
        features = texture_features(self._memory.moments + self._memory.left * self._prior)
        powers = np.vecdot(heard.sound, heard.sound)
        if min(powers.tolist()) < SILENT_POWER * len(window):
            features[powers < SILENT_POWER * len(window)] = np.nan
        return features.reshape(-1)

    def reset(self) -> None:
        """Become as new."""
        self._memory.reset()

    def _hear(self, window: FloatArray) -> BandFeatures:
        """Take a window's spectrum, once for its level and its features."""
        if window is not self._window:
            self._window, self._heard = window, self._bands.hear(window)
        return self._heard


def texture_features(moments: Moments) -> FloatArray:
    """Give means and deviations of what is remembered: shape ``(..., 2 * values)`` from ``(2, ..., values)``."""
    mean, square = moments
    values = mean.shape[-1]
    features = np.empty((*mean.shape[:-1], 2 * values), np.float32)
    features[..., :values] = mean
    np.sqrt(np.maximum(square - mean * mean, LEAST_VARIANCE), out=features[..., values:], casting="same_kind")
    return features


def _read(entries: Sequence[object], name: str, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.asarray(entries, np.float64)
    if array.shape != shape:
        raise ValueError(f"{name} of shape {array.shape}, wanted {shape}")
    return array
