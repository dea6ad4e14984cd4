"""The bench test expects the finger that is drawn."""

import pytest

from tactophone_lab.measurement.finger_bench import STIFFNESS

SOFT_SILICONE = 0.12e6
"""Modulus of silicone of Shore 00-30, in Pa."""


def test_the_expected_bed_is_the_drawn_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend("hardware")
    from dimensions import FingerDimensions

    stiffness = FingerDimensions().bed_stiffness * SOFT_SILICONE
    assert stiffness == pytest.approx(STIFFNESS, rel=0.02)
