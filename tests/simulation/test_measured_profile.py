import importlib.metadata
from pathlib import Path

import numpy as np
import pytest

import tactophone.simulation.surface as module
from tactophone.errors import ConfigError
from tactophone.simulation.catalogue import measured_objects
from tactophone.simulation.render import RenderOptions, plan_dataset, render
from tactophone.simulation.surface import FILES, SIZE, SPACING, STEP, measured_profile
from tactophone.simulation.takes import TAKES


@pytest.fixture
def scans(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    """Two joined scans of a tilted wave; the second is the longer."""
    place = np.arange(120_000) * STEP
    height = 2e-6 * np.sin(2 * np.pi * place / 1e-3) + 1e-4 * place
    height[20_000:] += 50e-6
    np.save(tmp_path / "acrylic.npy", height)
    monkeypatch.setattr(module, "_path", lambda stem: tmp_path / f"{stem}.npy")
    return height


def test_a_measured_profile_has_the_measured_heights(scans: np.ndarray) -> None:
    height = measured_profile("acrylic", step=SPACING, size=SIZE)
    assert len(height) == SIZE
    assert height.std() == pytest.approx(2e-6 / np.sqrt(2), rel=0.02)
    power = np.abs(np.fft.rfft(height)) ** 2
    assert SIZE * SPACING / np.argmax(power) == pytest.approx(1e-3, rel=0.02)


def test_it_has_no_joint_and_no_jump_at_the_seam(scans: np.ndarray) -> None:
    height = measured_profile("acrylic", step=SPACING, size=SIZE)
    steepest = 2e-6 * 2 * np.pi / 1e-3 * SPACING
    assert np.abs(np.diff(np.append(height, height[0]))).max() < 1.05 * steepest


def test_without_the_package_its_installation_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> None:
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "files", absent)
    with pytest.raises(ConfigError, match="pip install --no-deps 'tdw"):
        measured_profile("acrylic", step=SPACING, size=SIZE)


def test_the_packages_profiles_have_their_known_roughness() -> None:
    try:
        importlib.metadata.version("tdw")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("tdw is not installed")
    ra_um = {obj.substance: obj.roughness.ra * 1e6 for obj in measured_objects()}
    assert set(ra_um) == set(FILES)
    fine = {name for name, ra in ra_um.items() if ra < 1.0}
    assert fine == {"acrylic", "polycarbonate", "polyethylene"}
    assert max(ra_um.values()) < 10.0


def test_a_measured_surface_is_touched_without_a_label() -> None:
    try:
        importlib.metadata.version("tdw")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("tdw is not installed")
    (job,) = plan_dataset(measured_objects()[3:4], RenderOptions(duration=1.0), takes=TAKES[1:2])
    samples, truth = render(job)
    assert (truth.object_index == 0).any()
    assert not truth.touch.any()
    assert samples.std() > 1e-3
