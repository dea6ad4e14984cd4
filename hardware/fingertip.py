"""Makes the parts of both fingertips, as STL, 3MF and STEP: the robot's, after the
paper's section IV-A, and the operator's.

    pip install -r hardware/requirements.txt
    python hardware/fingertip.py [FOLDER]

Every dimension is in ``dimensions.py``. A part is drawn as it is printed, z up from the
bed; nothing needs support. ``parts.json`` keeps each part's size and mass, and hashes,
by which a test sees a file that is older than its source.
"""

import argparse
import hashlib
import json
import sys
from pathlib import Path

import numpy as np
from build123d import (
    Align,
    Axis,
    Box,
    Compound,
    Cone,
    Cylinder,
    Location,
    Mesher,
    Part,
    Plane,
    Polygon,
    Polyline,
    Pos,
    RadiusArc,
    Rot,
    export_step,
    export_stl,
    extrude,
    make_face,
    revolve,
)
from dimensions import (
    FIT,
    GLOVE,
    HAND,
    PLASTIC,
    SHELL,
    STICK,
    BallGuide,
    Board,
    CoilCase,
    FingerDimensions,
    Plate,
    WeightYoke,
    bore_height,
    cap_height,
    guide_side,
    stick_length,
    underside,
)
from source_hash import source_hash

STANDING = (Align.CENTER, Align.CENTER, Align.MIN)

FINE = 0.005, 0.1
"""Tolerance of meshes in mm and radians."""


def cap(radius: float, nose: float, slope: float, land: float) -> Part:
    """Return a pad: flat back on the bed, the ball that touches on top."""
    turn, height = np.radians(slope), cap_height(radius, nose, slope, land)
    touch = nose * float(np.sin(turn)), height - nose * (1 - float(np.cos(turn)))
    flank = Polyline((0, height), (0, 0), (radius, 0), (radius, land), touch)
    outline = make_face(flank + RadiusArc(touch, (0, height), -nose))
    return revolve(Plane.XZ * outline, Axis.Z)


def pad(finger: FingerDimensions) -> Part:
    """Return the pad that touches; its flat back carries the piezo disc."""
    return cap(finger.width / 2, finger.nose, finger.slope, finger.land)


def ring(finger: FingerDimensions) -> Part:
    """Return the ring that is glued to the pad's back, that side up, with six holes and
    a notch for the leads."""
    part = Cylinder(finger.width / 2, finger.ring, align=STANDING) - Cylinder(
        finger.inner, finger.ring, align=STANDING
    )
    for turn in range(6):
        part -= (
            Rot(Z=60 * turn)
            * Pos(8, 0, finger.hole_height)
            * across(finger.hole / 2, 12)
        )
    return part - Pos(0, -finger.width / 2, finger.ring) * Box(3, 6, 5)


