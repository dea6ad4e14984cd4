"""The printed parts: closed, thick enough to print, printable without support; and the
finger that they make."""

import hashlib
import importlib.util
import json
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from tactophone_lab.simulation.finger import TIPS

manifold3d = pytest.importorskip("manifold3d")

HARDWARE = Path(__file__).parents[2] / "hardware"
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])


def load(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, HARDWARE / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def faces(name: str) -> np.ndarray:
    return np.frombuffer((HARDWARE / "parts" / f"{name}.stl").read_bytes()[84:], FACET)[
        "corners"
    ].astype(np.float64)


def solid(name: str) -> manifold3d.Manifold:
    points, corners = np.unique(
        faces(name).reshape(-1, 3).round(5), axis=0, return_inverse=True
    )
    triangles = corners.reshape(-1, 3).astype(np.uint32)
    kept = (
        (triangles[:, 0] != triangles[:, 1])
        & (triangles[:, 1] != triangles[:, 2])
        & (triangles[:, 2] != triangles[:, 0])
    )
    return manifold3d.Manifold(
        manifold3d.Mesh(points.astype(np.float32), triangles[kept])
    )


dimensions, wiring = load("dimensions"), load("wiring")
KEPT = json.loads((HARDWARE / "parts" / "parts.json").read_text(encoding="utf-8"))
NAMES = list(KEPT["parts"])
FINGER, BOARD = dimensions.FingerDimensions(), dimensions.Board()
BallGuide, WeightYoke = dimensions.BallGuide, dimensions.WeightYoke


def in_the_finger(name: str) -> manifold3d.Manifold:
    """Return a part where it sits in the finger."""
    origin, *axes = dimensions.placed(name, np.vstack((np.zeros(3), np.eye(3))))
    return solid(name).transform(
        np.column_stack([*(axis - origin for axis in axes), origin])
    )


def assembled() -> np.ndarray:
    """Return the corners of all that is mounted, shape ``(points, 3)``."""
    names = ("pad", "ring", "phalanx", "stick_adapter")
    parts = [dimensions.placed(name, faces(name).reshape(-1, 3)) for name in names]
    return np.concatenate([*parts, BOARD.corners(FINGER)])


def clearance(points: np.ndarray, pitch: float, roll: float) -> float:
    """Return how far from the surface, in mm, the nearest point is that the ball's own
    is not; under 0 it touches."""
    down = dimensions.towards(pitch, roll)
    return float(FINGER.contact(pitch, roll) @ down - (points @ down).max())


def test_the_files_are_those_that_the_source_makes() -> None:
    assert load("source_hash").source_hash() == KEPT["source"], (
        "run python hardware/fingertip.py"
    )
    for name, part in KEPT["parts"].items():
        for kind in ("stl", "3mf", "step"):
            content = (HARDWARE / "parts" / f"{name}.{kind}").read_bytes()
            assert hashlib.sha256(content).hexdigest()[:16] == part[kind], (
                f"{name}.{kind}"
            )
    assert (HARDWARE.parent / "docs" / "images" / "wiring.svg").read_text(
        encoding="utf-8"
    ) == wiring.draw()


@pytest.mark.parametrize("name", NAMES)
def test_each_part_is_one_closed_solid_that_stands_on_the_bed_in_every_format(
    name: str,
) -> None:
    part, size = solid(name), KEPT["parts"][name]["size_mm"]
    assert part.status().name == "NoError"
    assert len(part.decompose()) == 1
    assert part.bounding_box()[2] == pytest.approx(0, abs=1e-3)
    assert np.subtract(
        part.bounding_box()[3:], part.bounding_box()[:3]
    ) == pytest.approx(size, abs=0.06)
    assert part.volume() * dimensions.PLASTIC == pytest.approx(
        KEPT["parts"][name]["solid_g"], abs=0.06
    )
    with zipfile.ZipFile(HARDWARE / "parts" / f"{name}.3mf") as package:
        assert b'unit="millimeter"' in package.read("3D/3dmodel.model")
    assert b"MANIFOLD_SOLID_BREP" in (HARDWARE / "parts" / f"{name}.step").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_no_wall_is_thinner_than_three_lines_of_a_nozzle(name: str) -> None:
    part = solid(name)
    rng = np.random.default_rng(0)
    triangles = faces(name)
    normals = np.cross(
        triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    )
    areas = np.linalg.norm(normals, axis=1)
    chosen = rng.choice(len(triangles), 1500, p=areas / areas.sum())
    points = np.einsum("ij,ijk->ik", rng.dirichlet((1, 1, 1), 1500), triangles[chosen])
    for point, inwards in zip(
        points, -normals[chosen] / areas[chosen, None], strict=True
    ):
        hit = part.ray_cast(tuple(point + 1e-3 * inwards), tuple(point + 60 * inwards))[
            0
        ]
        # Two faces that are far from parallel meet in an edge, not in a wall.
        if np.dot(hit.normal, inwards) > 0.7:
            assert (
                np.linalg.norm(np.array(hit.position) - point)
                > dimensions.LEAST_WALL - 1e-3
            ), point


@pytest.mark.parametrize("name", NAMES)
def test_no_face_overhangs_by_more_than_45_degrees(name: str) -> None:
    triangles = faces(name)
    normals = np.cross(
        triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    )
    areas = np.linalg.norm(normals, axis=1)
    hanging = (normals[:, 2] < -np.sin(np.radians(46)) * areas) & (
        triangles[:, :, 2].max(axis=1) > 0.01
    )
    assert areas[hanging].sum() / 2 < 0.5  # mm^2: the last lines under a roof's ridge


@pytest.mark.parametrize(
    ("name", "tip", "slope"), [("pad", "pad", 36.0), ("soft_pad", "rubber", 24.5)]
)
def test_each_pad_touches_with_a_ball_of_the_radius_that_is_simulated(
    name: str, tip: str, slope: float
) -> None:
    # A ball's support in a direction is its centre along it plus the radius.
    lean, turn = (
        np.radians(slope * np.arange(5) / 4)[:, None],
        np.radians(np.arange(0, 360, 15)),
    )
    away = np.stack(
        (
            np.sin(lean) * np.cos(turn),
            np.sin(lean) * np.sin(turn),
            np.cos(lean) + 0 * turn,
        ),
        axis=-1,
    )
    away = away.reshape(-1, 3)
    support = (faces(name).reshape(-1, 3) @ away.T).max(axis=0)
    *centre, radius = np.linalg.lstsq(
        np.column_stack((away, np.ones(len(away)))), support
    )[0]
    assert radius == pytest.approx(1e3 * TIPS[tip].finger.tip_radius, rel=0.02)
    assert away @ centre + radius == pytest.approx(support, abs=0.01)
    assert solid(name).hull().volume() == pytest.approx(solid(name).volume(), rel=1e-3)


@pytest.mark.parametrize("pitch", [0, 10, 20, 30, 45, 60])
def test_the_finger_touches_with_its_tip_under_the_disc(pitch: float) -> None:
    place = FINGER.contact(pitch)
    assert assembled()[:, 2].max() == pytest.approx(FINGER.tip, abs=0.05)
    assert 0 < FINGER.tip - place[2] < 6
    along = place - (place @ FINGER.axis) * FINGER.axis
    assert np.linalg.norm(along) < FINGER.disc / 2


@pytest.mark.parametrize("pitch", [0, 10, 20, 30, 45, 60])
@pytest.mark.parametrize("roll", [-20, -10, 0, 10, 20])
def test_only_the_ball_touches_with_all_parts_mounted(
    pitch: float, roll: float
) -> None:
    points, down = assembled(), dimensions.towards(pitch, roll)
    assert clearance(points, pitch, roll) > -0.01
    centre = (FINGER.height - FINGER.nose) * FINGER.axis
    others = points[np.linalg.norm(points - centre, axis=1) > FINGER.nose + 2]
    assert clearance(others, pitch, roll) > 0.05
    mounted = points[points @ FINGER.axis < -FINGER.ring]  # phalanx, board and adapter
    assert FINGER.contact(pitch, roll) @ down - (mounted @ down).max() > 2
    board = BOARD.corners(FINGER)
    assert FINGER.contact(pitch, roll) @ down - (board @ down).max() > 0.5


@pytest.mark.parametrize("pitch", [0, 30, 60])
def test_the_air_microphone_is_at_the_nails_side_within_2_cm_of_the_contact(
    pitch: float,
) -> None:
    port = BOARD.port_place(FINGER)
    assert port[1] > 0
    assert np.linalg.norm(port - FINGER.contact(pitch)) < 20


def test_the_board_lies_on_its_facet_and_touches_neither_ring_nor_pad() -> None:
    corners = BOARD.corners(FINGER)
    board = manifold3d.Manifold.hull_points(corners[:8] + 0.01 * BOARD.out)
    for name in ("pad", "ring", "phalanx"):
        assert (board ^ in_the_finger(name)).volume() == pytest.approx(0, abs=0.02)
    assert board.min_gap(in_the_finger("ring"), 5) > 1
    below = manifold3d.Manifold.hull_points(
        corners[:8] - 0.2 * BOARD.out
    ) ^ in_the_finger("phalanx")
    # It rests on at least 9 mm of its length.
    assert below.volume() > 0.2 * BOARD.width * 9


def test_the_disc_lies_flat_on_the_pad_inside_the_ring() -> None:
    disc = manifold3d.Manifold.cylinder(FINGER.disc_height, FINGER.disc / 2)
    ring = solid("ring").translate((0, 0, -FINGER.ring)).rotate((180, 0, 0))
    assert (disc ^ ring).volume() == pytest.approx(0, abs=1e-3)
    back = faces("pad")[np.abs(faces("pad")[:, :, 2]).max(axis=1) < 1e-6]
    # It is flat, and the bed's own face.
    assert np.abs(back[:, :, :2]).max() == pytest.approx(FINGER.width / 2, abs=0.01)
    with pytest.raises(ValueError, match="widen it"):
        dimensions.FingerDimensions(disc=15.0)


def test_silicone_lies_between_pad_and_phalanx_everywhere() -> None:
    phalanx = in_the_finger("phalanx")
    for name in ("pad", "ring"):
        part = in_the_finger(name)
        assert (part ^ phalanx).volume() == pytest.approx(0, abs=1e-3)
        assert part.min_gap(phalanx, 5.0) >= 0.9
    # It passes through the core, across, and through the ring's six holes.
    middle = -FINGER.core_hole * FINGER.axis
    assert not phalanx.ray_cast(
        *(tuple(middle + np.array([x, 0, 0])) for x in (-20, 20))
    )
    holes = solid("ring")
    for turn in np.radians(60 * np.arange(6)):
        outwards = np.array([np.cos(turn), np.sin(turn), 0])
        line = (outwards * r + np.array([0, 0, FINGER.hole_height]) for r in (5.0, 9.0))
        assert not holes.ray_cast(*map(tuple, line))


def test_the_jig_holds_the_pad_and_stops_the_phalanx_1_mm_before_the_ring() -> None:
    jig = in_the_finger("pouring_jig")
    for name in ("pad", "ring", "phalanx"):
        assert (jig ^ in_the_finger(name)).volume() == pytest.approx(0, abs=0.5)
    pressed = in_the_finger("phalanx").translate(tuple(0.3 * FINGER.axis))
    assert (jig ^ pressed).volume() > 1


def test_the_ball_guide_sits_on_the_phalanx_and_leads_to_the_nose() -> None:
    guide, held = in_the_finger("ball_guide"), BallGuide()
    board = manifold3d.Manifold.hull_points(BOARD.corners(FINGER))
    for name in ("pad", "ring"):
        assert guide.min_gap(in_the_finger(name), 10) > 2
    assert guide.min_gap(board, 10) > 2
    for name in ("phalanx", "stick_adapter"):
        assert (guide ^ in_the_finger(name)).volume() == pytest.approx(0, abs=0.01)
    # It lies on the nail, at the end and at one side.
    for push in ((0, -0.5, 0), (0, 0, 0.5), (0.5, 0, 0)):
        assert (guide.translate(push) ^ in_the_finger("phalanx")).volume() > 1
    # A ball of 8 mm falls through it onto the nose, and through nothing else.
    nose = FINGER.contact(FINGER.lean)
    ball = manifold3d.Manifold.sphere(4.0, 48)
    for height in np.linspace(4.0, held.drop + 2, 25):
        place = nose + height * FINGER.axis
        assert (ball.translate(tuple(place)) ^ guide).volume() < 1e-3
    beside = nose + 25 * FINGER.axis + 1.0 * FINGER.forward
    assert (ball.translate(tuple(beside)) ^ guide).volume() > 1e-3


def test_the_yoke_stands_on_the_nose_alone_with_its_weight_below() -> None:
    yoke = in_the_finger("weight_yoke")
    assert (yoke ^ in_the_finger("pad")).volume() < 0.05
    assert (
        yoke.translate(tuple(-0.2 * FINGER.axis)) ^ in_the_finger("pad")
    ).volume() > 0.05
    assert yoke.min_gap(in_the_finger("ring"), 10) > 2
    for name in ("phalanx", "stick_adapter"):
        assert yoke.min_gap(in_the_finger(name), 10) > 2
    # Seven washers of 24 mm on each peg hang under the nose, clear of the finger.
    held = WeightYoke()
    mass = KEPT["parts"]["weight_yoke"]["solid_g"] + 14 * 6.2
    assert mass == pytest.approx(100, abs=3)
    assert held.peg * np.sqrt(2) < 8.4
    assert held.peg_length > 7 * 2.0
    assert held.span + held.arm - FINGER.width / 2 > 8
    assert held.reach - held.peg / 2 > 30


@pytest.mark.parametrize("name", ["stick_adapter", "hand_adapter", "hand_plate"])
def test_the_pin_of_each_adapter_fits_the_bore_and_its_screw(name: str) -> None:
    adapter, phalanx = solid(name), in_the_finger("phalanx")
    shoulder = adapter.bounding_box()[5] - FINGER.pin_length
    inserted = adapter.translate(
        (0, dimensions.bore_height(FINGER), FINGER.end - shoulder - 0.01)
    )
    assert (inserted ^ phalanx).volume() == pytest.approx(0, abs=1e-2)
    screw = (
        (-20.0, dimensions.bore_height(FINGER), FINGER.end + 5),
        (20.0, dimensions.bore_height(FINGER), FINGER.end + 5),
    )
    assert not phalanx.ray_cast(*screw)
    assert not inserted.ray_cast(*screw)


def test_the_coil_fits_its_case_and_the_case_its_rib() -> None:
    case, saddle = dimensions.CoilCase(), solid("coil_case")
    coil = manifold3d.Manifold.cube((case.width, case.height, case.length), center=True)
    assert (
        coil.translate((0, 0, case.length / 2 + 1.7)) ^ saddle
    ).volume() == pytest.approx(0, abs=1e-3)
    rib = (
        solid("glove_plate")
        .trim_by_plane((0, 0, 1), dimensions.GLOVE.height + 0.01)
        .rotate((-90, 0, 0))
    )
    floor = -case.height / 2 - dimensions.FIT - dimensions.SHELL
    lying = rib.translate((0, floor - rib.bounding_box()[4], -rib.bounding_box()[2]))
    assert (lying ^ saddle).volume() == pytest.approx(0, abs=0.1)
    assert (lying.translate((0, 0.5, 0)) ^ saddle).volume() > 1


def test_the_bed_is_as_stiff_as_the_simulated_one_within_a_factor_of_three() -> None:
    silicone = 0.12e6  # Shore 00-30
    assert (
        1 / 3 < FINGER.bed_stiffness * silicone / TIPS["pad"].finger.pad_stiffness < 3
    )


def test_the_script_makes_the_same_solids_again() -> None:
    pytest.importorskip("build123d")
    sys.path.insert(0, str(HARDWARE))
    try:
        made = load("fingertip").parts()
    finally:
        sys.path.remove(str(HARDWARE))
    for name, part in made.items():
        assert part.volume * dimensions.PLASTIC == pytest.approx(
            KEPT["parts"][name]["solid_g"], abs=0.06
        )
