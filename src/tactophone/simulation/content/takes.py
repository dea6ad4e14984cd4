"""The paper's seven takes by name; separate from the movements, so that this needs neither numba nor scipy."""

from typing import NamedTuple


class Take(NamedTuple):
    """One of the paper's recordings of an object: ``stroke`` is long, short or wiggle."""

    stroke: str
    pressure: str

    @property
    def name(self) -> str:
        """The authors' file name; they call strong *loud*."""
        if self.stroke == "wiggle":
            return "wiggle"
        return f"{self.stroke}_{'loud' if self.pressure == 'strong' else self.pressure}"


TAKES = (
    *(Take(stroke, pressure) for stroke in ("long", "short") for pressure in ("light", "medium", "strong")),
    Take("wiggle", "medium"),
)
"""The paper's seven takes."""
