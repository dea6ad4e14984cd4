"""Words of a table's cells, for what several scripts print."""

import math


def in_ms(milliseconds: float, otherwise: str = "never") -> str:
    """Return a time in words: ``otherwise`` where it is infinite, ``-`` where nothing
    was measured.

    >>> in_ms(12.4), in_ms(float("inf")), in_ms(float("nan"))
    ('12 ms', 'never', '-')
    """
    if math.isnan(milliseconds):
        return "-"
    return f"{milliseconds:.0f} ms" if math.isfinite(milliseconds) else otherwise
