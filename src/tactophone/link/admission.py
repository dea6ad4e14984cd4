"""Which ClientHellos an answerer spends time and memory on.

A hello with the label of a trusted caller (`handshake.call_label`) has places of its own. Anybody else may still call,
so that an untrusted robot gets its refusal, but shares few places and little time with all other strangers.
"""

from collections.abc import Mapping
from typing import TypeAlias

from tactophone.link.handshake import Address, Handshake

MAX_HANDSHAKES = 4
"""Concurrent handshakes of trusted callers, and the same number of strangers; each has returned a cookie."""

STRANGER_TIME = 0.5
"""Seconds for which a stranger's unfinished handshake keeps its place: above the round trip of most paths."""

KNOWN_RATE, STRANGER_RATE = 200.0, 50.0
"""ClientHellos answered in a second. A caller sends 2 for each handshake, and at most 10 a second; one costs about
0.1 ms before its cookie and 1 ms after, so that strangers get at most some 5 % of a processor."""

BURST = 0.5
"""Seconds of the rate that may come at once."""

Pending: TypeAlias = Mapping[tuple[Address, bytes], Handshake]
"""Unfinished handshakes, by address and ClientHello random, oldest first."""


class RateLimit:
    """A token bucket.

    Examples
    --------
    >>> limit = RateLimit(10.0, burst=2.0)
    >>> [limit.take(now) for now in (0.0, 0.0, 0.0, 0.1)]
    [True, True, False, True]
    """

    def __init__(self, rate: float, *, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._tokens, self._at = burst, 0.0

    def take(self, now: float) -> bool:
        """Whether one more is within the rate at ``now`` (s)."""
        self._tokens = min(self._burst, self._tokens + self._rate * max(0.0, now - self._at))
        self._at = now
        # Rounding may leave a token a hair short of whole.
        if self._tokens < 1.0 - 1e-9:
            return False
        self._tokens -= 1.0
        return True


class Admission:
    """Admits hellos, and chooses the unfinished handshake that gives way to another."""

    def __init__(self) -> None:
        self._limits = {
            known: RateLimit(rate, burst=rate * BURST) for known, rate in ((True, KNOWN_RATE), (False, STRANGER_RATE))
        }

    def admits(self, pending: Pending, *, known: bool, now: float) -> bool:
        """Whether a hello is answered: within the rate, and if a stranger's, with a place to take."""
        if (
            not known
            and self._is_full(pending, known=False)
            and self._replaceable(pending, known=False, now=now) is None
        ):
            return False
        return self._limits[known].take(now)

    def displaced(self, pending: Pending, *, source: Address, known: bool, now: float) -> list[tuple[Address, bytes]]:
        """Return the handshakes that end when one from ``source`` begins: its own before, and one too many."""
        own = [key for key in pending if key[0] == source]
        if own or not self._is_full(pending, known=known):
            return own
        replaceable = self._replaceable(pending, known=known, now=now)
        return [] if replaceable is None else [replaceable]

    def _is_full(self, pending: Pending, *, known: bool) -> bool:
        return sum(handshake.known == known for handshake in pending.values()) >= MAX_HANDSHAKES

    def _replaceable(self, pending: Pending, *, known: bool, now: float) -> tuple[Address, bytes] | None:
        """Return the oldest handshake; none while a stranger's is too young to give way."""
        oldest = next((key for key, handshake in pending.items() if handshake.known == known), None)
        if oldest is None or known or now - pending[oldest].begun > STRANGER_TIME:
            return oldest
        return None
