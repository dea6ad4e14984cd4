"""Order of the competition's stones; separate from the scenes, so that it needs neither numba nor scipy."""

import numpy as np

from tactophone.types import Touch


def shuffled(seed: int) -> tuple[Touch, ...]:
    """Return three smooth and two rough, in an order drawn from the seed."""
    labels = [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2
    return tuple(labels[k] for k in np.random.default_rng([0xF1FE, seed]).permutation(5))