def phalanx(finger: FingerDimensions, board: Board) -> Part:
    """Return the phalanx, nail down: its core reaches into the ring, its facet takes
    the microphone's board."""
    facet, low, half = board.facet(finger), underside(finger), finger.width / 2
    # Where the face towards the ring meets the facet, and the facet the nail.
    (_, ay, az), (_, by, bz) = finger.axis, board.out
    top = np.linalg.solve([[ay, az], [by, bz]], [-finger.flange, facet])
    behind = -finger.flange * finger.axis - half * finger.forward
    profile = [
        (behind[1], behind[2]),
        (low, finger.end),
        (finger.nail, finger.end),
        (finger.nail, facet * np.sqrt(2) - finger.nail),
        tuple(top),
    ]
    # Drawn in the finger's y and z, extruded across.
    side = Plane(origin=(0, 0, 0), x_dir=(0, 1, 0), z_dir=(1, 0, 0))
    body = extrude(
        side * make_face(Polyline(*map(_numbers, profile), close=True)), half, both=True
    )
    body &= _rounded(finger, low)
    toward = Plane(origin=(0, 0, 0), x_dir=(1, 0, 0), z_dir=_numbers(finger.axis))
    reach = finger.flange - finger.disc_height - finger.bed
    body += (
        toward
        * Pos(0, 0, -finger.flange - 3)
        * Cylinder(finger.core, reach + 3, align=STANDING)
    )
    middle = -finger.core_hole * finger.axis
    body -= Pos(*_numbers(middle)) * _roofed(finger.hole / 2, 60)
    height = bore_height(finger)
    bore = Pos(0, 0, finger.end) * _bore(finger.pin / 2 + FIT, finger.pin_length)
    body -= Pos(0, height, 0) * bore
    body -= Pos(0, height, finger.end + 5) * _roofed(1.6, 60)
    for edge in (
        -half,
        half,
    ):  # a tie around these holds the cable, so that a pull does not reach the disc
        body -= Pos(edge, height, -18) * Box(3, 60, 4)
    body -= Pos(0, low, finger.end / 2 - 8) * Box(
        4, 2, -finger.end
    )  # the leads' channel
    return Location((0, -finger.end, finger.nail), (-90, 0, 0)) * body


def _rounded(finger: FingerDimensions, low: float) -> Part:
    """Return a bar along the finger with bevelled edges: 3 mm on the side that touches,
    1.5 mm at the nail."""
    half, nail = finger.width / 2, finger.nail
    corners = [(half, low + 3), (half, nail - 1.5), (half - 1.5, nail), (half - 3, low)]
    section = [corners[3], corners[0], corners[1], corners[2]]
    section += [(-x, y) for x, y in reversed(section)]
    return Pos(0, 0, -100) * extrude(make_face(Polyline(*section, close=True)), 200)


def _numbers(values: object) -> tuple[float, ...]:
    return tuple(float(value) for value in np.asarray(values))


def _teardrop(radius: float) -> Part:
    """Return a circle with a roof of 45 degrees towards +y."""
    edge = radius / np.sqrt(2)
    from build123d import Circle

    return Circle(radius) + Polygon(
        (edge, edge), (0, 2 * edge), (-edge, edge), align=None
    )


def across(radius: float, length: float) -> Part:
    """Return a hole along x with its roof towards +z."""
    plane = Plane(origin=(0, 0, 0), x_dir=(0, 1, 0), z_dir=(1, 0, 0))
    return extrude(plane * _teardrop(radius), length / 2, both=True)


def _roofed(radius: float, length: float) -> Part:
    """Return a hole along x with its roof towards -y, for the phalanx, which is printed
    nail down."""
    return Rot(X=90) * across(radius, length)


def _bore(radius: float, depth: float) -> Part:
    """Return a bore along z with its roof towards -y, that ends in a cone."""
    return Rot(Z=180) * extrude(_teardrop(radius), depth) + Pos(0, 0, depth) * Cone(
        radius, 0, radius, align=STANDING
    )


def pouring_jig(finger: FingerDimensions) -> Part:
    """Return a block that holds pad, ring and phalanx in line while the silicone sets;
    its walls stop the phalanx."""
    half, deep = finger.width / 2, finger.height + 3.5 + finger.flange
    top = Pos(0, 1, 0) * Box(2 * half + 8, 2 * half + 10, deep, align=STANDING)
    floor = 3.5
    turn = np.radians(finger.slope)
    straight = floor + finger.height - finger.land - FIT
    seat = [
        (0, floor - 1),
        (1.5, floor - 1),
        (1.5, straight - (half + FIT - 1.5) * np.tan(turn)),
        (half + FIT, straight),
        (half + FIT, deep + 1),
        (0, deep + 1),
    ]
    block = top - revolve(Plane.XZ * make_face(Polyline(*seat, close=True)), Axis.Z)
    for edge in (-1, 1):
        block += Pos(edge * (half + 0.15 + 1.2), 0, deep) * Box(
            2.4, 2 * half, 5, align=STANDING
        )
    return block


