import numpy as np
import pytest

from tactophone.simulation.physics.surface import SIZE, SPACING, Surface
from tactophone.simulation.physics.track import Material, envelope, patch_filter, patch_radius, track


def sine(wavelength: float, amplitude: float = 10e-6) -> np.ndarray:
    cycles = round(SIZE * SPACING / wavelength)
    return amplitude * np.sin(2 * np.pi * cycles * np.arange(SIZE) / SIZE)


def test_a_tip_does_not_reach_the_floor_of_narrow_grooves() -> None:
    traced = envelope(sine(0.2e-3), tip_radius=3e-3)
    assert traced.max() == pytest.approx(10e-6)
    assert np.ptp(traced) < 0.1 * 20e-6


def test_a_tip_follows_wide_waves() -> None:
    np.testing.assert_allclose(envelope(sine(20e-3), tip_radius=3e-3), sine(20e-3), atol=0.1e-6)


def test_the_patch_grows_with_load_as_hertz_says() -> None:
    assert patch_radius(8.0, Material()) == pytest.approx(2 * patch_radius(1.0, Material()))


def test_the_patch_kills_fine_waves_and_keeps_coarse_ones() -> None:
    fine, coarse = (np.ptp(patch_filter(sine(length), 0.1e-3)) / 20e-6 for length in (0.1e-3, 10e-3))
    assert fine < 0.1
    assert coarse == pytest.approx(1, abs=0.01)


def test_a_heavier_load_is_smoother() -> None:
    rough = Surface("test", seed=1, rms_height=5e-6, rolloff=0.5e-3)
    traced = track(rough, Material(asperity_radius=3e-4), 3e-3)
    assert np.diff(traced.heavy).std() < np.diff(traced.light).std()
