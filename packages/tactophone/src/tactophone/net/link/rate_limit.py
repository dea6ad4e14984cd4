"""A bound on what may come in a time, of handshakes or of sound."""


class RateLimit:
    """A token bucket, which gains ``rate`` tokens a second and holds at most ``burst``.

    >>> limit = RateLimit(10.0, burst=2.0)
    >>> [limit.take(now) for now in (0.0, 0.0, 0.0, 0.1)]
    [True, True, False, True]
    """

    def __init__(self, rate: float, *, burst: float) -> None:
        self._rate = rate
        self._burst = burst
        self._tokens = burst
        self._at = 0.0

    def take(self, now: float, amount: float = 1.0) -> bool:
        """Whether ``amount`` more are within the rate at ``now`` (s)."""
        self._tokens = min(
            self._burst, self._tokens + self._rate * max(0.0, now - self._at)
        )
        self._at = now
        # Rounding may leave a token a hair short of whole.
        if self._tokens < amount - 1e-9:
            return False
        self._tokens -= amount
        return True
