import numpy as np
import pytest

from tactophone.simulation.physics.roughness import CUTOFF, roughness


def sine(wavelength: float) -> np.ndarray:
    return np.sin(2 * np.pi * np.arange(100_000) * 1e-6 / wavelength)


def test_a_sine_has_the_textbooks_ra_and_rq() -> None:
    found = roughness(sine(1e-4), spacing=1e-6)
    assert found.ra == pytest.approx(2 / np.pi, rel=1e-3)
    assert found.rq == pytest.approx(1 / np.sqrt(2), rel=1e-3)


def test_half_of_a_wave_at_the_cutoff_passes() -> None:
    assert roughness(sine(CUTOFF), spacing=1e-6).rq == pytest.approx(0.5 / np.sqrt(2), rel=1e-3)


def test_waviness_is_not_roughness() -> None:
    assert roughness(sine(0.02), spacing=1e-6).rq < 0.02
