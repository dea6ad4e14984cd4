"""Every dimension of both fingertips, in mm: the one source of the parts, the tests,
the pictures and the guide.

The finger's coordinates start at the piezo disc's centre. z is the finger's axis, from
the knuckle to the tip; -y is the side that touches, +y the nail; x goes across. A
finger that lies flat touches along -y; tilted by 30 degrees with its tip down, along
the pad's own axis.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]

PLASTIC = 1.24e-3
"""Density of PLA in g/mm^3; PETG 1.27e-3."""

SHELL = 1.6
"""Wall of a printed part: four lines of a 0.4 mm nozzle."""

LEAST_WALL = 1.2
"""Three lines."""

FIT = 0.25
"""Clearance between parts that slide into one another."""


@dataclass(frozen=True)
class FingerDimensions:
    """The robot's fingertip: a round pad on a ring, and a phalanx whose core the
    silicone holds in that ring.

    Parameters
    ----------
    width
        Of pad, ring and phalanx; a person's index finger is 16 to 18 mm wide.
    lean
        Degrees from -y, tip down, at which the pad's axis stands.
    nose
        Radius of the ball that touches, the simulated tip ``pad``'s.
    slope
        Of the pad's flank in degrees: within this angle of the pad's axis only the ball
        touches.
    land
        Height of the pad's straight edge, where the ring is glued on.
    disc, disc_height
        Of the piezo disc, which is glued to the pad's flat back.
    bed
        Silicone between disc and core. It decouples the pad from the robot's motors.
    overlap
        How far the core reaches into the ring.
    side, gap
        Silicone around the core, and between ring and phalanx.
    hole
        Diameter of the holes through ring and core, in which the silicone holds.
    clearance
        Of the facet for the microphone's board from the ring.
    bottom, nail, end
        Of the phalanx: height of its underside is where the ring ends; y of the nail; z
        of its end.
    pin, pin_length
        Of an adapter, which the phalanx takes up; an M3 screw crosses both.
    """

    width: float = 16.0
    lean: float = 30.0
    nose: float = 3.0
    slope: float = 36.5
    land: float = 1.3
    disc: float = 12.0
    disc_height: float = 0.5
    bed: float = 3.0
    overlap: float = 3.0
    side: float = 1.2
    gap: float = 1.0
    hole: float = 2.4
    clearance: float = 1.05
    nail: float = 19.0
    end: float = -38.0
    pin: float = 8.0
    pin_length: float = 16.0

    def __post_init__(self) -> None:
        if self.disc / 2 + FIT > self.inner:
            raise ValueError(
                f"a disc of {self.disc:g} mm does not fit into a finger of "
                f"{self.width:g} mm; widen it"
            )

    @property
    def axis(self) -> Vector:
        """The pad's axis, out of the pad."""
        lean = np.radians(self.lean)
        return np.array([0.0, -np.cos(lean), np.sin(lean)])

    @property
    def forward(self) -> Vector:
        """Across the pad's axis, towards the tip."""
        lean = np.radians(self.lean)
        return np.array([0.0, np.sin(lean), np.cos(lean)])

    @property
    def inner(self) -> float:
        """Inner radius of the ring."""
        return self.width / 2 - SHELL

    @property
    def core(self) -> float:
        """Radius of the phalanx' core."""
        return self.inner - self.side

    @property
    def height(self) -> float:
        """Of the pad, from its flat back to the nose."""
        return cap_height(self.width / 2, self.nose, self.slope, self.land)

    @property
    def ring(self) -> float:
        """Height of the ring, from the pad's back."""
        return self.disc_height + self.bed + self.overlap

    @property
    def flange(self) -> float:
        """From the pad's back to the phalanx' face, behind it."""
        return self.ring + self.gap

    @property
    def hole_height(self) -> float:
        """Of the holes' axes over the ring's rear end."""
        return self.hole / 2 + 1.3

    @property
    def core_hole(self) -> float:
        """Distance of the axis of the core's hole from the pad's back."""
        return self.flange - 0.9

    @property
    def tip(self) -> float:
        """z of the finger's end."""
        return float(self.land * self.axis[2] + self.width / 2 * self.forward[2])

    def contact(self, pitch: float, roll: float = 0.0) -> Vector:
        """Return the point that touches with the tip ``pitch`` degrees down and the
        finger rolled by ``roll``."""
        return (self.height - self.nose) * self.axis + self.nose * towards(pitch, roll)

    @property
    def bed_stiffness(self) -> float:
        """Of the bed along the pad's axis, in N/m per Pa of the silicone's Young's
        modulus.

        ``(1 + 2 S^2) A / t`` for the face, S = R / 2 t (Gent, *Engineering with
        Rubber*, ch. 8), and shear ``G A / t``, G = E / 3, around the core.
        """
        shape, face = self.core / (2 * self.bed), np.pi * self.core**2
        around = 2 * np.pi * self.core * self.overlap
        return 1e-3 * float(
            (1 + 2 * shape**2) * face / self.bed + around / self.side / 3
        )

    @property
    def bed_shear(self) -> float:
        """The same across the pad's axis: the face in shear, and the silicone around
        the core pressed, bonded."""
        face, around = np.pi * self.core**2, np.pi * self.core * self.overlap
        shape = self.overlap / (2 * self.side)
        return 1e-3 * float(
            face / self.bed / 3 + (1 + 2 * shape**2) * around / 2 / self.side
        )


