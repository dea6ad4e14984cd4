"""Makes two parts as STL files: the fingertip's pad, and the bracket that holds the air microphone beside it.

``python hardware/fingertip.py [FOLDER]`` prints the dimensions. The pad is a dome of silicone's outer shape with a
pocket for the piezo disc: a solid of revolution, so that it can be turned, printed as a core for a mould, or printed in
flexible filament. The bracket is printed in rigid filament: a ring around the pad's side, an arm, and a ring for the
microphone, which overlap, as slicers join them. Nobody has built either yet.
"""

import argparse
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

SEGMENTS = 72
"""Of a full turn: 0.4 mm of arc at the outer radius, a printer's line."""

ARC_POINTS = 16

PAD, BRACKET = "fingertip.stl", "microphone_bracket.stl"


@dataclass(frozen=True)
class Fingertip:
    """Dimensions in mm.

    Parameters
    ----------
    radius
        Of the pad; a person's index finger is 8 to 9 mm.
    side
        Height of the cylinder under the dome.
    dome
        Height of the dome.
    disc_diameter, disc_thickness
        Of the piezo disc that lies in the pocket; a common bender has 12 mm and 0.5 mm with its leads.
    clearance
        Around the disc and over its glue.
    """

    radius: float = 9.0
    side: float = 3.0
    dome: float = 4.0
    disc_diameter: float = 12.0
    disc_thickness: float = 0.5
    clearance: float = 0.25

    @property
    def layer(self) -> float:
        """Thickness of the layer between disc and surface at the middle."""
        return self.side + self.dome - self.pocket_depth

    @property
    def pocket_radius(self) -> float:
        """Of the pocket, from below."""
        return self.disc_diameter / 2 + self.clearance

    @property
    def pocket_depth(self) -> float:
        """Deep enough that the disc lies 3 mm under the surface, as under a silicone pad."""
        return self.side + self.dome - 3.0

    def check(self) -> None:
        """Raise if the parts do not fit into one another."""
        if self.pocket_radius > self.radius - 1.0:
            raise ValueError(f"a disc of {self.disc_diameter} mm leaves no wall of 1 mm; take a wider pad")
        if self.pocket_depth < self.disc_thickness + self.clearance:
            raise ValueError("the pocket is flatter than the disc; take a higher side")

    def outline(self) -> NDArray[np.float64]:
        """Return radius and height of the section, from the axis in the pocket around to the top of the dome."""
        angle = np.linspace(0, np.pi / 2, ARC_POINTS)
        arc = np.stack([self.radius * np.cos(angle), self.side + self.dome * np.sin(angle)], axis=1)
        pocket = [[0.0, self.pocket_depth], [self.pocket_radius, self.pocket_depth], [self.pocket_radius, 0.0]]
        return np.concatenate([pocket, [[self.radius, 0.0]], arc[:-1], [[0.0, self.side + self.dome]]])


@dataclass(frozen=True)
class Bracket:
    """Dimensions in mm.

    Parameters
    ----------
    distance
        From the pad's axis to the microphone's: about 2 cm in the paper (section III).
    pad_radius, clearance
        Of the pad, and between it and its ring.
    capsule_diameter
        Of the microphone with the foam around it: a capsule of 4 to 6 mm.
    wall, height
        Thickness of the rings, and height of all.
    """

    distance: float = 20.0
    pad_radius: float = 9.0
    clearance: float = 0.2
    capsule_diameter: float = 8.0
    wall: float = 1.6
    height: float = 3.0

    def check(self) -> None:
        """Raise if the rings overlap."""
        if self.arm_length < self.wall:
            raise ValueError(f"at {self.distance} mm the capsule's ring meets the pad's; take a longer distance")

    @property
    def arm_length(self) -> float:
        """From ring to ring."""
        return self.distance - self.pad_radius - self.clearance - self.capsule_diameter / 2 - 2 * self.wall

    def shells(self) -> list[NDArray[np.float64]]:
        """Return three closed surfaces: the pad's ring, the microphone's ring and the arm, which reaches into both."""
        self.check()
        inner = self.pad_radius + self.clearance
        near, far = inner + self.wall / 2, self.distance - (self.capsule_diameter + self.wall) / 2
        arm = _box([near, -2 * self.wall, 0.0], [far, 2 * self.wall, self.height])
        microphone = self._ring(self.capsule_diameter / 2)
        microphone[..., 0] += self.distance
        return [self._ring(inner), microphone, arm]

    def _ring(self, inner: float) -> NDArray[np.float64]:
        outer, top = inner + self.wall, self.height
        return revolve(np.array([[inner, 0.0], [outer, 0.0], [outer, top], [inner, top], [inner, 0.0]]))


def triangles(part: Fingertip) -> NDArray[np.float64]:
    """Return the surface as triangles, shape ``(count, 3, 3)`` in mm, seen anticlockwise from outside."""
    part.check()
    return revolve(part.outline())


def revolve(outline: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn a section of radius and height, anticlockwise, around the axis."""
    turn = 2 * np.pi * np.arange(SEGMENTS) / SEGMENTS
    around = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    faces = []
    for (inner_r, inner_z), (outer_r, outer_z) in pairwise(outline):
        for now, then in zip(around, np.roll(around, -1, axis=0), strict=True):
            a, b = np.append(inner_r * now, inner_z), np.append(inner_r * then, inner_z)
            c, d = np.append(outer_r * then, outer_z), np.append(outer_r * now, outer_z)
            # On the axis a side has no length, and one triangle is enough.
            if outer_r > 0:
                faces.append([a, c, d])
            if inner_r > 0:
                faces.append([a, b, c])
    return np.array(faces)


def _box(low: list[float], high: list[float]) -> NDArray[np.float64]:
    """Return the twelve triangles of a box."""
    corners = np.array([[(low, high)[bit >> axis & 1][axis] for axis in range(3)] for bit in range(8)])
    quads = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))
    return np.array([[corners[a], corners[b], corners[c]] for q in quads for a, b, c in (q[:3], (q[0], *q[2:]))])


def volume(faces: NDArray[np.float64]) -> float:
    """Return the volume in mm^3; positive where the faces look outwards."""
    return float(np.einsum("ij,ij->i", faces[:, 0], np.cross(faces[:, 1], faces[:, 2])).sum() / 6)


def write_stl(path: Path, faces: NDArray[np.float64]) -> None:
    """Write binary STL, in mm."""
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    record = np.zeros(len(faces), np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")]))
    record["normal"], record["corners"] = normals, faces
    path.write_bytes(b"Tactophone fingertip, mm".ljust(80) + np.uint32(len(faces)).tobytes() + record.tobytes())


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="make the fingertip's pad and the microphone's bracket as STL files")
    parser.add_argument(
        "folder", nargs="?", type=Path, default=Path(__file__).parent, help="created if it does not exist"
    )
    folder = parser.parse_args().folder
    folder.mkdir(parents=True, exist_ok=True)
    tip, bracket = Fingertip(), Bracket()
    surface = triangles(tip)
    write_stl(folder / PAD, surface)
    write_stl(folder / BRACKET, np.concatenate(bracket.shells()))
    size = f"pad {2 * tip.radius:g} mm wide, {tip.side + tip.dome:g} mm high, pocket {2 * tip.pocket_radius:g} mm"
    sys.stdout.write(f"{folder / PAD}: {size}\ndisc {tip.layer:g} mm under the surface; {volume(surface):.0f} mm^3\n")
    size = f"microphone {bracket.distance:g} mm from the pad's axis, in a ring of {bracket.capsule_diameter:g} mm"
    sys.stdout.write(f"{folder / BRACKET}: {size}\n")
