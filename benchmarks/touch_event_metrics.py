"""Scores of touch events: F-measure of moments, and how often the class is right."""

from collections import Counter
from collections.abc import Iterable, Sequence

from tactophone.core.types import TouchEvent

MISSED = "missed"
"""Class of a true event near which none was detected."""


def match_moments(
    truth: Sequence[float], found: Sequence[float], window: float
) -> list[tuple[float, float]]:
    """Pair true moments with detected ones, each once, in time order, as many as
    possible.

    Parameters
    ----------
    truth, found
        In s.
    window
        Longest distance of a pair, in s. On a line, pairing the earliest with the
        earliest that is near enough gives as many pairs as any other way:
        `mir_eval.onset.f_measure` agrees.

    Examples
    --------
    >>> match_moments([1.0, 2.0], [0.98, 1.5, 2.01], window=0.05)
    [(1.0, 0.98), (2.0, 2.01)]
    """
    pairs, waiting = [], iter(sorted(found))
    candidate = next(waiting, None)
    for moment in sorted(truth):
        while candidate is not None and candidate < moment - window:
            candidate = next(waiting, None)
        if candidate is not None and candidate <= moment + window:
            pairs.append((moment, candidate))
            candidate = next(waiting, None)
    return pairs


def f_measure(truth: Sequence[float], found: Sequence[float], window: float) -> float:
    """Return the F-measure of moments within ``window`` s of each other; 1 where there
    are none and none was found.

    Examples
    --------
    >>> f_measure([1.0, 2.0], [0.98, 1.5, 2.01], window=0.05)
    0.8
    """
    if not len(truth) + len(found):
        return 1.0
    return 2 * len(match_moments(truth, found, window)) / (len(truth) + len(found))


def confusion(
    truth: Iterable[TouchEvent], found: Iterable[TouchEvent], windows: dict[str, float]
) -> Counter[tuple[str, str]]:
    """Count how each true event was classified: ``(true kind, detected kind)``, or
    :data:`MISSED`.

    An event of the right kind is looked for first, then one of another kind; each
    detected event is used once.

    Parameters
    ----------
    truth, found
        In any order; events of a kind without a window are left out.
    windows
        For each kind, the longest distance in s.
    """
    left = [event for event in found if event.kind in windows]
    counts: Counter[tuple[str, str]] = Counter()
    unmatched = []
    for event in sorted(truth, key=lambda event: event.time):
        right = [other for other in left if other.kind == event.kind]
        if not _take_nearest(event, right, left, windows[event.kind]):
            unmatched.append(event)
        else:
            counts[event.kind, event.kind] += 1
    for event in unmatched:
        other = _take_nearest(event, left, left, windows[event.kind])
        counts[event.kind, other.kind if other else MISSED] += 1
    return counts


def class_accuracy(counts: Counter[tuple[str, str]]) -> float:
    """Return the share of true events that were detected as what they are; NaN without
    events."""
    total = counts.total()
    return (
        sum(count for (true, found), count in counts.items() if true == found) / total
        if total
        else float("nan")
    )


def _take_nearest(
    event: TouchEvent,
    among: Sequence[TouchEvent],
    left: list[TouchEvent],
    window: float,
) -> TouchEvent | None:
    """Remove from ``left`` the event nearest in time within the window, and return
    it."""
    nearest = min(among, key=lambda other: abs(other.time - event.time), default=None)
    if nearest is None or abs(nearest.time - event.time) > window:
        return None
    left.remove(nearest)
    return nearest
