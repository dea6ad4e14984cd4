"""Makes the parts of both fingertips as STL files: the robot's, after the paper's section III-A, and the operator's.

``python hardware/fingertip.py [FOLDER]`` writes each part and prints its size and mass. Every dimension is a parameter,
in mm. A part is drawn as it is printed: z points up from the bed and is the finger's
axis, from the knuckle to the tip; -y is the side that touches. Holes across the axis have a roof of 45 degrees, and
cavities close in a cone, so nothing needs support. Nobody has built these parts yet.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from manifold3d import CrossSection, Manifold, set_circular_segments
from numpy.typing import NDArray

set_circular_segments(96)

PLA = 1.24e-3
"""Density of the printed plastic in g/mm^3."""

LEAST_WALL = 1.2
"""Least wall in mm: three lines of a 0.4 mm nozzle."""

SHELL = 1.6
"""Wall of a printed part in mm: four lines."""

FIT = 0.25
"""Clearance in mm between parts that slide into one another."""

FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
"""A triangle in a binary STL file."""


@dataclass(frozen=True)
class Finger:
    """The robot's fingertip: pad and phalanx, with a bed of silicone between them.

    Parameters
    ----------
    width, length
        Of the pad; a person's index finger is 16 to 18 mm wide.
    nose
        Radius of the ball that touches, that of the simulated tip ``pad``. From it the pad recedes on all sides,
        convex, so that nothing can catch.
    disc
        Diameter of the piezo disc that is glued to the pad's inside.
    bed
        Thickness of the silicone between pad and phalanx. It decouples the pad from the robot's motors.
    hole
        Diameter of the holes through both, in which the silicone joins them.
    pin
        Diameter of the adapter's pin, which the phalanx takes up; an M3 screw holds it.
    """

    width: float = 18.0
    length: float = 32.0
    nose: float = 3.0
    disc: float = 12.0
    bed: float = 1.5
    hole: float = 2.4
    pin: float = 8.0

    seat = -3.3
    """Height of the disc's seat: 3.7 mm of plastic under its middle, 1.6 mm under its rim."""

    touching = -7.0
    """Height of the nose's lowest point."""

    rim = 3.6
    """Height of the pad's upper rim."""

    neck = 20.0
    """Length of the phalanx behind the pad, with the socket for the pin."""

    def __post_init__(self) -> None:
        if self.disc > self.width - 2 * SHELL - 2:
            raise ValueError(f"a disc of {self.disc:g} mm does not fit into a pad of {self.width:g} mm; widen the pad")
        if self.length < self.disc + 18:
            raise ValueError(f"a disc of {self.disc:g} mm needs a pad of {self.disc + 18:g} mm; lengthen it")

    @property
    def tip(self) -> float:
        """Length of the rounded end."""
        return self.width / 2

    @property
    def floor(self) -> float:
        """Height of the pad's underside without its nose."""
        return self.seat + 0.3 - SHELL

    @property
    def disc_centre(self) -> float:
        """Distance of the disc's centre from the pad's rear edge."""
        return self.disc / 2 + 4

    def outline(self, *, rise: float = 0.0) -> CrossSection:
        """Return the section of the pad without its nose, from outside: rounded at the sides, flat at the rim."""
        floor = self.floor + rise
        box = CrossSection.square((self.width, self.rim - floor)).translate((-self.width / 2, floor))
        upright = CrossSection.square((self.width, self.rim)).translate((-self.width / 2, 0))
        return box.offset(-2.5).offset(2.5) + upright

    def outside(self) -> Manifold:
        """Return the pad as if it were solid: the hull of its shell and of a ball under the disc's middle."""
        # From the seat's end on the underside rises by 18 degrees, so that the nose also touches with the tip down.
        body, end = self.length - self.tip, self.disc_centre + 0.75 * self.disc
        raised = _rounded_end(self.outline(rise=float(np.tan(np.radians(18))) * (body - end)), body, self.tip)
        ball = Manifold.sphere(self.nose).translate((0, self.touching + self.nose, self.disc_centre))
        return Manifold.batch_hull([self.outline().extrude(end), raised, ball])

    def cavity(self) -> CrossSection:
        """Return the pad's inside, open above, with a flat floor for the disc."""
        above = CrossSection.square((self.width, 20)).translate((-self.width / 2, self.seat + 0.3))
        tall = self.outline() + CrossSection.square((self.width, 20)).translate((-self.width / 2, 0))
        return tall.offset(-SHELL) ^ above

    def pad(self) -> Manifold:
        """Return the pad: it touches, and carries the piezo disc on its inside."""
        body = self.length - self.tip
        inner = self.cavity()
        # The cavity closes towards a point over the open side, so that its ceiling prints without support.
        above = self.rim + 4.4
        closing = (
            inner.translate((0, -above))
            .extrude(1.2 * (above - self.seat), scale_top=(0.0, 0.0))
            .translate((0, above, 0))
        )
        hollow = inner.extrude(body - 5).translate((0, 0, -0.01)) + closing.translate((0, 0, body - 5.02))
        pad = self.outside() - hollow
        above = Manifold.cube((40, 40, 80)).translate((-20, self.seat, -20))
        seat = _teardrop(self.disc / 2 + FIT).translate((0, 0, self.disc_centre)) ^ above
        wires = Manifold.cube((4, 4, self.disc_centre)).translate((-2, self.seat, -0.01))
        pad -= seat + wires
        for z in self.hole_heights:
            pad -= _across(self.hole / 2).translate((0, self.hole_height, z))
        return pad

    @property
    def hole_height(self) -> float:
        """Height of the holes' axes over the pad's middle: a wall of 1.4 mm stands over them."""
        return self.rim - self.hole / 2 - 1.4

    @property
    def hole_heights(self) -> tuple[float, ...]:
        """Distances of the holes from the pad's rear edge."""
        return tuple(np.linspace(4.0, self.length - self.tip - 9, 3).tolist())

    def neck_section(self) -> CrossSection:
        """Return the phalanx' section: a core that fits the pad's cavity with the bed around it, and a round back."""
        above = CrossSection.square((40, 40)).translate((-20, self.seat + 0.3 + self.bed))
        return (self.cavity().offset(-self.bed) ^ above ^ self._under(self.rim + 2)) + self._back()

    def phalanx(self) -> Manifold:
        """Return the phalanx: its core lies in the pad's cavity, its back closes the finger, its neck takes the pin."""
        body, tip = self.length - self.tip, self.tip
        shoulder = self.rim + 1
        core = self.neck_section() ^ self._under(shoulder + 1)
        solid = core.extrude(self.neck + body - 6).translate((0, 0, -self.neck))
        above = self.rim + 4.4
        end = (
            core.translate((0, -above))
            .extrude(1.2 * (above - self.seat), scale_top=(0.0, 0.0))
            .translate((0, above, body - 6.01))
        )
        solid += end ^ Manifold.cube((80, 80, 80), center=True).translate((0, shoulder - 39, 0))
        solid += self._back().extrude(self.neck + body).translate((0, 0, -self.neck))
        solid += _rounded_end(self._back().translate((0, -shoulder)), body, tip).translate((0, shoulder, 0))
        bore = _closed_bore(self.pin / 2 + FIT, self.neck - 4)
        solid -= bore.translate((0, self.socket_height, -self.neck - 0.01))
        solid -= _across(1.6).translate((0, self.socket_height, 5 - self.neck))
        for z in self.hole_heights:
            solid -= _across(self.hole / 2).translate((0, self.hole_height, z))
        # A tie around this groove holds the cable, so that a pull does not reach the disc.
        ring = CrossSection([[(8.2, 0.0), (10.0, -2.0), (10.0, 2.0)]]).revolve().scale((1, 1.05, 1))
        return solid - ring.translate((0, self.rim + 1, -3.0))

    def _back(self) -> CrossSection:
        ellipse = CrossSection.circle(self.width / 2).scale((1, 1.05)).translate((0, self.rim + 1))
        return ellipse - self._under(self.rim + 1)

    def _under(self, height: float) -> CrossSection:
        return CrossSection.square((40, 40)).translate((-20, height - 40))

    @property
    def socket_height(self) -> float:
        """Height of the socket's axis over the pad's middle."""
        return self.rim + 3.8

    def silicone(self) -> Manifold:
        """Return the bed of silicone, for pictures and for its volume."""
        filled = self.outline() + self.cavity()
        block = (filled ^ self._under(self.rim + 1)).extrude(self.length - self.tip + 4)
        whole = Manifold.batch_hull([self.phalanx(), self.outside()])
        return (block ^ whole) - self.phalanx() - self.pad() - self.shell_outside()

    def shell_outside(self) -> Manifold:
        """Return what lies around the pad."""
        return Manifold.cube((60, 60, 80), center=True).translate((0, self.rim - 30.01, 0)) - self.outside()


