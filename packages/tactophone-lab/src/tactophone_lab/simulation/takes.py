"""The paper's seven takes by name, and the order of the competition's stones.

Separate from strokes and scenes, so that neither numba nor scipy is needed: `tactophone
record` asks a person for them.
"""

from typing import NamedTuple

import numpy as np

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.types import Touch


class Take(NamedTuple):
    """One of the paper's recordings of an object: ``stroke`` is long, short or
    wiggle."""

    stroke: str
    pressure: str

    @property
    def name(self) -> str:
        """The authors' file name; they call strong *loud*."""
        if self.stroke == "wiggle":
            return "wiggle"
        return f"{self.stroke}_{'loud' if self.pressure == 'strong' else self.pressure}"

    @property
    def instruction(self) -> str:
        """What a person is asked to do; wiggles may have any pressure."""
        if self.stroke == "wiggle":
            return "wiggle to and fro without a pause, at any pressure"
        length = (
            "long strokes, from end to end"
            if self.stroke == "long"
            else "short strokes, a centimetre or two"
        )
        return f"{length}, {self.pressure} pressure; lift off now and then"


TAKES = (
    *(
        Take(stroke, pressure)
        for stroke in ("long", "short")
        for pressure in ("light", "medium", "strong")
    ),
    Take("wiggle", "medium"),
)
"""The paper's seven takes."""


def takes_named(names: str) -> list[Take]:
    """Return the takes of a text: names separated by commas, or ``all``; raises
    `ConfigError` for an unknown one."""
    if names == "all":
        return list(TAKES)
    known = {take.name: take for take in TAKES}
    chosen = names.split(",")
    unknown = [name for name in chosen if name not in known]
    if unknown:
        raise ConfigError(
            f"--takes: {unknown[0]!r} is not a take; there are {', '.join(known)}"
            f"{did_you_mean(unknown[0], known)}"
        )
    return [known[name] for name in chosen]


def shuffled(seed: int) -> tuple[Touch, ...]:
    """Return three smooth and two rough, in an order drawn from the seed."""
    labels = [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2
    return tuple(
        labels[k] for k in np.random.default_rng([0xF1FE, seed]).permutation(5)
    )
