"""What a person perceives of a vibration with a fingertip: level above threshold and pitch, every 30 ms.

Sensation level is the vibration's level over the detection threshold at its frequency (Verrillo, J. Acoust. Soc. Am.
35, 1962, 1963: flat to 40 Hz, falling by 12 dB an octave from there to 250 Hz, rising again beyond). Internal noise
masks smaller differences than the just-noticeable ones: 18 % of frequency (Pongrac, Multimedia Systems 13, 297,
2008), 1.5 dB of level (a Weber fraction of 0.2, the finest of the published 0.2 to 0.58).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.haptics import FULL_DRIVE_DB, LEVEL_JND_DB, PITCH_JND, threshold_db
from tactophone.types import FloatArray

INTEGRATION = 0.03
"""Seconds; the shortest burst that people perceive as a vibration."""

GLANCE = 10
"""Values in a third of a second, which count as a single observation."""

_D_PRIME = 0.954
"""Distance in standard deviations of two stimuli recognised three times in four (Macmillan & Creelman 2005, A5.2)."""

LOWEST, HIGHEST = 15.0, 1000.0
"""Hz between which a fingertip perceives vibration."""

_ZERO_PADDING = 4
_HALF_WIDTH = 2 / INTEGRATION
"""Hz; half the width of a sine's spectral main lobe in so short a window."""


@dataclass(frozen=True, slots=True, eq=False)
class Percepts:
    """A vibration as perceived, one value every ``INTEGRATION`` seconds, before internal noise."""

    level_db: NDArray[np.float64]
    """Over threshold; 0 where nothing is perceived."""
    pitch: NDArray[np.float64]
    """Natural logarithm of the frequency in Hz; 0 where nothing is perceived."""


def perceive(waveform: FloatArray, rate: int) -> Percepts:
    """Compute the percepts of a rendered vibration, shape ``(samples,)``, from -1 to 1 of full drive."""
    size = round(INTEGRATION * rate)
    windows = np.asarray(waveform[: len(waveform) // size * size], np.float64).reshape(-1, size)
    taper = np.hanning(size)
    power = np.abs(np.fft.rfft(windows * taper, _ZERO_PADDING * size)) ** 2
    frequency = np.asarray(np.fft.rfftfreq(_ZERO_PADDING * size, 1 / rate), np.float64)
    weighted = power * 10 ** (-threshold_db(frequency) / 10) * ((frequency > LOWEST) & (frequency < HIGHEST))
    full = _ZERO_PADDING * size * (taper**2).sum() / 4  # total power of a full-scale sine, by Parseval's theorem
    level = FULL_DRIVE_DB + 10 * np.log10(weighted.sum(axis=1) / full + 1e-20)
    return Percepts(np.maximum(level, 0.0), np.where(level > 0, _pitch(power, weighted, frequency), 0.0))


def _pitch(
    power: NDArray[np.float64], weighted: NDArray[np.float64], frequency: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Log-frequency of the strongest perceived component.

    It is the centroid of the *unweighted* lobe around the weighted peak, which the threshold's slope would shift.
    """
    peak = frequency[np.argmax(weighted, axis=1)]
    lobe = power * (np.abs(frequency - peak[:, None]) < _HALF_WIDTH)
    centroid = (lobe * frequency).sum(axis=1) / np.maximum(lobe.sum(axis=1), 1e-30)
    return np.asarray(np.log(np.maximum(centroid, 1.0)))


def add_internal_noise(percepts: Percepts, rng: np.random.Generator) -> Percepts:
    """Add the internal noise that makes just-noticeable differences just noticeable.

    It is drawn per glance, not per value: just-noticeable differences are those of whole bursts, and longer bursts
    are distinguished little better. A further draw for the whole vibration models that people remember an object no
    more precisely than a single glance.
    """
    perceived = percepts.level_db > 0
    level = percepts.level_db + _noise(perceived.size, rng) * LEVEL_JND_DB / _D_PRIME
    pitch = percepts.pitch + _noise(perceived.size, rng) * np.log1p(PITCH_JND) / _D_PRIME
    return Percepts(np.where(perceived, np.maximum(level, 0.0), 0.0), np.where(perceived, pitch, 0.0))


def _noise(size: int, rng: np.random.Generator) -> NDArray[np.float64]:
    glances = rng.standard_normal(-(-size // GLANCE))
    return np.repeat(glances, GLANCE)[:size] + rng.standard_normal()
