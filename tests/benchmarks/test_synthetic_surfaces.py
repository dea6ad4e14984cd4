import numpy as np
import pytest

from simulated_operator import synthetic_object
from tactophone.core.types import Touch


@pytest.mark.parametrize("label", [Touch.SMOOTH, Touch.ROUGH])
def test_invented_stones_keep_their_kind_and_differ(label: Touch) -> None:
    stones = [synthetic_object(label, np.random.default_rng(seed)) for seed in range(6)]
    assert {stone.label for stone in stones} == {label}
    assert len({stone.surface.seed for stone in stones}) == 6


@pytest.mark.slow
def test_rough_is_rougher_than_smooth() -> None:
    def ra(label: Touch) -> list[float]:
        return [
            synthetic_object(label, np.random.default_rng(seed)).roughness.ra
            for seed in range(6)
        ]

    assert min(ra(Touch.ROUGH)) > np.median(ra(Touch.SMOOTH))