def _pin(finger: FingerDimensions) -> Part:
    return Cylinder(finger.pin / 2, finger.pin_length, align=STANDING) - Pos(
        0, 0, 5
    ) * across(1.6, 40)


def stick_adapter(finger: FingerDimensions) -> Part:
    """Return a sleeve on a round stick with the phalanx' pin on top, for trials by
    hand."""
    outer, height = STICK / 2 + 2.4, stick_length(finger)
    sleeve = Cylinder(outer, 20, align=STANDING)
    sleeve += Pos(0, 0, 20) * Cone(outer, finger.pin / 2, height - 20, align=STANDING)
    hollow = Cylinder(STICK / 2 + FIT, 18, align=STANDING)
    hollow += Pos(0, 0, 18) * Cone(STICK / 2 + FIT, 0, STICK / 2 + FIT, align=STANDING)
    part = sleeve + Pos(0, 0, height - 0.5) * Cylinder(
        finger.pin / 2, 1, align=STANDING
    )
    return (
        part
        + Pos(0, 0, height) * _pin(finger)
        - hollow
        - Pos(0, 0, 8) * across(1.6, 40)
    )


def hand_adapter(finger: FingerDimensions) -> Part:
    """Return a flange with the phalanx' pin, for a servo's horn: measure the bolt
    circle of yours."""
    circle, hole, flange = HAND
    part = Cylinder(flange / 2, 3, align=STANDING) + Pos(0, 0, 3) * _pin(finger)
    for turn in range(4):
        part -= Rot(Z=90 * turn + 45) * Pos(circle / 2, 0, 0) * Cylinder(hole / 2, 10)
    return part


def blank_plate(plate: Plate) -> Part:
    """Return a plate with its holes."""
    part = Box(plate.width, plate.length, plate.height, align=STANDING)
    for x in (-1, 1):
        for y in (-1, 1):
            part -= Pos(x * plate.across / 2, y * plate.along / 2, 0) * Cylinder(
                plate.hole / 2, 20
            )
    return part


def hand_plate(finger: FingerDimensions) -> Part:
    """Return the blank plate with the phalanx' pin, for a hand such as Schunk's SIH."""
    return blank_plate(Plate()) + Pos(0, 0, Plate().height) * _pin(finger)


def glove_plate(case: CoilCase) -> Part:
    """Return the blank plate with a rib, on which the case sits as on a finger; for an
    exoskeleton's fingertip."""
    rib = Rot(X=90) * Cylinder(case.saddle - FIT, case.length) & Box(12, 60, 60)
    over = Pos(0, 0, GLOVE.height) * Box(60, 60, 30, align=STANDING)
    return blank_plate(GLOVE) + (
        (Pos(0, 0, GLOVE.height + 3 - case.saddle + FIT) * rib) & over
    )


def coil_case(case: CoilCase) -> Part:
    """Return the case; the coil slides in from above, the saddle fits the finger below
    (-y)."""
    wide, high, long = (
        case.width + 2 * FIT,
        case.height + 2 * FIT,
        case.length + FIT + SHELL,
    )
    floor = -high / 2 - SHELL
    body = Box(wide + 2 * SHELL, high + 2 * SHELL, long, align=STANDING)
    body += Pos(0, floor + 0.5, 0) * Box(wide + 2 * SHELL, 5, long, align=STANDING)
    body += Pos(0, floor + 1.2, 0) * Box(
        wide + 2 * SHELL + 12, 2.4, long, align=STANDING
    )
    body -= Pos(0, floor - case.saddle + 0.3, -1) * Cylinder(
        case.saddle, long + 2, align=STANDING
    )
    body -= Pos(0, 0, SHELL) * Box(wide, high, long, align=STANDING)
    slot = [
        (-1.1, -case.strap / 2),
        (1.1, -case.strap / 2),
        (1.1, case.strap / 2),
        (0, case.strap / 2 + 1.2),
        (-1.1, case.strap / 2),
    ]
    for edge in (-1, 1):
        through = extrude(
            Plane.XZ * make_face(Polyline(*slot, close=True)), 20, both=True
        )
        body -= Pos(edge * (wide / 2 + SHELL + 2.6), floor, long / 2) * through
    return body - Pos(0, 5, long) * Box(3, 10, 8)  # the leads leave beside the lid


