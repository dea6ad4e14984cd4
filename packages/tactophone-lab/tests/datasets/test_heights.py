"""Heights of analytic surfaces, where every parameter is known, and of measured
ones."""

import math
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import DatasetError
from tactophone_lab.datasets.roughness import (
    choose_cutoff,
    measure_heights,
    read_heights,
)

STEP = 10e-6
SIZE = 800
SURFACES = Path(__file__).parents[4] / "tests" / "data" / "surfaces"


def ridges(amplitude: float = 4e-6, period: float = 0.1037e-3) -> np.ndarray:
    """Return ridges along the columns: every row is the same sine."""
    return np.tile(
        amplitude * np.sin(2 * math.pi * np.arange(SIZE) * STEP / period), (SIZE, 1)
    )


def test_ridges_have_the_parameters_of_their_sine() -> None:
    report = measure_heights(ridges(), step=STEP)
    assert report.cutoff == 2.5e-3
    assert report.profile.ra == pytest.approx(2 * 4e-6 / math.pi, rel=0.01)
    assert report.profile.rdq == pytest.approx(
        4e-6 / math.sqrt(2) * 2 * math.pi / 0.1037e-3, rel=0.01
    )


def test_a_tilt_and_a_wave_longer_than_the_cutoff_do_not_count() -> None:
    rows, columns = np.indices((SIZE, SIZE)) * STEP
    bent = (
        ridges()
        + 0.01 * rows
        - 0.02 * columns
        + 20e-6 * np.sin(2 * math.pi * rows / 20e-3)
    )
    assert measure_heights(bent, step=STEP, cutoff=0.8e-3).profile.rq == pytest.approx(
        4e-6 / math.sqrt(2), rel=0.02
    )


def test_the_cutoff_is_the_one_that_the_standard_names_for_its_own_ra() -> None:
    place = np.arange(0, 40e-3, 1e-6)
    for amplitude, period, cutoff in (
        (1e-7, 20e-6, 0.25e-3),
        (1e-6, 50e-6, 0.8e-3),
        (8e-6, 0.2e-3, 2.5e-3),
    ):
        chosen, fits = choose_cutoff(
            amplitude * np.sin(2 * math.pi * place / period), step=1e-6
        )
        assert (chosen, fits) == (cutoff, True)


def test_short_and_coarse_measurements_are_doubted() -> None:
    coarse = measure_heights(ridges(20e-6, 0.1e-3)[:, :60], step=STEP, resolution=30e-6)
    assert any(
        "below the sensor's resolution of 30 um" in note for note in coarse.notes
    )
    assert any("too short for the standard's cut-off" in note for note in coarse.notes)
    assert any(
        "too coarse for the standard's noise filter" in note for note in coarse.notes
    )
    fine = measure_heights(ridges(20e-6, 2.5 * STEP), step=STEP)
    assert any("finer ones were not seen" in note for note in fine.notes)
    eight_bits = measure_heights(
        np.round(ridges(1e-6) / 5e-6) * 5e-6 + np.eye(SIZE) * 5e-6,
        step=STEP,
        cutoff=0.8e-3,
    )
    assert any("steps of 5 um" in note for note in eight_bits.notes)
    in_um = measure_heights(1e6 * ridges(20e-6), step=STEP, cutoff=0.8e-3)
    assert any("--unit" in note for note in in_um.notes)
    assert not any("--unit" in note for note in coarse.notes)


@pytest.mark.parametrize(
    ("name", "ra_um", "rsm_mm"),
    [("acrylic", 0.39, 1.3), ("poplar_wood", 1.4, 0.5), ("plywood", 3.6, 0.16)],
)
def test_measured_profiles_keep_the_order_of_their_materials(
    name: str, ra_um: float, rsm_mm: float
) -> None:
    heights, step = read_heights(SURFACES / f"{name}.npz")
    assert step == pytest.approx(1.394068e-6)
    found = measure_heights(heights, step=step or 0, cutoff=0.8e-3).profile
    assert found.ra * 1e6 == pytest.approx(ra_um, rel=0.25)
    assert found.rsm * 1e3 == pytest.approx(rsm_mm, rel=0.25)


def test_every_format_holds_the_same_heights(tmp_path: Path) -> None:
    profile = ridges()[0]
    np.save(tmp_path / "a.npy", profile * 1e6)
    np.savez(tmp_path / "b.npz", heights=profile * 1e6, step=STEP)
    for name, stated in (("a.npy", None), ("b.npz", STEP)):
        heights, step = read_heights(tmp_path / name, unit="um")
        np.testing.assert_allclose(heights, profile, atol=1e-12)
        assert step == (stated and pytest.approx(stated))


def test_the_grey_of_a_picture_is_height_in_the_unit_given(tmp_path: Path) -> None:
    image = pytest.importorskip("PIL.Image")
    grey = np.arange(60_000, dtype=np.uint16).reshape(200, 300)
    image.fromarray(grey).save(tmp_path / "map.png")
    heights, step = read_heights(tmp_path / "map.png", unit="nm")
    np.testing.assert_allclose(heights, grey * 1e-9)
    assert step is None
    image.new("RGB", (20, 20)).save(tmp_path / "colours.png")
    with pytest.raises(DatasetError, match="shades of grey"):
        read_heights(tmp_path / "colours.png")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.npy", "words\n", "cannot be read"),
        ("a.png", "words\n", "cannot be read"),
        ("a.csv", "0,1\n1,2\n", "only .npy"),
    ],
)
def test_what_holds_no_heights_is_refused(
    tmp_path: Path, name: str, content: str, message: str
) -> None:
    (tmp_path / name).write_text(content)
    with pytest.raises(DatasetError, match=message):
        read_heights(tmp_path / name)
    np.save(tmp_path / "gap.npy", np.array([0.0, np.nan]))
    with pytest.raises(DatasetError, match=r"50.00% of its heights are no numbers"):
        read_heights(tmp_path / "gap.npy")
