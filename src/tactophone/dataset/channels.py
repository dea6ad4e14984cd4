"""Which channel of a file is which microphone."""

from tactophone.dataset.values import Recording
from tactophone.errors import DatasetError

TWO_CHANNELS = ("contact", "air")


def channel_order(recording: Recording, *, count: int, single: str = "contact") -> tuple[int, ...]:
    """Return which of a file's channels to read, in the order contact, air.

    Parameters
    ----------
    recording
        If its channels are unknown, they are taken as contact, then air.
    count
        Channels to read: 2 or 1.
    single
        Which microphone to read when ``count`` is 1; the file's first channel if it has no such microphone.

    Raises
    ------
    DatasetError
        If ``count`` is 2 and the file does not hold one contact and one air channel.

    Examples
    --------
    >>> from pathlib import Path
    >>> channel_order(Recording(Path("a.wav"), "slate", channels=("air", "contact")), count=2)
    (1, 0)
    """
    names = recording.channels
    if count == 1:
        return (names.index(single) if single in names else 0,)
    if not names:
        return (0, 1)
    if sorted(names) != sorted(TWO_CHANNELS):
        raise DatasetError(
            f"{recording.path}: holds {' and '.join(names)}, but contact and air are needed; "
            "use the one-channel variant (--channels 1; with the recipe paper, --variant one-channel)"
        )
    return tuple(names.index(name) for name in TWO_CHANNELS)