def coil_case_lid(case: CoilCase) -> Part:
    """Return the lid, a plug that is pressed or glued in."""
    more = 2 * (SHELL + FIT)
    lid = Box(case.width + more, case.height + more, SHELL, align=STANDING)
    lid += Box(case.width, case.height, 3, align=STANDING)
    return lid - Pos(0, 5, SHELL) * Box(3, 10, 20, align=STANDING)


def ball_guide(finger: FingerDimensions, guide: BallGuide) -> Part:
    """Return the frame that holds a tube over the nose, on its side: a wall behind the
    phalanx, a plate on its nail, one cheek, and an arm around the board to the tube."""
    side, nail, end = guide_side(finger), finger.nail + FIT, finger.end - FIT
    outer = guide.bore / 2 + guide.wall
    high = outer - side
    plane = Plane(origin=(side, 0, 0), x_dir=(0, 1, 0), z_dir=(1, 0, 0))

    def slab(corners: list[tuple[float, float]], thick: float) -> Part:
        return extrude(plane * make_face(Polyline(*corners, close=True)), thick)

    stop, front = end - guide.stop, finger.end + guide.nail
    over = nail + guide.stop
    # Its slope leaves room for the cone of the stick's adapter.
    wall = [
        (nail - 1.0, stop),
        (over, stop),
        (over, end),
        (nail - 2.2, end),
        (nail - 2.2, end - 1.2),
    ]
    plate = [(nail, stop), (over, stop), (over, front), (nail, front)]
    cheek = [(9.0, finger.end), (over, finger.end), (over, front), (9.0, front)]
    arm = [
        (nail, front - 8),
        (nail, front),
        (31.0, front),
        (31.0, 9.0),
        (21.0, 15.0),
        (-22.0, 15.0),
        (-22.0, 21.0),
        (23.0, 21.0),
        (37.0, 12.0),
        (37.0, front - 8),
    ]
    body = slab(wall, high) + slab(plate, high) + slab(cheek, guide.cheek)
    body += slab(arm, high)
    low, top = finger.height + guide.lowest, finger.height + guide.drop
    axis, forward = _numbers(finger.axis[1:]), _numbers(finger.forward[1:])
    tube = [
        tuple(along * a + beside * f for a, f in zip(axis, forward, strict=True))
        for along, beside in ((low, -outer), (top, -outer), (top, outer), (low, outer))
    ]
    body += slab(tube, high + outer)
    through = Plane(
        origin=_numbers((low - 1) * finger.axis),
        x_dir=(0, *forward),
        z_dir=_numbers(finger.axis),
    )
    # Its roof points along +x, which is up on the printer's bed.
    roofed = Rot(Z=_roof_turn(through)) * extrude(
        _teardrop(guide.bore / 2), top - low + 2
    )
    body -= through * roofed
    return Rot(Y=-90) * Pos(-side, 0, 0) * body


def _roof_turn(plane: Plane) -> float:
    """Return by how many degrees a teardrop in this plane is turned, so that its roof
    points along the finger's x."""
    up = np.array([plane.x_dir.X, plane.y_dir.X])
    return float(np.degrees(np.arctan2(up[1], up[0]))) - 90


