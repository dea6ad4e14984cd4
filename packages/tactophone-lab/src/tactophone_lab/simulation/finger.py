"""The finger: masses, springs and dampers, the sensitivity of its two microphones, and
the tips that touch.

Defaults describe a 3D-printed fingertip with a silicone pad, as large as the paper's
(section IV-A); the other tips are in `TIPS`. They were chosen within the cited
ranges so that levels come out as the paper reports them: noise floor of the contact
microphone a little under -26 dBFS, air microphone well under it, more so on smooth
surfaces.

A tip is soft rubber, a hard skin on silicone (the default), a plastic rod or a steel
stylus. It decides how sound shows roughness, and even the sign of some features: under
a hard tip a rough surface clicks, under a soft one a smooth surface sticks and slips
while a rough one is averaged away. So it has to be stated; it cannot be derived from
the sound. Values are from handbooks and geometry, none from recordings.

A rod is a cantilever of length L, held at its end: ``f = (3.516, 22.03, 61.70) / 2 pi *
c d / 4 L^2`` with ``c`` the speed of longitudinal waves and ``d`` the diameter (Blevins
1979, table 8-1), a modal mass of a quarter of its own. Its microphone is mounted on it,
so the rod's motion shakes it: 0.3 to 6 mPa per m/s^2, 43 to 69 dB SPL at 1 g, the range
of electret capsules.
"""

from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple, Self

import numpy as np

from tactophone.core import tips
from tactophone.core.errors import ConfigError
from tactophone_lab.simulation.mechanics import SKIN
from tactophone_lab.simulation.modes import Mode


class Finger(NamedTuple):
    """Mechanics of finger, pad and arm; a tuple, so that the compiled kernel can take
    it. SI units.

    - ``tip_radius``, ``tip_modulus``: of the tip's curvature; plane-strain modulus of
      what touches.
    - ``air_distance``: from the contact to the air microphone.
    - ``arm_mass``, ``arm_damping``, ``arm_rest``: the force-controlled arm, moving
      along the normal, and the height at which it hovers.
    - ``pad_mass``, ``pad_stiffness``, ``pad_damping``: the hard skin on its silicone,
      along the normal: 225 Hz, Q about 2 (Shore 20 A silicone, loss factor 0.3 to 0.5).
    - ``shear_stiffness``, ``shear_damping``: the same along the surface.
    - ``link_mass``, ``link_frequency``, ``link_loss``: the last joint, swinging along
      the surface.
    - ``restitution``: Hunt-Crossley damping in s/m: the force is ``K d^1.5 (1 + c d')``
      (Hunt & Crossley, J. Appl. Mech. 42, 440, 1975).
    - ``bristle_stiffness``, ``bristle_damping``: LuGre friction in 1/m and s/m (Canudas
      de Wit et al., IEEE Trans. Autom. Control 40, 419, 1995).
    - ``normal_strain``, ``shear_strain``: newtons at the piezo per newton of normal and
      tangential contact force.
    - ``pad_radiation``, ``shear_radiation``: pascals at the air microphone per m/s^2 of
      the pad: ``0.7 rho S / (4 pi r)``, S = 5 cm^2, r = 18 mm. Sliding sideways moves
      next to no air: that is why a smooth surface is quiet in air.
    - ``shake_radiation``: pascals per m/s^2 of the finger itself: the air microphone's
      sensitivity to being shaken.
    """

    tip_radius: float = 3e-3
    tip_modulus: float = SKIN
    air_distance: float = 0.02
    arm_mass: float = 0.035
    arm_damping: float = 12.0
    arm_rest: float = 3e-3
    pad_mass: float = 6e-3
    pad_stiffness: float = 1.2e4
    pad_damping: float = 4.0
    shear_stiffness: float = 6.0e3
    shear_damping: float = 3.0
    link_mass: float = 0.05
    link_frequency: float = 48.0
    link_loss: float = 0.3
    restitution: float = 14.0
    bristle_stiffness: float = 6e4
    bristle_damping: float = 8.0
    normal_strain: float = 0.55
    shear_strain: float = 0.5
    pad_radiation: float = 1.86e-3
    shear_radiation: float = 9e-5
    shake_radiation: float = 3e-3

    def tilted(self, degrees: float) -> Self:
        """Return the finger with its bed's axis so far from the surface's normal; the
        ball touches as before.

        Along the normal the bed then gives by both its stiffnesses, ``1 / k = cos^2 /
        k_n + sin^2 / k_s`` (springs at an angle), and along the surface the other way
        round; so do the dampers. The piezo and the air hear each force and motion by
        its parts along and across the bed's axis, added as powers. Coupling of the two
        motions is left out.
        """
        if not degrees:
            return self  # to the bit
        along = np.cos(np.radians(degrees)) ** 2
        across = np.sin(np.radians(degrees)) ** 2

        def turned(first: str, second: str, power: float) -> dict[str, float]:
            one = getattr(self, first) ** power
            other = getattr(self, second) ** power
            return {
                first: float((along * one + across * other) ** (1 / power)),
                second: float((along * other + across * one) ** (1 / power)),
            }

        return self._replace(
            **turned("pad_stiffness", "shear_stiffness", -1),
            **turned("pad_damping", "shear_damping", -1),
            **turned("normal_strain", "shear_strain", 2),
            **turned("pad_radiation", "shear_radiation", 2),
        )


