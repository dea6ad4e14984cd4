"""Two mono files of one touch: whether they are in step, and how they are joined.

Two recorders start at different moments and their clocks drift; a detector that compares the microphones within a
window then compares different touches. A touch is loud in both microphones, so the levels of the two files rise and
fall together: the lag is where the levels correlate best, measured in the first and in the last half.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset.values import Recording
from tactophone.errors import DatasetError

CELL = 1e-3
"""Seconds over which a level is measured, and so the resolution of a lag."""

LONGEST_LAG = 1.0
"""Seconds within which a lag is looked for."""

MOST_LAG = 5e-3
"""Seconds; half a buffer of the paper's, from one prediction to the next. Sound takes 0.06 ms over the 2 cm from the
surface to the air microphone."""

LEAST_CORRELATION = 0.3
"""Under it the levels do not rise and fall together, and no lag can be stated."""

MOST_DIFFERENCE = 0.1
"""Seconds by which the lengths may differ; the longer file is cut."""

FLOOR = 1e-8
"""Power, -80 dBFS, under which a level is noise of the converter."""


@dataclass(frozen=True, slots=True)
class PairFault:
    """What is wrong with a pair; if ``fatal``, the two cannot be joined."""

    message: str
    fatal: bool = True


@dataclass(frozen=True, slots=True)
class Lag:
    """How late the second sound is: ``seconds`` after the first, at a ``correlation`` of the levels from -1 to 1."""

    seconds: float
    correlation: float


def pair_fault(contact: Path, air: Path) -> PairFault | None:
    """Return what keeps two mono files from being channels of one recording; ``None`` if nothing does."""
    try:
        one, two = (Recording(path, "").read() for path in (contact, air))
    except DatasetError as error:
        return PairFault(f"its pair cannot be read: {error}")
    if one.channels != 1 or two.channels != 1:
        found = f"{one.channels} and {two.channels}"
        return PairFault(f"it and {air.name} hold {found} channels; two mono files make a pair")
    if one.sample_rate != two.sample_rate:
        return PairFault(f"{one.sample_rate} Hz, but {air.name} has {two.sample_rate} Hz; resample one of them first")
    return _timing_fault(one.samples[:, 0], two.samples[:, 0], rate=one.sample_rate, name=air.name)


def _timing_fault(first: NDArray[np.float32], second: NDArray[np.float32], *, rate: int, name: str) -> PairFault | None:
    difference = abs(len(first) - len(second)) / rate
    if difference > MOST_DIFFERENCE:
        return PairFault(f"{name} differs in length by {difference:.3f} s; cut both to the same touch")
    size = min(len(first), len(second))
    lags = [measure_lag(first[part], second[part], rate) for part in (slice(size // 2), slice(size // 2, size))]
    if min(lag.correlation for lag in lags) < LEAST_CORRELATION:
        return PairFault(f"whether {name} is in step is unknown: the levels do not correlate", fatal=False)
    begin, end = (1000 * lag.seconds for lag in lags)
    if max(abs(begin), abs(end)) <= 1000 * MOST_LAG:
        return None
    if abs(end - begin) > 1000 * MOST_LAG:
        return PairFault(f"{name} drifts: {begin:+.0f} ms in its first half, {end:+.0f} ms in its last; use one clock")
    return PairFault(f"{name} is {begin:+.0f} ms out of step; shift it by that and import again")


def measure_lag(first: NDArray[np.float32], second: NDArray[np.float32], rate: int) -> Lag:
    """Measure how late ``second`` is by the correlation of levels in dB; both are mono and as long, at ``rate`` Hz.

    Examples
    --------
    >>> noise = np.random.default_rng(0).normal(0, 0.1, 8000).astype(np.float32)
    >>> noise[2000:5000] *= 10
    >>> round(measure_lag(noise, np.roll(noise, 160), 8000).seconds, 3)
    0.02
    """
    size = max(1, round(CELL * rate))
    levels = [_level(sound, size) for sound in (first, second)]
    count, reach = len(levels[0]), round(LONGEST_LAG / CELL)
    norm = float(np.linalg.norm(levels[0]) * np.linalg.norm(levels[1]))
    if count < 2 or norm == 0:
        return Lag(0.0, 0.0)
    # Padded to twice the length, the circular correlation is the linear one.
    spectra = [np.fft.rfft(level, 2 * count) for level in levels]
    correlation = np.fft.irfft(spectra[1] * spectra[0].conj(), 2 * count) / norm
    lags = np.arange(-min(reach, count - 1), min(reach, count - 1) + 1)
    best = int(lags[np.argmax(correlation[lags])])
    return Lag(best * size / rate, float(correlation[best]))


def _level(sound: NDArray[np.float32], size: int) -> NDArray[np.float64]:
    # The difference of neighbours is a high-pass: hum and handling noise are not the touch.
    change = np.diff(sound, prepend=sound[:1]).astype(np.float64)
    power = np.square(change[: len(change) // size * size]).reshape(-1, size).mean(axis=1)
    level = 10 * np.log10(power + FLOOR)
    return np.asarray(level - level.mean()) if len(level) else level


def read_joined(contact: Path, air: Path) -> tuple[NDArray[np.int32], int, str]:
    """Read two mono files as one sound of two channels, contact and air, as long as the shorter.

    Returns
    -------
    tuple
        The samples, int32 of shape ``(samples, 2)``, so that PCM stays bit by bit; the rate in Hz; the FLAC subtype.

    Raises
    ------
    OSError, soundfile.LibsndfileError
        If a file cannot be read.
    """
    infos = [soundfile.info(path) for path in (contact, air)]
    sounds = [soundfile.read(path, dtype="int32")[0] for path in (contact, air)]
    size = min(map(len, sounds))
    subtype = "PCM_16" if all(info.subtype == "PCM_16" for info in infos) else "PCM_24"
    return np.stack([sound[:size] for sound in sounds], axis=1), int(infos[0].samplerate), subtype
