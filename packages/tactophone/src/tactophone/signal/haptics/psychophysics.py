"""How strong a vibration is to a finger, and how many steps of it a finger can
discriminate.

Sensation level is the vibration's level over the detection threshold at its frequency
(Verrillo, J. Acoust. Soc. Am. 35, 1962, 1963: flat to 40 Hz, falling by 12 dB an octave
from there to 250 Hz, rising again beyond).
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FULL_DRIVE_DB = 65.0
"""Sensation level of full drive at 250 Hz: assumed for a strong voice coil; rough at 60
Hz is then 40 dB."""

PITCH_JND = 0.18
"""Just-noticeable difference of frequency (Pongrac, Multimedia Systems 13, 297,
2008)."""

LEVEL_JND_DB = 1.5
"""Just-noticeable difference of level: a Weber fraction of 0.2, the finest of the
published 0.2 to 0.58."""

_BEST = 250.0
"""Hz at which the skin is most sensitive (Verrillo 1963)."""

_CORNER = 40.0
"""Hz up to which the threshold is flat (Verrillo 1962)."""


def threshold_db(frequency: NDArray[np.float64] | float) -> NDArray[np.float64]:
    """Return the detection threshold, in dB over the one at 250 Hz, for the same drive
    of the actuator.

    >>> [round(float(threshold_db(f)), 1) for f in (20, 40, 60, 120, 250)]
    [31.7, 31.7, 24.7, 12.7, 0.0]
    """
    above_corner = np.maximum(np.asarray(frequency, dtype=np.float64), _CORNER)
    octaves = np.log2(above_corner / _BEST)
    return np.asarray(12.0 * np.abs(octaves))


def sensation_db(amplitude: float, frequency: float) -> float:
    """Return the level of a sine over threshold in dB; 0 below the threshold.

    >>> round(sensation_db(1.0, 60.0), 1), round(sensation_db(0.056, 120.0), 1)
    (40.3, 27.3)
    >>> sensation_db(0.0, 60.0)
    0.0
    """
    if amplitude <= 0:
        return 0.0
    drive_db = 20 * math.log10(amplitude)
    return max(0.0, FULL_DRIVE_DB + drive_db - float(threshold_db(frequency)))


def amplitude_for(level_db: float, frequency: float) -> float:
    """Return the amplitude of a sine at a level over threshold; at most full drive.

    >>> round(amplitude_for(sensation_db(0.3, 90.0), 90.0), 3)
    0.3
    """
    drive_db = level_db - FULL_DRIVE_DB + float(threshold_db(frequency))
    return float(min(1.0, 10 ** (drive_db / 20)))


def count_steps(stimuli: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Count the just-noticeable steps along a path of vibrations: of frequency alone,
    and of frequency and level.

    ``stimuli`` are amplitude and frequency, close to each other, from one end of the
    path to the other. Steps of frequency and of level add up as independent sensations
    do (root of the sum of squares).

    >>> octave = [(0.05, 120.0 * 2 ** (-k / 100)) for k in range(101)]
    >>> frequency, both = count_steps(octave)
    >>> round(frequency, 1)
    4.2
    """
    path = [
        (math.log(pitch), sensation_db(amplitude, pitch))
        for amplitude, pitch in stimuli
    ]
    moves = np.abs(np.diff(np.array(path), axis=0)) / (
        math.log1p(PITCH_JND),
        LEVEL_JND_DB,
    )
    return float(moves[:, 0].sum()), float(np.hypot(*moves.T).sum())
