"""The fingertip's dimensions, and the drawings that are made by scripts."""

import importlib.util
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

ROOT = Path(__file__).parents[2]


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, ROOT / "hardware" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


fingertip, wiring = load("fingertip"), load("wiring")


def assert_closed(faces: np.ndarray) -> None:
    """Each edge belongs to two faces, which run along it in opposite directions."""
    rounded = [tuple(map(tuple, face.round(6))) for face in faces]
    edges = Counter((face[i], face[(i + 1) % 3]) for face in rounded for i in range(3))
    assert set(edges.values()) == {1}
    assert all(edges[end, begin] == 1 for begin, end in edges)


def test_the_part_is_closed_and_as_large_as_its_figures() -> None:
    part = fingertip.Fingertip()
    faces = fingertip.triangles(part)
    corners = faces.reshape(-1, 3)
    assert np.ptp(corners, axis=0) == pytest.approx([18.0, 18.0, 7.0], abs=1e-6)
    assert_closed(faces)
    cylinder, dome = np.pi * 9**2 * 3, 2 / 3 * np.pi * 9**2 * 4
    pocket = np.pi * 6.25**2 * 4
    assert fingertip.volume(faces) == pytest.approx(cylinder + dome - pocket, rel=0.01)


def test_the_disc_fits_and_lies_3_mm_under_the_surface() -> None:
    part = fingertip.Fingertip()
    assert part.layer == pytest.approx(3.0)
    assert part.pocket_radius * 2 == pytest.approx(12.5)
    with pytest.raises(ValueError, match="wider pad"):
        fingertip.triangles(replace(part, disc_diameter=20.0))
    with pytest.raises(ValueError, match="higher side"):
        fingertip.triangles(replace(part, side=0.1, dome=3.0))


def test_the_bracket_holds_the_microphone_2_cm_beside_the_pad() -> None:
    bracket, pad = fingertip.Bracket(), fingertip.Fingertip()
    ring, microphone, arm = bracket.shells()
    for shell in (ring, microphone, arm):
        assert_closed(shell)
        assert fingertip.volume(shell) > 0
    assert microphone[..., :2].mean(axis=(0, 1)) == pytest.approx([20.0, 0.0], abs=1e-6)
    assert np.linalg.norm(ring[..., :2], axis=-1).min() == pytest.approx(pad.radius + 0.2)
    assert np.ptp(ring[..., 2]) <= pad.side
    # The arm reaches into both walls and into neither opening.
    assert pad.radius + 0.2 < arm[..., 0].min() < pad.radius + 0.2 + bracket.wall
    assert 20.0 - 4.0 - bracket.wall < arm[..., 0].max() < 20.0 - 4.0
    with pytest.raises(ValueError, match="longer distance"):
        fingertip.Bracket(distance=15.0).shells()


def test_the_files_in_the_repository_are_those_that_the_scripts_make(tmp_path: Path) -> None:
    fingertip.write_stl(tmp_path / "a.stl", fingertip.triangles(fingertip.Fingertip()))
    made, kept = (tmp_path / "a.stl").read_bytes(), (ROOT / "hardware" / "fingertip.stl").read_bytes()
    assert len(made) == len(kept)
    fingertip.write_stl(tmp_path / "b.stl", np.concatenate(fingertip.Bracket().shells()))
    assert len((tmp_path / "b.stl").read_bytes()) == (ROOT / "hardware" / "microphone_bracket.stl").stat().st_size
    assert (ROOT / "docs" / "images" / "wiring.svg").read_text(encoding="utf-8") == wiring.draw()
