"""Level meters for a terminal of 80 columns: a bar for each microphone, with a mark at the contact threshold."""

import math
import time
from collections.abc import Sequence

import numpy as np
from rich.text import Text

from tactophone.perception import MICROPHONES
from tactophone.types import CONTACT, AudioBlock

LOWEST_DBFS = -72.0
WIDTH = 36
INTERVAL = 0.1
"""Seconds between two updates of the screen."""

HOLD = 0.7
"""Factor by which a peak falls between two updates: slow enough to be read after a tap."""

RED_DBFS, YELLOW_DBFS = -1.0, -6.0


class Meters:
    """Measures levels; `rows` draws them, with a mark at the threshold unless that is NaN."""

    def __init__(self, channels: int, threshold_dbfs: float) -> None:
        self._threshold_dbfs = threshold_dbfs
        self._powers = np.zeros(channels)
        self._peaks = np.zeros(channels)
        self._next = 0.0

    def push(self, block: AudioBlock) -> None:
        """Add sound; levels are averaged over 0.1 s."""
        if not block.size:
            return
        power = np.square(block.samples, dtype=np.float64).mean(axis=0)
        self._powers += (power - self._powers) * min(1.0, block.duration / INTERVAL)
        self._peaks = np.maximum(self._peaks, np.abs(block.samples).max(axis=0))

    def due(self) -> bool:
        """Return whether it is time to draw again."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + INTERVAL
        return True

    def levels(self) -> list[tuple[str, float, float]]:
        """Return each microphone's name, level and peak in dBFS, and lower the peaks."""
        powers, peaks = np.sqrt(self._powers), self._peaks
        self._peaks = HOLD * peaks
        return [(MICROPHONES[channel], _dbfs(powers[channel]), _dbfs(peaks[channel])) for channel in range(len(powers))]

    def rows(self, levels: Sequence[tuple[str, float, float]] | None = None) -> list[Text]:
        """Return a row for each microphone, of levels that were measured now if none are given."""
        return [self._row(*level) for level in (self.levels() if levels is None else levels)]

    def _row(self, name: str, level_dbfs: float, peak_dbfs: float) -> Text:
        style = "red" if peak_dbfs > RED_DBFS else "yellow" if peak_dbfs > YELLOW_DBFS else "green"
        filled, mark = _place(level_dbfs), _place(self._threshold_dbfs)
        row = Text(f" {name:8}")
        for place in range(WIDTH):
            if name == MICROPHONES[CONTACT] and place == mark:
                row.append("┃", "bold")
            else:
                row.append("█" if place < filled else "░", style if place < filled else "dim")
        return row.append(f" {level_dbfs:5.0f} dBFS, peak {peak_dbfs:4.0f}", style)


def _place(level_dbfs: float) -> int:
    return round(WIDTH * min(1.0, max(0.0, 1 - level_dbfs / LOWEST_DBFS))) if math.isfinite(level_dbfs) else -1


def _dbfs(amplitude: float) -> float:
    return max(20 * math.log10(amplitude), LOWEST_DBFS) if amplitude > 0 else LOWEST_DBFS