FLEXURE = (
    Mode(2300.0, 1.6e-3, 0.08, 9e-5, strain=0.20),
    Mode(4700.0, 1.2e-3, 0.06, 9e-5, strain=0.18),
    Mode(7600.0, 1.2e-3, 0.06, 9e-5, strain=0.07),
)
"""Bending modes of the printed shell under the pad."""


class Electronics(NamedTuple):
    """Microphones, preamplifier and the noise around them.

    - ``contact_gain``, ``air_gain``: full scale per newton at the piezo, and per pascal
      at the air microphone (1 Pa is 94 dB SPL).
    - ``contact_corner``, ``air_corner``: high-pass corners in Hz: piezo capacitance
      into the preamplifier's input, and the MEMS's vent.
    - ``contact_hum_dbfs``, ``contact_noise_dbfs``, ``contact_rumble_dbfs``: a
      high-impedance input beside motors: mains hum, white noise, and handling rumble
      (12 to 80 Hz).
    - ``air_noise_dbfs``, ``room_dbfs``: the microphone's own noise, and the room's,
      which falls by 3 dB an octave.
    - ``motor_air_dbfs``, ``motor_contact_dbfs``: motors at full speed, through the air
      and through the arm.
    - ``gear_dbfs``, ``jerk_dbfs``: noise of gears, cables and joints at full speed
      through the arm, and of a start or stop as it begins.
    - ``mains``: in Hz.
    """

    contact_gain: float = 1.8
    air_gain: float = 1.2
    contact_corner: float = 50.0
    air_corner: float = 75.0
    contact_hum_dbfs: float = -32.5
    contact_noise_dbfs: float = -38.0
    contact_rumble_dbfs: float = -36.0
    air_noise_dbfs: float = -72.0
    room_dbfs: float = -59.0
    motor_air_dbfs: float = -62.0
    motor_contact_dbfs: float = -46.0
    gear_dbfs: float = -np.inf
    jerk_dbfs: float = -np.inf
    mains: float = 50.0

    def amplified(self, gain_db: float, air_gain_db: float = 0.0) -> Self:
        """Add gain to both microphones' preamplifiers: signal and noise before them are
        amplified alike."""
        return self._replace(
            contact_gain=self.contact_gain * 10 ** (gain_db / 20),
            contact_hum_dbfs=self.contact_hum_dbfs + gain_db,
            contact_noise_dbfs=self.contact_noise_dbfs + gain_db,
            contact_rumble_dbfs=self.contact_rumble_dbfs + gain_db,
            motor_contact_dbfs=self.motor_contact_dbfs + gain_db,
            gear_dbfs=self.gear_dbfs + gain_db,
            jerk_dbfs=self.jerk_dbfs + gain_db,
            air_gain=self.air_gain * 10 ** (air_gain_db / 20),
            room_dbfs=self.room_dbfs + air_gain_db,
            air_noise_dbfs=self.air_noise_dbfs + air_gain_db,
            motor_air_dbfs=self.motor_air_dbfs + air_gain_db,
        )


_Bounds = tuple[float, float]

_STEEL = 220e9
"""Plane-strain modulus of steel in Pa: E = 200 GPa, Poisson's ratio 0.3."""

_PLASTIC = 3.3e9
"""Of POM, PMMA or ABS, in Pa: E = 2.3 to 3 GPa, Poisson's ratio 0.35 to 0.37."""

_RUBBER = 4e6
"""Of rubber of Shore 45 to 50 A, in Pa: E = 2 to 3 MPa, Poisson's ratio 0.5."""


