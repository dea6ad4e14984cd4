"""What some sources can do besides: name the true touch, and compile themselves before a run."""

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from tactophone.types import Source


@runtime_checkable
class LabelledSource(Protocol):
    """A source whose true touch is known, because it is simulated or labelled."""

    def truth_now(self) -> int:
        """Return the `Touch` at the end of the newest block; -1 when it is not known."""


@runtime_checkable
class LabelledHand(Protocol):
    """A hand of which the true touch of each finger is known."""

    def truth_of(self, finger: int) -> int:
        """Return the `Touch` of a finger at the end of the newest block; -1 when it is not known."""


@runtime_checkable
class RehearsableSource(Protocol):
    """A source that compiles itself at first use."""

    def rehearse(self) -> None:
        """Compile now; the sound to come stays the same."""


def truth_of(source: Source) -> Callable[[int], int]:
    """Return a function of a finger: its true touch now; -1 where that is not known."""
    # Asked once: whether an object fits a protocol takes 25 us.
    if isinstance(source, LabelledHand):
        return source.truth_of
    if isinstance(source, LabelledSource):
        return lambda _: source.truth_now()
    return lambda _: -1
