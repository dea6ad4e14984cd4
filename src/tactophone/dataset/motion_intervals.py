"""When a finger slides, where a data set tells it: a finger that has landed and stands still makes no sound.

The simulator knows: its sets have a property ``slides``, stretches of ``start-end`` in seconds, divided by spaces.
Nothing can be told rough from smooth before it slides, so that delays are counted from there. Recordings that do not
tell are taken to slide from the first touch on.
"""

from dataclasses import dataclass

from tactophone.dataset import Recording

CROSSING = 0.1
"""Seconds after an edge through which a finger that crosses it still slides."""


@dataclass(frozen=True, slots=True)
class Stretch:
    """From when to when, in s."""

    start: float
    end: float


def read_slides(recording: Recording) -> tuple[Stretch, ...] | None:
    """Give the stretches in which the finger slides; nothing if the recording does not tell."""
    told = recording.known("slides")
    if not told:
        return None
    return tuple(Stretch(*map(float, one.split("-"))) for one in told.split())


def write_slides(stretches: tuple[Stretch, ...]) -> str:
    """Write stretches as the property has them.

    >>> write_slides((Stretch(0.25, 1.0), Stretch(1.5, 2.25)))
    '0.250-1.000 1.500-2.250'
    """
    return " ".join(f"{one.start:.3f}-{one.end:.3f}" for one in stretches)


def first_slide(recording: Recording, start: float, end: float) -> float | None:
    """Give the moment from which the finger slides between two others; nothing if it never does."""
    stretches = read_slides(recording)
    if stretches is None:
        return start
    return min((max(one.start, start) for one in stretches if one.end > start and one.start < end), default=None)


def slides_over(recording: Recording, edge: float) -> bool:
    """Tell whether the finger crosses an edge sliding, and does not come to a stop on it."""
    stretches = read_slides(recording)
    return stretches is None or any(one.start <= edge and one.end >= edge + CROSSING for one in stretches)


def cut_slides(recording: Recording, start: float, end: float, *, place: float) -> tuple[Stretch, ...] | None:
    """Give the slides of a piece that begins at ``start`` and lies at ``place`` in another recording."""
    stretches = read_slides(recording)
    if stretches is None:
        return None
    shift = place - start
    within = [Stretch(max(one.start, start) + shift, min(one.end, end) + shift) for one in stretches]
    return tuple(one for one in within if one.end > one.start)
