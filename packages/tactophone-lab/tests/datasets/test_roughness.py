import math

import numpy as np
import pytest

from tactophone_lab.datasets.roughness import (
    COARSE_CUTOFF,
    CUTOFF,
    measure_heights,
    measure_profile,
    roughness_profile,
)

STEP = 1e-6
PLACE = np.arange(0, 12e-3, STEP)
AMPLITUDE = 4e-6
PERIOD = 0.1e-3


def test_a_sine() -> None:
    found = measure_profile(AMPLITUDE * np.sin(2 * math.pi * PLACE / PERIOD), step=STEP)
    assert found.ra == pytest.approx(2 * AMPLITUDE / math.pi, rel=1e-3)
    assert found.rq == pytest.approx(AMPLITUDE / math.sqrt(2), rel=1e-3)
    assert found.rz == pytest.approx(2 * AMPLITUDE, rel=1e-3)
    assert found.rsm == pytest.approx(PERIOD, rel=1e-3)


def test_a_square_wave() -> None:
    found = measure_profile(
        AMPLITUDE * np.sign(np.sin(2 * math.pi * (PLACE + STEP / 2) / PERIOD)),
        step=STEP,
    )
    assert found.ra == pytest.approx(AMPLITUDE, rel=0.02)
    assert found.rq == pytest.approx(AMPLITUDE, rel=0.02)
    assert found.rsm == pytest.approx(PERIOD, rel=1e-3)


def test_a_triangle() -> None:
    phase = (PLACE / PERIOD) % 1
    found = measure_profile(AMPLITUDE * (4 * np.abs(phase - 0.5) - 1), step=STEP)
    assert found.ra == pytest.approx(AMPLITUDE / 2, rel=2e-3)
    assert found.rq == pytest.approx(AMPLITUDE / math.sqrt(3), rel=2e-3)


def test_gaussian_heights() -> None:
    found = measure_profile(
        AMPLITUDE * np.random.default_rng(0).standard_normal(200_000), step=STEP
    )
    assert found.ra / found.rq == pytest.approx(math.sqrt(2 / math.pi), rel=0.01)


@pytest.mark.parametrize(
    ("period", "passes"), [(CUTOFF / 8, 1.0), (CUTOFF, 0.5), (CUTOFF * 8, 0.011)]
)
def test_the_filter_halves_a_wave_of_the_cutoff_length(
    period: float, passes: float
) -> None:
    place = np.arange(0, 40e-3, 10e-6)
    wave = np.cos(2 * math.pi * place / period)
    left = roughness_profile(wave, step=10e-6)
    middle = left[len(left) // 3 : -len(left) // 3]
    assert middle.max() == pytest.approx(passes, abs=0.01)


def test_waviness_and_tilt_do_not_count() -> None:
    sine = AMPLITUDE * np.sin(2 * math.pi * PLACE / PERIOD)
    tilted = sine + 0.001 * PLACE + 20e-6 * np.sin(2 * math.pi * PLACE / 10e-3)
    assert measure_profile(tilted, step=STEP).ra == pytest.approx(
        measure_profile(sine, step=STEP).ra, rel=0.06
    )


def test_too_short_a_profile_is_refused() -> None:
    with pytest.raises(ValueError, match="is too short"):
        measure_profile(PLACE[:1000], step=STEP)


@pytest.mark.parametrize("cutoff", [1e-300, 1.0, 1e6, 1e300])
def test_a_cutoff_longer_than_the_map_is_refused_before_any_filter(
    cutoff: float,
) -> None:
    with pytest.raises(ValueError, match="is too short for a cut-off"):
        measure_heights(PLACE[:3000], step=29e-6, cutoff=cutoff)


def sine(wavelength: float) -> np.ndarray:
    return np.sin(2 * np.pi * np.arange(100_000) * 1e-6 / wavelength)


def rq(heights: np.ndarray) -> float:
    return measure_profile(heights, step=1e-6, cutoff=COARSE_CUTOFF, periodic=True).rq


def test_a_periodic_sine_has_the_textbook_ra_and_rq() -> None:
    roughness = measure_profile(
        sine(1e-4), step=1e-6, cutoff=COARSE_CUTOFF, periodic=True
    )
    assert roughness.ra == pytest.approx(2 / np.pi, rel=1e-3)
    assert roughness.rq == pytest.approx(1 / np.sqrt(2), rel=1e-3)


def test_half_of_a_periodic_wave_at_the_cutoff_passes() -> None:
    assert rq(sine(COARSE_CUTOFF)) == pytest.approx(0.5 / np.sqrt(2), rel=1e-3)


def test_periodic_waviness_is_not_roughness() -> None:
    assert rq(sine(0.02)) < 0.02