@dataclass(frozen=True)
class Bracket:
    """The air microphone's holder: a collar on the phalanx' neck, and an arm beside the pad.

    Parameters
    ----------
    distance
        From the finger's axis to the microphone's port: about 2 cm in the paper.
    capsule
        Diameter of the capsule with the foam around it.
    lift
        From the port to the surface that the pad touches, so that the holder does not touch first.
    """

    distance: float = 20.0
    capsule: float = 8.0
    lift: float = 4.0

    def solid(self, finger: Finger) -> Manifold:
        """Return the bracket in the finger's coordinates: it is pushed over the neck before the adapter."""
        neck = finger.neck_section().offset(FIT)
        outer = neck.offset(SHELL)
        bottom, top = -11.0, -6.0
        collar = (outer - neck).extrude(top - bottom).translate((0, 0, bottom))
        side, depth = self.capsule + 2 * SHELL, 6.0
        port = self.lift + finger.touching
        holder = Manifold.cube((side, depth, side + 1.8)).translate(
            (self.distance - side / 2, port, finger.disc_centre - side / 2)
        )
        foot = Manifold.cube((2.5, depth, top - bottom)).translate((outer.bounds()[2] - 3.1, port, bottom))
        # The arm's underside rises by over 45 degrees from the collar to the capsule.
        beside = finger.outline().offset(1.0).extrude(80).translate((0, 0, top))
        arm = Manifold.batch_hull([foot, holder]) - neck.extrude(80).translate((0, 0, -40)) - beside
        return collar + arm - _teardrop(self.capsule / 2).translate((self.distance, 0, finger.disc_centre))