@dataclass(frozen=True)
class Board:
    """The air microphone's board, on tape on the facet between nail and tip: its
    largest size, and its port.

    ``front`` is the place of its front edge along the facet, ``port`` the port's
    distance from it, and the microphone a square of ``package`` that stands ``capsule``
    over the board.
    """

    width: float = 13.0
    length: float = 17.0
    thickness: float = 1.6
    tape: float = 0.5
    capsule: float = 1.0
    package: float = 3.0
    front: float = -1.9
    port: float = 3.7

    out = np.array([0.0, 1.0, 1.0]) / np.sqrt(2)
    """Out of the facet, 45 degrees between nail and tip: printed nail down, it needs no
    support."""

    along = np.array([0.0, -1.0, 1.0]) / np.sqrt(2)
    """Along the facet, towards the tip."""

    def facet(self, finger: FingerDimensions) -> float:
        """Distance of the facet from the disc's centre."""
        corner = -finger.ring * finger.axis + finger.width / 2 * finger.forward
        return float(corner @ self.out) + finger.clearance

    def port_place(self, finger: FingerDimensions) -> Vector:
        over = self.facet(finger) + self.tape + self.thickness + self.capsule
        return over * self.out + (self.front - self.port) * self.along

    def corners(self, finger: FingerDimensions) -> Vector:
        """Return the corners of the board, its tape and the microphone, shape ``(16,
        3)``."""
        low = self.facet(finger)
        top, port, half = (
            low + self.tape + self.thickness,
            self.front - self.port,
            self.package / 2,
        )
        boxes = (
            (low, top, self.front, self.front - self.length, self.width / 2),
            (top, top + self.capsule, port + half, port - half, half),
        )
        return np.array(
            [
                over * self.out + place * self.along + np.array([side, 0, 0])
                for below, above, ahead, behind, wide in boxes
                for over in (below, above)
                for place in (ahead, behind)
                for side in (-wide, wide)
            ]
        )


@dataclass(frozen=True)
class BallGuide:
    """A frame on the nail that holds a tube over the nose, for the bench test's ball.

    It is printed lying on its side. It touches the phalanx alone: pad and ring stay
    free.

    Parameters
    ----------
    bore
        Of the tube, in which a ball of 8 mm falls.
    wall
        Around the bore.
    lowest, drop
        Of the tube's ends over the nose; a ball let go at its upper edge falls from
        ``drop``.
    nail
        How much of the nail it lies on, from the phalanx' end.
    stop
        Thickness of the wall behind the phalanx' end, and of the nail's plate.
    cheek
        Thickness of the plate at one side of the phalanx.
    """

    bore: float = 9.0
    wall: float = 2.5
    lowest: float = 8.0
    drop: float = 50.0
    nail: float = 24.0
    stop: float = 3.0
    cheek: float = 2.4


