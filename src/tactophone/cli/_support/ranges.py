"""Numbers on the command line: an option declares its range once, for the check and for its help line."""

import math
from dataclasses import dataclass

from tactophone.errors import ConfigError


@dataclass(frozen=True, slots=True)
class Within:
    """The type of an option that takes a number from ``low`` to ``high``; write the range as ``%(type)s`` in its help.

    ``kind`` is ``int`` or ``float``; with ``over``, ``low`` itself is out of the range. Called with a text, it raises
    `ConfigError` if that is no number within the range.

    >>> str(Within(float, 0, 1, unit="of full drive")), str(Within(int, 1)), str(Within(float, 0, over=True, unit="s"))
    ('0 to 1 of full drive', '1 or more', 'over 0 s')
    """

    kind: type[int] | type[float]
    low: float
    high: float = math.inf
    over: bool = False
    unit: str = ""

    def __call__(self, text: str) -> float:
        try:
            value = self.kind(text)
        except ValueError:
            raise ConfigError(f"{text}: must be a {'whole ' * (self.kind is int)}number, {self}") from None
        outside = not self.low <= value <= self.high or (self.over and value == self.low) or value == math.inf
        if outside:
            raise ConfigError(f"{text}: must be {self}")
        return value

    def __str__(self) -> str:
        low, unit = f"{'over ' * self.over}{self.low:g}", f" {self.unit}" * bool(self.unit)
        if self.high < math.inf:
            return f"{low} to {self.high:g}{unit}"
        return f"{low}{unit}" if self.over else f"{low}{unit} or more"


CEILING = Within(float, 0, 1, unit="of full drive")
SEED = Within(int, 0)
"""A random seed, of NumPy and of torch."""