def adapter_to_stick(finger: Finger, stick: float = 10.0) -> Manifold:
    """Return a sleeve on a round stick with the phalanx' pin on top, for trials by hand."""
    outer = stick / 2 + 2.4
    sleeve = Manifold.cylinder(20, outer) + Manifold.cylinder(outer - finger.pin / 2, outer, finger.pin / 2).translate(
        (0, 0, 20)
    )
    part = sleeve + _pin(finger).translate((0, 0, 20 + outer - finger.pin / 2 - 0.01))
    part -= _closed_bore(stick / 2 + FIT, 18).translate((0, 0, -0.01))
    return part - _across(1.6).translate((0, 0, 8))


def adapter_to_hand(finger: Finger, bolt_circle: float = 12.0, bolt: float = 2.2, flange: float = 18.0) -> Manifold:
    """Return a flange with the phalanx' pin, for a hand whose last joint is a servo horn with four M2 screws.

    A hand of small servos (20 mm wide, as LEAP Hand's) has one; measure the bolt circle of yours.
    """
    plate = Manifold.cylinder(3, flange / 2)
    part = plate + _pin(finger).translate((0, 0, 2.99))
    for turn in range(4):
        hole = Manifold.cylinder(10, bolt / 2).translate((bolt_circle / 2, 0, -1))
        part -= hole.rotate((0, 0, 90 * turn + 45))
    return part


@dataclass(frozen=True)
class CoilCase:
    """The operator's side: a case that holds a voice coil above the fingertip of a glove or an exoskeleton.

    Parameters
    ----------
    length, width, height
        Of the voice coil; 37.7 x 12 x 11.5 mm is a common encapsulated one.
    saddle
        Radius of what it sits on: a fingertip in a glove.
    strap
        Width of the hook-and-loop strap.
    """

    length: float = 37.7
    width: float = 12.0
    height: float = 11.5
    saddle: float = 10.0
    strap: float = 12.0

    def case(self) -> Manifold:
        """Return the case; the coil slides in from above, the saddle fits the finger below (-y)."""
        inner = CrossSection.square((self.width + 2 * FIT, self.height + 2 * FIT), center=True)
        floor = inner.bounds()[1] - SHELL
        outer = inner.offset(SHELL)
        cheeks = CrossSection.square((self.width + 2 * SHELL + 2 * FIT, 5)).translate(
            (-self.width / 2 - SHELL - FIT, floor - 2.0)
        )
        ears = CrossSection.square((self.width + 2 * SHELL + 12, 2.4), center=True).translate((0, floor + 1.2))
        finger = CrossSection.circle(self.saddle).translate((0, floor - self.saddle + 0.3))
        body = (outer + cheeks + ears - finger).extrude(self.length + FIT + SHELL)
        body -= inner.extrude(self.length + FIT + 0.01).translate((0, 0, SHELL))
        for side in (-1, 1):
            x = side * (self.width / 2 + SHELL + FIT + 2.6)
            slot = Manifold.cube((2.2, 20, self.strap), center=True)
            roof = (
                CrossSection([[(-1.1, 0), (1.1, 0), (0, 1.2)]])
                .extrude(20)
                .rotate((90, 0, 0))
                .translate((0, 10, self.strap / 2))
            )
            body -= (slot + roof).translate((x, 0, self.length / 2))
        # The leads leave beside the lid.
        return body - Manifold.cube((3, 10, 4)).translate((-1.5, 0, self.length + FIT + SHELL - 4))

    def lid(self) -> Manifold:
        """Return the lid, a plug that is pressed or glued in."""
        inner = CrossSection.square((self.width, self.height), center=True)
        return (
            inner.offset(SHELL + FIT).extrude(SHELL)
            + inner.extrude(3.0)
            - Manifold.cube((3, 10, 20)).translate((-1.5, 0, SHELL))
        )


