"""What the demonstration promises of a touch, on two seeds that nothing was chosen on;
`benchmarks/demo_scores.py` has thirty."""

import pytest

from demo_scores import score
from tactophone.core.tips import DEFAULT_TIP


@pytest.mark.slow
def test_a_demonstration_has_no_dips_and_hardly_a_bump() -> None:
    rough, smooth_as_rough, silent, bumps, dips = score(
        400, tip=DEFAULT_TIP, model="", contact="bands"
    )
    assert rough > 0.9
    assert smooth_as_rough < 0.05
    assert silent < 0.01
    # Bumps in 10 s of smooth contact, dips in a minute of rough.
    assert bumps < 1
    assert dips == 0
