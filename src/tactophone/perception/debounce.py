"""Contact by the word of short windows in a row, for models whose windows are as short as a contact gate's look.

A banded level over 32 ms tells a touch within 14 ms of its beginning and an end within 12 (19 in 20 of them, on
simulated sound: docs/detector.md), so that such models need no gate beside them. But its threshold lies just over the
noise, so that faint slides are heard; and there noise passes it forty times a minute for a window or two.
"""

from tactophone.types import Prediction, Touch

CLEAR_DB = 5.0
"""How far over the threshold one window must be to be believed by itself."""

IN_A_ROW = 3
"""Windows that are believed at any level over the threshold: noise passes it so often in a row twice a minute."""


class ContactDebounce:
    """Tells touches from noise by how loud windows are, and for how long.

    Examples
    --------
    >>> faint = Prediction((0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, level_dbfs=-38.0, start=0.0, end=0.032)
    >>> contact = ContactDebounce()
    >>> [contact.hear(faint, threshold_dbfs=-39.0) for _ in range(4)]
    [False, False, True, True]
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Become as new: no contact."""
        self._touching = False
        self._row = 0

    def hear(self, prediction: Prediction, *, threshold_dbfs: float) -> bool:
        """Take the next window's belief; tell whether there is contact."""
        loud = prediction.touch is not Touch.NONE
        self._row = self._row + 1 if loud else 0
        clear = prediction.level_dbfs >= threshold_dbfs + CLEAR_DB or self._row >= IN_A_ROW
        self._touching = loud and (self._touching or clear)
        return self._touching
