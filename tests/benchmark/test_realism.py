from pathlib import Path

import numpy as np
import pytest
from benchmarks.realism import centres, draw_realism, measure_traits, summary

RATE = 16_000


def noise(seconds: float = 4.0) -> np.ndarray:
    return np.random.default_rng(0).standard_normal(int(seconds * RATE))


def test_white_noise_is_flat_steady_and_normal() -> None:
    traits = measure_traits(noise(), RATE)
    assert traits.slope_db == pytest.approx(0, abs=0.5)
    assert traits.modulation_db < 1.5
    assert traits.crest_db == pytest.approx(9.5, abs=1.0)
    assert np.diff(traits.spectrum_db[6:]) == pytest.approx(1.0, abs=0.7)  # a third octave wider each, by power


def test_strokes_show_as_modulation() -> None:
    strokes = 1 + 0.9 * np.sin(2 * np.pi * 1.5 * np.arange(4 * RATE) / RATE)
    assert measure_traits(noise() * strokes, RATE).modulation_db > 4


def test_clicks_show_as_crest() -> None:
    clicks = noise() * 0.1
    clicks[::200] += 3
    assert measure_traits(clicks, RATE).crest_db > 14


def test_a_picture_is_drawn(tmp_path: Path) -> None:
    traits = [measure_traits(noise(1.0), RATE)]
    draw_realism(tmp_path / "page.png", {"real": {"smooth": traits, "rough": traits}})
    assert (tmp_path / "page.png").stat().st_size > 20_000
    assert summary(traits)["level spread"] > 0
    assert centres()[0] > 60