def soft_pad(
    radius: float = 9.0,
    side: float = 3.6,
    dome: float = 2.6,
    nose: float = 6.0,
    height: float = 7.0,
    disc: float = 12.0,
) -> Manifold:
    """Return the second recipe's pad: soft, 3 mm over the disc; it touches with the radius of the tip ``rubber``."""
    arc = [(radius * np.cos(turn), side + dome * np.sin(turn)) for turn in np.linspace(0, np.pi / 2, 16)]
    outline = CrossSection([[(0.0, 0.0), (radius, 0.0), *arc]])
    ball = Manifold.sphere(nose).translate((0, 0, height - nose)).trim_by_plane((0, 0, 1), 0)
    pocket = Manifold.cylinder(height - 3.0, disc / 2 + FIT)
    return Manifold.batch_hull([outline.revolve(), ball]) - pocket.translate((0, 0, -0.01))


def parts() -> dict[str, Manifold]:
    """Return every part by its file's name, as it lies on the printer's bed."""
    finger, case = Finger(), CoilCase()
    return {
        name: part.translate((0, 0, -part.bounding_box()[2]))
        for name, part in {
            "pad": finger.pad(),
            "phalanx": finger.phalanx(),
            "microphone_bracket": Bracket().solid(finger),
            "stick_adapter": adapter_to_stick(finger),
            "hand_adapter": adapter_to_hand(finger),
            "coil_case": case.case(),
            "coil_case_lid": case.lid(),
            "soft_pad": soft_pad(),
        }.items()
    }


def _rounded_end(section: CrossSection, body: float, tip: float) -> Manifold:
    """Return a convex section as a body with an end that is rounded like an ellipse."""
    steps = np.linspace(0, np.pi / 2, 13)
    slices = [section.extrude(body)]
    for turn in steps[:-1]:
        scale = max(float(np.cos(turn)), 0.05)
        slices.append(
            section.scale((scale, scale)).extrude(0.02).translate((0, 0, body + tip * float(np.sin(turn)) - 0.02))
        )
    return Manifold.batch_hull(slices)


def _teardrop(radius: float) -> Manifold:
    """Return a hole along y, 60 mm long, with a roof of 45 degrees towards +z."""
    edge = radius / np.sqrt(2)
    roof = CrossSection([[(edge, edge), (0.0, 2 * edge), (-edge, edge)]])
    return (CrossSection.circle(radius) + roof).extrude(60).rotate((90, 0, 0)).translate((0, 30, 0))


def _across(radius: float) -> Manifold:
    """Return the same hole along x."""
    return _teardrop(radius).rotate((0, 0, 90))


def _closed_bore(radius: float, depth: float) -> Manifold:
    """Return a bore from the bed up that closes in a cone."""
    return Manifold.cylinder(depth, radius) + Manifold.cylinder(radius, radius, 0.01).translate((0, 0, depth - 0.001))


def _pin(finger: Finger) -> Manifold:
    length = finger.neck - 4
    pin = Manifold.cylinder(length, finger.pin / 2)
    return pin - _across(1.6).translate((0, 0, 5))


def triangles(part: Manifold) -> NDArray[np.float64]:
    """Return the surface, shape ``(count, 3, 3)`` in mm, seen anticlockwise from outside."""
    mesh = part.to_mesh()
    return np.asarray(mesh.vert_properties)[:, :3][np.asarray(mesh.tri_verts)].astype(np.float64)


def write_stl(path: Path, faces: NDArray[np.float64]) -> None:
    """Write binary STL, in mm."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    record = np.zeros(len(faces), FACET)
    record["normal"], record["corners"] = normals, faces
    path.write_bytes(b"Tactophone, mm".ljust(80) + np.uint32(len(faces)).tobytes() + record.tobytes())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="make the parts of both fingertips as STL files")
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path(__file__).parent, help="created if it does not exist"
    )
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    for name, part in parts().items():
        write_stl(folder / f"{name}.stl", triangles(part))
        low, high = np.split(np.array(part.bounding_box()), 2)
        size = " x ".join(f"{edge:.1f}" for edge in high - low)
        sys.stdout.write(f"{name}.stl: {size} mm, {part.volume() * PLA:.1f} g in PLA\n")
