"""Which channel of a file is which microphone."""

from tactophone.dataset.values import Recording
from tactophone.errors import DatasetError

TWO = ("contact", "air")


def channel_order(recording: Recording, *, wanted: int, alone: str = "contact") -> tuple[int, ...]:
    """Give which of a file's channels to take, in the order contact, air.

    Parameters
    ----------
    recording
        If its channels are not told, they are taken to be contact, then air.
    wanted
        2, or 1.
    alone
        Which to take where one is wanted; the file's first, if it has none such.

    Raises
    ------
    DatasetError
        If two are wanted and the file does not hold one contact and one air channel.

    Examples
    --------
    >>> from pathlib import Path
    >>> channel_order(Recording(Path("a.wav"), "slate", channels=("air", "contact")), wanted=2)
    (1, 0)
    """
    told = recording.channels
    if wanted == 1:
        return (told.index(alone) if alone in told else 0,)
    if not told:
        return (0, 1)
    if sorted(told) != sorted(TWO):
        raise DatasetError(
            f"{recording.path}: holds {' and '.join(told)}, but contact and air are wanted; "
            "take the one-channel variant (--variant one-channel)"
        )
    return tuple(told.index(name) for name in TWO)