@dataclass(frozen=True, slots=True)
class Tip:
    """A tip, and how it varies from session to session.

    - ``name``, ``description``: as the command line has it, and a line about it.
    - ``finger``: Mechanics; what follows replaces parts of it.
    - ``flexure``: bending modes of what holds the tip.
    - ``radius``, ``mass``, ``air_distance``, ``shaken``: bounds of ``tip_radius``,
      ``pad_mass``, ``air_distance`` and ``pad_radiation`` of the finger, drawn
      uniformly in the logarithm; ``None`` leaves the finger's own.
    - ``electronics``: microphones and the noise around them.
    - ``air_gain_db``: bounds of extra gain of the air microphone. The gain of a stylus
      is unknown; it is set so that strokes hardly clip.
    """

    name: str
    description: str
    finger: Finger
    flexure: tuple[Mode, ...] = FLEXURE
    radius: _Bounds | None = None
    mass: _Bounds | None = None
    air_distance: _Bounds | None = None
    shaken: _Bounds | None = None
    electronics: Electronics = Electronics()  # noqa: RUF009  # an immutable tuple
    air_gain_db: _Bounds = (0.0, 0.0)

    def draw_finger(self, rng: np.random.Generator) -> Finger:
        bounds = {
            "tip_radius": self.radius,
            "pad_mass": self.mass,
            "air_distance": self.air_distance,
            "pad_radiation": self.shaken,
        }
        drawn = {
            name: float(np.exp(rng.uniform(*np.log(pair))))
            for name, pair in bounds.items()
            if pair
        }
        return self.finger._replace(**drawn)


_ROD = Finger(
    arm_mass=0.12,  # a hand's fingers about a pen
    pad_stiffness=2.5e3,  # their grip: 25 Hz with the hand's mass
    pad_damping=4.0,
    shear_stiffness=4e3,
    shear_damping=4.0,
    restitution=8.0,  # 0.79 of the speed comes back at 5 cm/s (Hunt & Crossley 1975)
    bristle_stiffness=2e5,
    bristle_damping=15.0,
    shear_radiation=1e-4,
    shake_radiation=2e-4,
)
"""A rod in a hand."""


def _rod(
    name: str, what: str, modulus: float, flexure: tuple[Mode, ...], mass: _Bounds
) -> Tip:
    """Return a rod with the air microphone on it; ``mass``: from the free rod's quarter
    to one with a microphone."""
    return Tip(
        name,
        f"{what}, 0.5 to 2 mm tip radius, the air microphone on it",
        _ROD._replace(tip_modulus=modulus),
        flexure,
        radius=(0.5e-3, 2e-3),
        mass=mass,
        air_distance=(0.03, 0.15),
        shaken=(3e-4, 6e-3),
        # a quiet room of 25 dB SPL (0 dBFS is 92 dB SPL), and a hand in place of motors
        electronics=Electronics(room_dbfs=-67.0, motor_air_dbfs=-95.0),
        air_gain_db=(-10.0, 10.0),
    )


_TIPS = (
    Tip(
        "rubber",
        tips.TIPS["rubber"].words,
        Finger(tip_radius=6e-3, tip_modulus=_RUBBER),
    ),
    Tip("pad", tips.TIPS["pad"].words, Finger(tip_modulus=SKIN)),
    _rod(
        "plastic",
        tips.TIPS["plastic"].words,
        _PLASTIC,
        # 8 x 100 mm, c = 1.6 km/s, 6 g
        (
            Mode(177.0, 1.5e-3, 0.10, 2e-5, strain=0.20),
            Mode(1110.0, 1.5e-3, 0.05, 1e-4, strain=0.18),
            Mode(3110.0, 1.5e-3, 0.04, 2.6e-4, strain=0.07),
        ),
        mass=(1.5e-3, 4e-3),
    ),
    _rod(
        "stylus",
        tips.TIPS["stylus"].words,
        _STEEL,
        # 5 x 100 mm, c = 5.05 km/s, 15.4 g
        (
            Mode(355.0, 3.8e-3, 0.10, 2e-5, strain=0.20),
            Mode(2220.0, 3.8e-3, 0.04, 1e-4, strain=0.18),
            Mode(6220.0, 3.8e-3, 0.03, 2.6e-4, strain=0.07),
        ),
        mass=(3e-3, 8e-3),
    ),
)

TIPS = MappingProxyType({tip.name: tip for tip in _TIPS})
"""The tips by name, as `tactophone.core.tips.TIP_NAMES` lists them."""


def tip_named(name: str) -> Tip:
    """Return a tip.

    Raises `ConfigError` if no tip has that name.
    """
    if name not in TIPS:
        raise ConfigError(f"{name!r} is not a tip; there are {', '.join(TIPS)}")
    return TIPS[name]
