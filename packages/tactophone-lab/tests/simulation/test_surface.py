import numpy as np
import pytest

from tactophone_lab.simulation.surface import (
    HEIGHT_SPACING,
    SIZE,
    Grains,
    Pits,
    Ridges,
    Surface,
    height_profile,
    self_affine,
)


def plain(**features: object) -> Surface:
    return Surface("test", seed=5, rms_height=1e-6, rolloff=1e-3, **features)  # type: ignore[arg-type]


def test_a_profile_repeats_and_has_its_rms() -> None:
    profile = height_profile(plain())
    np.testing.assert_array_equal(profile, height_profile(plain()))
    assert profile.std() == pytest.approx(1e-6)
    assert profile.mean() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("hurst", [0.3, 0.8])
def test_the_spectrum_falls_with_the_hurst_exponent(hurst: float) -> None:
    profile = self_affine(1.0, 1e-3, hurst=hurst, rng=np.random.default_rng(0))
    power = np.abs(np.fft.rfft(profile)) ** 2
    wavenumber = np.fft.rfftfreq(SIZE, HEIGHT_SPACING)
    # Well over the roll-off at 1/mm: the slope between 5 and 40 per mm is -(2H + 1).
    low, high = (
        power[(wavenumber > at) & (wavenumber < 1.3 * at)].mean() for at in (5e3, 30e3)
    )
    assert np.log(high / low) / np.log(6) == pytest.approx(-(2 * hurst + 1), abs=0.15)


def test_grains_stand_out_and_pits_go_in() -> None:
    grains = height_profile(plain(grains=Grains(spacing=1e-3, height=50e-6)))
    pits = height_profile(plain(pits=Pits(spacing=2e-3, depth=50e-6)))
    assert np.mean(pits**3) < 0 < grains.max() - 40e-6


def test_ridges_repeat_at_their_period() -> None:
    profile = height_profile(plain(ridges=Ridges(period=2e-3, height=100e-6)))
    peak = np.argmax(np.abs(np.fft.rfft(profile)))
    assert SIZE * HEIGHT_SPACING / peak == pytest.approx(2e-3, rel=0.01)
