"""Contact from consecutive short windows, for models whose windows are as short as those of a contact gate.

A level in a band over 32 ms detects a touch within 14 ms of its start and its end within 12 ms (p95, simulated sound:
docs/research/detector.md), so such models need no contact gate. Their threshold is just over the noise, to detect faint
slides; noise exceeds it forty times a minute for a window or two.
"""

from tactophone.types import Prediction, Touch

CLEAR_DB = 5.0
"""Margin over the threshold at which a single window is contact."""

IN_A_ROW = 3
"""Consecutive windows over the threshold that are contact: noise reaches this twice a minute."""


class ContactDebounce:
    """Separates touches from noise by the level of windows and by their number.

    Examples
    --------
    >>> faint = Prediction((0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, level_dbfs=-38.0, start=0.0, end=0.032)
    >>> contact = ContactDebounce()
    >>> [contact.update(faint, threshold_dbfs=-39.0) for _ in range(4)]
    [False, False, True, True]
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Return to the initial state: no contact."""
        self._touching = False
        self._row = 0

    def update(self, prediction: Prediction, *, threshold_dbfs: float) -> bool:
        """Take the next window's prediction; return whether there is contact."""
        loud = prediction.touch is not Touch.NONE
        self._row = self._row + 1 if loud else 0
        clear = prediction.level_dbfs >= threshold_dbfs + CLEAR_DB or self._row >= IN_A_ROW
        # A touch needs a clear window to start, and lasts as long as windows are loud.
        self._touching = loud and (self._touching or clear)
        return self._touching
