"""What a fingertip feels of a vibration: how strong above its threshold, how high, 30 ms at a time, and no finer than
a person can tell.

Sensation level is the vibration's level over the detection threshold at its frequency (Verrillo, J. Acoust. Soc. Am.
35, 1962, 1963: flat to 40 Hz, falling by 12 dB an octave from there to 250 Hz, rising again beyond). Differences under
the just-noticeable ones drown in internal noise: 18 % of frequency (Pongrac, Multimedia Systems 13, 297, 2008), 1.5
dB of level (a Weber fraction of 0.2, the finest of the published 0.2 to 0.58).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.haptics.psychophysics import FULL_DRIVE_DB, LEVEL_JND_DB, PITCH_JND, threshold_db
from tactophone.types import FloatArray

INTEGRATION = 0.03
"""Seconds; the shortest burst that is felt as a vibration."""

GLANCE = 10
"""Values in a third of a second: what is felt as one, and taken as one piece of evidence."""

_D_PRIME = 0.954
"""Standard deviations between two things told apart three times in four (Macmillan & Creelman 2005, table A5.2)."""

LOWEST, HIGHEST = 15.0, 1000.0
"""Hz between which a fingertip feels vibration."""

_ZERO_PADDING = 4
_HILL = 2 / INTEGRATION
"""Hz; half of the spectral hill that a sine makes in so short a time."""


@dataclass(frozen=True, slots=True, eq=False)
class Percepts:
    """A vibration as the nerves have it, one value every ``INTEGRATION`` seconds, before internal noise.

    Parameters
    ----------
    level_db
        Over threshold; 0 where nothing is felt.
    pitch
        Natural logarithm of the frequency in Hz; 0 where nothing is felt.
    """

    level_db: NDArray[np.float64]
    pitch: NDArray[np.float64]


def feel_waveform(waveform: FloatArray, rate: int) -> Percepts:
    """Feel a rendered vibration, of shape ``(samples,)``, from -1 to 1 of full drive."""
    size = round(INTEGRATION * rate)
    windows = np.asarray(waveform[: len(waveform) // size * size], np.float64).reshape(-1, size)
    taper = np.hanning(size)
    power = np.abs(np.fft.rfft(windows * taper, _ZERO_PADDING * size)) ** 2
    frequency = np.asarray(np.fft.rfftfreq(_ZERO_PADDING * size, 1 / rate), np.float64)
    felt = power * 10 ** (-threshold_db(frequency) / 10) * ((frequency > LOWEST) & (frequency < HIGHEST))
    full = _ZERO_PADDING * size * (taper**2).sum() / 4  # what a full-scale sine's power sums to, by Parseval
    level = FULL_DRIVE_DB + 10 * np.log10(felt.sum(axis=1) / full + 1e-20)
    return Percepts(np.maximum(level, 0.0), np.where(level > 0, _pitch(power, felt, frequency), 0.0))


def _pitch(
    power: NDArray[np.float64], felt: NDArray[np.float64], frequency: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Log-frequency of what is felt strongest: the middle of the hill around it, which the threshold's slope skews."""
    peak = frequency[np.argmax(felt, axis=1)]
    near = power * (np.abs(frequency - peak[:, None]) < _HILL)
    middle = (near * frequency).sum(axis=1) / np.maximum(near.sum(axis=1), 1e-30)
    return np.asarray(np.log(np.maximum(middle, 1.0)))


def blur(percepts: Percepts, rng: np.random.Generator) -> Percepts:
    """Add the internal noise that makes just-noticeable differences just noticeable.

    It is drawn once a glance, not once a value: just-noticeable differences are those of whole bursts, and longer ones
    are told apart little better. And once for the whole: what is remembered of a stone is no finer than one glance.
    """
    felt = percepts.level_db > 0
    level = percepts.level_db + _noise(felt.size, rng) * LEVEL_JND_DB / _D_PRIME
    pitch = percepts.pitch + _noise(felt.size, rng) * np.log1p(PITCH_JND) / _D_PRIME
    return Percepts(np.where(felt, np.maximum(level, 0.0), 0.0), np.where(felt, pitch, 0.0))


def _noise(size: int, rng: np.random.Generator) -> NDArray[np.float64]:
    glances = rng.standard_normal(-(-size // GLANCE))
    return np.repeat(glances, GLANCE)[:size] + rng.standard_normal()
