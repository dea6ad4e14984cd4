"""When the finger slides: a finger that has landed and stands still makes no sound.

Simulated data sets have a property ``slides``: intervals ``start-end`` in seconds, separated by spaces. Rough and
smooth differ only while the finger slides, so decision delays are counted from there. A recording without this
property is taken to slide from the first contact on.
"""

from dataclasses import dataclass

from tactophone.dataset.values import Recording

CROSSING = 0.1
"""Seconds after an edge for which a finger that crosses it still slides."""


@dataclass(frozen=True, slots=True)
class MotionInterval:
    """Start and end of a slide, in s."""

    start: float
    end: float


def read_slides(recording: Recording) -> tuple[MotionInterval, ...] | None:
    """Return the intervals in which the finger slides; ``None`` if they are unknown."""
    text = recording.known("slides")
    if not text:
        return None
    return tuple(MotionInterval(*map(float, entry.split("-"))) for entry in text.split())


def write_slides(intervals: tuple[MotionInterval, ...]) -> str:
    """Format intervals as the property ``slides``.

    >>> write_slides((MotionInterval(0.25, 1.0), MotionInterval(1.5, 2.25)))
    '0.250-1.000 1.500-2.250'
    """
    return " ".join(f"{interval.start:.3f}-{interval.end:.3f}" for interval in intervals)


def first_slide(recording: Recording, start: float, end: float) -> float | None:
    """Return when, between ``start`` and ``end``, the finger begins to slide; ``None`` if it never does."""
    intervals = read_slides(recording)
    if intervals is None:
        return start
    starts = (max(interval.start, start) for interval in intervals if interval.end > start and interval.start < end)
    return min(starts, default=None)


def slides_over(recording: Recording, edge: float) -> bool:
    """Return whether the finger crosses an edge, at ``edge`` s, without stopping on it."""
    intervals = read_slides(recording)
    return intervals is None or any(
        interval.start <= edge and interval.end >= edge + CROSSING for interval in intervals
    )


def cut_slides(recording: Recording, start: float, end: float, *, place: float) -> tuple[MotionInterval, ...] | None:
    """Return the slides of the piece from ``start`` to ``end`` after it was moved to ``place``, all in s."""
    intervals = read_slides(recording)
    if intervals is None:
        return None
    shift = place - start
    moved = (
        MotionInterval(max(interval.start, start) + shift, min(interval.end, end) + shift) for interval in intervals
    )
    return tuple(interval for interval in moved if interval.end > interval.start)
