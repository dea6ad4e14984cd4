"""Numbers that JSON has no form for."""

import math
from typing import Any


def finite(value: Any) -> Any:
    """Replace infinities and NaN by ``None``, in dictionaries and lists too, as JSON has neither.

    >>> finite({"level": -math.inf, "shares": (0.5, math.nan)})
    {'level': None, 'shares': [0.5, None]}
    """
    if isinstance(value, dict):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