@dataclass(frozen=True)
class WeightYoke:
    """A yoke whose dimple stands on the nose and whose arms hang beside the finger, so
    that its weight cannot fall off: its centre of mass lies under the nose.

    Parameters
    ----------
    depth
        Of all of it across the arms; it is printed lying flat.
    dimple
        Half of the cone's opening angle, in degrees: it touches the ball, not the
        flank.
    span, arm, reach
        Half the distance of the arms, their width, and how far they hang under the
        nose.
    beam
        Height of the beam over the nose.
    peg, peg_length
        Side and length of the square pegs, on which washers of 8.4 mm hang.
    """

    depth: float = 12.0
    dimple: float = 60.0
    span: float = 12.0
    arm: float = 5.0
    reach: float = 42.0
    beam: float = 8.0
    peg: float = 5.4
    peg_length: float = 17.0


@dataclass(frozen=True)
class CoilCase:
    """The operator's side: a case that holds a voice coil above the fingertip of a
    glove or an exoskeleton.

    Parameters
    ----------
    length, width, height
        Of the voice coil: Actronika's HapCoil-One measures 37.7 x 12 x 11.5 mm.
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


@dataclass(frozen=True)
class Plate:
    """A plate with holes at the corners of a rectangle: for a hand or a glove whose
    drawing was not found.

    ``across`` and ``along`` are the holes' distances.
    """

    width: float = 24.0
    length: float = 24.0
    height: float = 3.0
    across: float = 16.0
    along: float = 16.0
    hole: float = 3.2


GLOVE = Plate(width=24.0, length=46.0, height=2.4, across=18.0, along=40.0, hole=2.2)
"""The operator's blank plate, which carries the coil's case."""

HAND = 12.0, 2.2, 18.0
"""Bolt circle, holes and flange for a hand whose last joint is a servo's horn with four
M2 screws."""

STICK = 10.0
"""Diameter of a round stick, for trials by hand."""


def cap_height(radius: float, nose: float, slope: float, land: float) -> float:
    """Height of a pad of this radius: its edge, its flank, and the ball that the flank
    touches."""
    turn = np.radians(slope)
    return float(
        land + (radius - nose * np.sin(turn)) * np.tan(turn) + nose * (1 - np.cos(turn))
    )


def towards(pitch: float, roll: float = 0.0) -> Vector:
    """Direction of the surface, in the finger's coordinates."""
    down, side = np.radians(pitch), np.radians(roll)
    return np.array(
        [np.sin(side), -np.cos(side) * np.cos(down), np.cos(side) * np.sin(down)]
    )


def placed(name: str, points: Vector) -> Vector:
    """Move points from a part as it is printed to its place in the finger."""
    finger = FingerDimensions()
    across = np.array([1.0, 0.0, 0.0])
    pad = np.column_stack((across, finger.forward, finger.axis))
    turned, moved = {
        "pad": (pad, np.zeros(3)),
        "ring": (pad, -finger.ring * finger.axis),
        "phalanx": (
            np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
            np.array([0, finger.nail, finger.end]),
        ),
        "pouring_jig": (
            pad @ np.diag([1.0, -1, -1]),
            (finger.height + 3.5) * finger.axis,
        ),
        "stick_adapter": (
            np.eye(3),
            np.array([0, bore_height(finger), finger.end - stick_length(finger)]),
        ),
        # It is drawn in the finger's place and lies down on its side: x goes up.
        "ball_guide": (
            np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]),
            np.array([guide_side(finger), 0, 0]),
        ),
        "weight_yoke": (
            np.column_stack((across, -finger.axis, finger.forward)),
            finger.height * finger.axis - WeightYoke().depth / 2 * finger.forward,
        ),
    }[name]
    return np.asarray(points @ turned.T + moved)


def guide_side(finger: FingerDimensions) -> float:
    """Return x of the ball guide's side that lies on the printer's bed."""
    return -(finger.width / 2 + FIT + BallGuide().cheek)


def bore_height(finger: FingerDimensions) -> float:
    """Return y of the axis of the phalanx' bore."""
    return (underside(finger) + finger.nail) / 2


def underside(finger: FingerDimensions) -> float:
    """Return y of the phalanx' underside: it begins where the ring's lower edge
    ends."""
    return float((-finger.flange * finger.axis - finger.width / 2 * finger.forward)[1])


def stick_length(finger: FingerDimensions) -> float:
    """Return the length of the stick's adapter without its pin."""
    outer = STICK / 2 + 2.4
    return 20 + outer - finger.pin / 2
