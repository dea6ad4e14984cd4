import numpy as np
import pytest

from tactophone_lab.simulation.mechanics import SKIN, tip_on_body
from tactophone_lab.simulation.surface import (
    HEIGHT_SPACING,
    SIZE,
    Material,
    Surface,
    envelope,
    patch_filter,
    track,
)


def sine(wavelength: float, amplitude: float = 10e-6) -> np.ndarray:
    cycles = round(SIZE * HEIGHT_SPACING / wavelength)
    return amplitude * np.sin(2 * np.pi * cycles * np.arange(SIZE) / SIZE)


def test_a_tip_does_not_reach_the_floor_of_narrow_grooves() -> None:
    traced = envelope(sine(0.2e-3), tip_radius=3e-3)
    assert traced.max() == pytest.approx(10e-6)
    assert np.ptp(traced) < 0.1 * 20e-6


def test_a_tip_follows_wide_waves() -> None:
    np.testing.assert_allclose(
        envelope(sine(20e-3), tip_radius=3e-3), sine(20e-3), atol=0.1e-6
    )


def test_the_patch_grows_with_load_as_hertz_says() -> None:
    mechanics = tip_on_body(3e-3, SKIN, 55e9, rq=1e-6)
    assert mechanics.patch(8.0) == pytest.approx(2 * mechanics.patch(1.0))


def test_the_patch_kills_fine_waves_and_keeps_coarse_ones() -> None:
    fine, coarse = (
        np.ptp(patch_filter(sine(length), 0.1e-3)) / 20e-6 for length in (0.1e-3, 10e-3)
    )
    assert fine < 0.1
    assert coarse == pytest.approx(1, abs=0.01)


def test_a_heavier_load_is_smoother() -> None:
    rough = Surface("test", seed=1, rms_height=5e-6, rolloff=0.5e-3)
    traced = track(rough, Material(), 3e-3, SKIN)
    assert np.diff(traced.heavy).std() < np.diff(traced.light).std()


def test_the_envelope_is_exact() -> None:
    """Against the definition, at places all over a rough profile and across its
    seam."""
    rng = np.random.default_rng(0)
    height = np.cumsum(rng.standard_normal(SIZE)) * 1e-8
    height -= np.linspace(0, height[-1], SIZE)
    places = np.concatenate([rng.integers(SIZE, size=200), [0, 1, SIZE - 1]])
    reach = int(np.sqrt(2 * 3e-3 * np.ptp(height)) / HEIGHT_SPACING) + 1
    offset = np.arange(-reach, reach + 1)
    expected = [
        np.max(height[(at + offset) % SIZE] - (offset * HEIGHT_SPACING) ** 2 / 6e-3)
        for at in places
    ]
    np.testing.assert_allclose(
        envelope(height, tip_radius=3e-3)[places], expected, atol=1e-15
    )


def test_between_two_summits_the_tip_turns_at_a_cusp() -> None:
    """Leaving one asperity for another at a distance ``l``, the slope jumps by ``l /
    R``: geometry, nothing drawn."""
    height = np.full(SIZE, -1e-3)
    distance = 400
    height[[1000, 1000 + distance]] = 0.0
    slope = np.diff(envelope(height, tip_radius=1e-3)) / HEIGHT_SPACING
    between = slope[1000 : 1000 + distance]
    # The grid's own curvature adds one step to the jump.
    assert np.diff(between).max() == pytest.approx(
        distance * HEIGHT_SPACING / 1e-3, rel=0.02
    )
    assert (np.diff(between) > 0).sum() == 1
