"""Random gain and equaliser: training as if each take had been recorded with another microphone, in another place.

What a microphone, its mount and a room do to sound is a gain and a smooth change over frequency; no training set holds
more than a few of them. So every take is used several times, each time with a gain and an equaliser of its own. On
real surfaces of a kind that was left out this adds 0.05 of AUC and 0.1 of balanced accuracy
(docs/research/detector.md).

Descriptions are logarithms, so both are an offset, and a constant offset moves the running mean alone: it can be
applied after the running statistics, exactly, and costs no second pass.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.perception import BAND_COUNT, BAND_VALUES

Offset = NDArray[np.float64]
"""Added to a description: shape ``(channels, values)``, in log10 of power."""


@dataclass(frozen=True, slots=True)
class Augmentation:
    """How takes are varied; the values are the first that were tried, by the study of real sound."""

    copies: int = 4
    """Of each take."""
    gain_db: float = 6.0
    """Standard deviation of the gain; microphones and mounts differ by as much."""
    equaliser_db: float = 3.5
    """The same of the equaliser, at each of its knots."""
    knots: int = 5
    """Of the equaliser, evenly spaced over the bands; between them it is linear."""

    def draw(self, rng: np.random.Generator, *, channels: int, values: int = BAND_VALUES) -> Offset:
        """Draw the offset of one copy of a take, each microphone by itself.

        Level moves with the gain and the equaliser's mean, steepness by itself; crest, clicks and unevenness,
        ratios within one waveform, stay.
        """
        gain = rng.normal(0, self.gain_db / 10, (channels, 1))
        heights = rng.normal(0, self.equaliser_db / 10, (channels, self.knots))
        places = np.linspace(0, self.knots - 1, BAND_COUNT)
        curve = np.array([np.interp(places, np.arange(self.knots), row) for row in heights])
        offset = np.zeros((channels, values))
        offset[:, :BAND_COUNT] = gain + curve
        # The four shapes: level, crest, clicks, steepness.
        offset[:, BAND_COUNT] = gain[:, 0] + curve.mean(axis=1)
        offset[:, BAND_VALUES - 1] = rng.normal(0, self.equaliser_db / 10, channels)
        return offset
