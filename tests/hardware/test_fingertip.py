"""The printed parts: closed, of the stated size, thick enough to print, and printable without support."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tactophone.lab.simulation.finger import TIPS

pytest.importorskip("manifold3d")

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
PARTS = fingertip.parts()
RIGID = [name for name in PARTS if name != "soft_pad"]


@pytest.mark.parametrize("name", PARTS)
def test_each_part_is_one_closed_solid_that_stands_on_the_bed(name: str) -> None:
    part = PARTS[name]
    assert part.status().name == "NoError"
    assert len(part.decompose()) == 1
    assert part.bounding_box()[2] == pytest.approx(0, abs=1e-6)
    edges = np.sort(np.asarray(part.to_mesh().tri_verts)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}


@pytest.mark.parametrize("name", RIGID)
def test_no_wall_is_thinner_than_three_lines_of_a_nozzle(name: str) -> None:
    part, rng = PARTS[name], np.random.default_rng(0)
    faces = fingertip.triangles(part)
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(faces), 1500, p=areas / areas.sum())
    weights = rng.dirichlet((1, 1, 1), 1500)
    points = np.einsum("ij,ijk->ik", weights, faces[chosen])
    for point, inwards in zip(points, -normals[chosen] / areas[chosen, None], strict=True):
        hit = part.ray_cast(tuple(point + 1e-3 * inwards), tuple(point + 60 * inwards))[0]
        # Two faces that are far from parallel meet in an edge, not in a wall.
        if np.dot(hit.normal, inwards) > 0.7:
            assert np.linalg.norm(np.array(hit.position) - point) > fingertip.LEAST_WALL


@pytest.mark.parametrize("name", RIGID)
def test_no_face_overhangs_by_more_than_45_degrees(name: str) -> None:
    faces = fingertip.triangles(PARTS[name])
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    hanging = (normals[:, 2] < -np.sin(np.radians(46)) * areas) & (faces[:, :, 2].max(axis=1) > 0.01)
    assert areas[hanging].sum() / 2 < 0.5  # mm^2: the last lines under a roof's ridge


def test_the_pad_has_the_size_of_a_finger_and_a_seat_for_the_disc() -> None:
    finger = fingertip.Finger()
    low, high = np.split(np.array(finger.pad().bounding_box()), 2)
    assert high - low == pytest.approx([18.0, 10.6, 32.0], abs=0.1)
    disc = fingertip.Manifold.cylinder(0.5, finger.disc / 2).rotate((-90, 0, 0))
    disc = disc.translate((0, finger.seat + 0.01, finger.disc_centre))
    assert (disc ^ finger.pad()).volume() < 0.1
    with pytest.raises(ValueError, match="widen the pad"):
        fingertip.Finger(disc=20.0)
    with pytest.raises(ValueError, match="lengthen it"):
        fingertip.Finger(length=25.0)


@pytest.mark.parametrize(("name", "tip"), [("pad", "pad"), ("soft_pad", "rubber")])
def test_each_pad_is_convex_and_touches_with_a_ball_of_the_radius_that_is_simulated(name: str, tip: str) -> None:
    part = PARTS[name] if name == "pad" else PARTS[name].rotate((90, 0, 0))
    # Up to 11 degrees from flat on all sides. A ball's support in a direction is its centre along it plus the radius.
    lean, turn = np.radians(11 * np.arange(1, 5) / 4)[:, None], np.radians(np.arange(0, 360, 15))
    away = np.stack((np.sin(lean) * np.cos(turn), -np.cos(lean) + 0 * turn, np.sin(lean) * np.sin(turn)), axis=-1)
    away = away.reshape(-1, 3)
    support = (fingertip.triangles(part).reshape(-1, 3) @ away.T).max(axis=0)
    *centre, radius = np.linalg.lstsq(np.column_stack((away, np.ones(len(away)))), support)[0]
    assert radius == pytest.approx(1e3 * TIPS[tip].finger.tip_radius, rel=0.02)
    assert away @ centre + radius == pytest.approx(support, abs=0.005)
    assert centre[0] == pytest.approx(0, abs=0.02)
    outside = fingertip.Finger().outside()
    assert outside.hull().volume() == pytest.approx(outside.volume(), rel=1e-6)


def test_silicone_lies_between_pad_and_phalanx_everywhere() -> None:
    finger = fingertip.Finger()
    pad, phalanx = finger.pad(), finger.phalanx()
    assert (pad ^ phalanx).volume() == pytest.approx(0, abs=1e-6)
    assert pad.min_gap(phalanx, 5.0) >= 0.8  # mm; the bed is 1.5 thick, the joint of pad and shoulder 1
    # It passes through the six holes in the pad and the three in the phalanx.
    for z in finger.hole_heights:
        line = (-20.0, finger.hole_height, z), (20.0, finger.hole_height, z)
        assert not pad.ray_cast(*line)
        assert not phalanx.ray_cast(*line)


def test_the_bracket_holds_the_microphone_2_cm_beside_the_finger_and_off_the_surface() -> None:
    finger, bracket = fingertip.Finger(), fingertip.Bracket()
    solid = bracket.solid(finger)
    assert bracket.distance == 20.0
    assert (solid ^ finger.phalanx()).volume() == pytest.approx(0, abs=1e-3)
    assert solid.min_gap(finger.pad(), 10.0) > 0.5
    surface = finger.pad().bounding_box()[1]
    assert solid.bounding_box()[1] - surface >= 2.5


def test_the_pin_of_each_adapter_fits_the_socket_and_its_screw() -> None:
    finger = fingertip.Finger()
    for adapter in (fingertip.adapter_to_stick(finger), fingertip.adapter_to_hand(finger)):
        length = adapter.bounding_box()[5]
        inserted = adapter.translate((0, finger.socket_height, -length - 4.05))
        assert (inserted ^ finger.phalanx()).volume() == pytest.approx(0, abs=1e-3)


def test_the_coil_fits_its_case() -> None:
    case = fingertip.CoilCase()
    coil = fingertip.Manifold.cube((case.width, case.height, case.length), center=True)
    assert (coil.translate((0, 0, case.length / 2 + 1.7)) ^ case.case()).volume() == pytest.approx(0, abs=1e-3)


def test_the_files_in_the_repository_are_those_that_the_scripts_make(tmp_path: Path) -> None:
    for name, part in PARTS.items():
        kept = np.frombuffer((ROOT / "hardware" / f"{name}.stl").read_bytes()[84:], fingertip.FACET)
        low, high = kept["corners"].min(axis=(0, 1)), kept["corners"].max(axis=(0, 1))
        assert np.concatenate([low, high]) == pytest.approx(part.bounding_box(), abs=1e-3)
        assert len(kept) == pytest.approx(part.num_tri(), rel=0.02)
    assert (ROOT / "docs" / "images" / "wiring.svg").read_text(encoding="utf-8") == wiring.draw()
