"""What an actuator can play, as measured or as its data sheet says; profiles use it in place of typical figures."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from tactophone.errors import ConfigError

_FORM = "wanted frequencies in Hz with levels in dB, rising, as in 40:-12,160:0,250:-6"


@dataclass(frozen=True, slots=True)
class ActuatorResponse:
    """An actuator's resonance, band, motor speeds and level by frequency; NaN or empty where unknown.

    Examples
    --------
    >>> response = ActuatorResponse(lowest=80.0, levels=((80.0, -10.0), (160.0, 0.0)))
    >>> response.level_db(80.0), response.level_db(113.137).__round__(1), response.level_db(400.0)
    (-10.0, -5.0, 0.0)
    >>> response.within(60.0), response.within(100.0)
    (80.0, 100.0)
    """

    resonance: float = math.nan
    """In Hz."""
    lowest: float = math.nan
    highest: float = math.nan
    """`lowest` and `highest`: the band in Hz: where the level is at most 10 dB under that of the resonance."""
    slowest: float = math.nan
    fastest: float = math.nan
    """`slowest` and `fastest`: speeds of a rotating motor in Hz: the lowest at which it turns, and that at full
    drive."""
    levels: tuple[tuple[float, float], ...] = ()
    """``(frequency in Hz, level in dB relative to the resonance)``, frequencies rising."""

    def __post_init__(self) -> None:
        for low, high in ((self.lowest, self.highest), (self.slowest, self.fastest)):
            if low >= high:  # false for NaN
                raise ConfigError(f"actuator: {low:g} to {high:g} Hz is no range; wanted the lower figure first")

    def level_db(self, frequency: float) -> float:
        """Return the level at a frequency, interpolated over the logarithm of frequency; 0 where unknown."""
        if not self.levels:
            return 0.0
        frequencies, levels = np.array(self.levels).T
        return float(np.interp(math.log(frequency), np.log(frequencies), levels))

    def within(self, frequency: float) -> float:
        """Return the nearest frequency in the band."""
        low = -math.inf if math.isnan(self.lowest) else self.lowest
        high = math.inf if math.isnan(self.highest) else self.highest
        return min(max(frequency, low), high)


UNKNOWN = ActuatorResponse()
"""Of an actuator that was not measured: profiles then use typical figures."""


def known(value: float, typical: float) -> float:
    """Return a figure, or the typical one where it is NaN."""
    return typical if math.isnan(value) else value


def parse_levels(text: str) -> tuple[tuple[float, float], ...]:
    """Parse levels written as ``40:-12,160:0``.

    Raises
    ------
    ConfigError
        If the text has another form, or the frequencies do not rise.

    Examples
    --------
    >>> parse_levels("40:-12, 160:0")
    ((40.0, -12.0), (160.0, 0.0))
    """
    pairs = [entry.split(":") for entry in text.split(",") if entry.strip()]
    try:
        levels = tuple((float(frequency), float(level)) for frequency, level in pairs)
    except ValueError:
        raise ConfigError(f"actuator.response = {text!r}: {_FORM}") from None
    frequencies = [frequency for frequency, _ in levels]
    rising = all(low < high for low, high in itertools.pairwise([0.0, *frequencies]))
    if not rising or not all(math.isfinite(number) for pair in levels for number in pair):
        raise ConfigError(f"actuator.response = {text!r}: {_FORM}")
    return levels