def weight_yoke(yoke: WeightYoke) -> Part:
    """Return the yoke that stands on the nose, lying flat: y of the drawing points down
    beside the finger, from the nose."""
    slope = np.radians(yoke.dimple)
    # The cone touches the ball where their surfaces are parallel.
    nose = FingerDimensions().nose
    apex = -nose * (1 / float(np.sin(slope)) - 1)
    rim = 0.8
    half, foot = yoke.span + yoke.arm, yoke.reach
    right = [
        (half, -yoke.beam),
        (half, foot),
        (yoke.span, foot),
        (yoke.span, rim),
    ]
    left = [(-x, y) for x, y in reversed(right)]
    body = extrude(make_face(Polyline(*right, *left, close=True)), yoke.depth)
    for edge in (-1, 1):
        body += Pos(edge * (half + yoke.peg_length / 2), foot - yoke.peg / 2, 0) * Box(
            yoke.peg_length, yoke.peg, yoke.peg, align=STANDING
        )
    deep = rim - apex + 0.01
    cone = Cone(0, deep * float(np.tan(slope)), deep, align=STANDING)
    dimple = Pos(0, apex, yoke.depth / 2) * Rot(X=-90) * cone
    return body - dimple


def soft_pad(finger: FingerDimensions) -> Part:
    """Return the second recipe's pad, for flexible filament: it touches with the radius
    of the tip ``rubber``."""
    return cap(finger.width / 2, 6.0, 25.0, finger.land)


def parts() -> dict[str, Part]:
    """Return every part by its file's name, as it lies on the printer's bed."""
    finger, case = FingerDimensions(), CoilCase()
    return {
        "pad": pad(finger),
        "ring": ring(finger),
        "phalanx": phalanx(finger, Board()),
        "pouring_jig": pouring_jig(finger),
        "stick_adapter": stick_adapter(finger),
        "hand_adapter": hand_adapter(finger),
        "hand_plate": hand_plate(finger),
        "coil_case": coil_case(case),
        "coil_case_lid": coil_case_lid(case),
        "glove_plate": glove_plate(case),
        "soft_pad": soft_pad(finger),
        "ball_guide": ball_guide(finger, BallGuide()),
        "weight_yoke": weight_yoke(WeightYoke()),
    }


def assembly(made: dict[str, Part]) -> Compound:
    """Return the robot's finger, put together."""
    from dimensions import placed

    shapes = []
    for name in ("pad", "ring", "phalanx", "stick_adapter"):
        origin, *axes = placed(name, np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, 1]]))
        plane = Plane(
            _numbers(origin),
            x_dir=_numbers(axes[0] - origin),
            z_dir=_numbers(axes[1] - origin),
        )
        shape = Location(plane) * made[name]
        shape.label = name
        shapes.append(shape)
    return Compound(label="fingertip", children=shapes)


def main() -> None:
    parser = argparse.ArgumentParser(
        description="make the parts of both fingertips as STL, 3MF and STEP files"
    )
    default = Path(__file__).parent / "parts"
    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=default,
        help="created if it does not exist",
    )
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    made, found = parts(), {}
    export_step(assembly(made), folder / "assembly.step")
    for name, part in made.items():
        export_stl(part, folder / f"{name}.stl", *FINE)
        export_step(part, folder / f"{name}.step")
        mesher = Mesher()
        mesher.add_shape(part, linear_deflection=FINE[0], angular_deflection=FINE[1])
        mesher.write(folder / f"{name}.3mf")
        box = part.bounding_box()
        size = [round(edge, 1) for edge in (box.size.X, box.size.Y, box.size.Z)]
        mass = round(part.volume * PLASTIC, 1)
        files = {
            kind: _hash(folder / f"{name}.{kind}") for kind in ("stl", "3mf", "step")
        }
        found[name] = {"size_mm": size, "solid_g": mass, **files}
        sys.stdout.write(
            f"{name}: {' x '.join(map(str, size))} mm, {mass} g solid in PLA\n"
        )
    written = {"source": source_hash(), "parts": found}
    (folder / "parts.json").write_text(
        json.dumps(written, indent=1) + "\n", encoding="utf-8"
    )


def _hash(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()[:16]


if __name__ == "__main__":
    main()
