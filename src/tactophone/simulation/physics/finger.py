"""The finger: masses, springs and dampers, and the sensitivity of its two microphones.

Defaults are those of a 3D-printed fingertip with a silicone pad, in the size of the paper's (section III); the other
tips are in :mod:`~tactophone.simulation.physics.tip`. They were chosen within the cited ranges so that levels come out
as the paper reports them: noise floor of the contact microphone a little under -26 dBFS, air microphone well under it,
more so on smooth surfaces.
"""

from typing import NamedTuple

from tactophone.simulation.physics.contact_mechanics import SKIN
from tactophone.simulation.physics.modes import Mode


class Finger(NamedTuple):
    """Mechanics of finger, pad and arm; a tuple, so that the compiled kernel can take it. SI units.

    Parameters
    ----------
    tip_radius, tip_modulus
        Of the tip's curvature; plane-strain modulus of what touches.
    air_distance
        From the contact to the air microphone.
    arm_mass, arm_damping, arm_rest
        The force-controlled arm, moving along the normal, and the height at which it hovers.
    pad_mass, pad_stiffness, pad_damping
        The hard skin on its silicone, along the normal: 225 Hz, Q about 2 (Shore 20 A silicone,
        loss factor 0.3 to 0.5).
    shear_stiffness, shear_damping
        The same along the surface.
    link_mass, link_frequency, link_loss
        The last joint, swinging along the surface.
    restitution
        Hunt-Crossley damping in s/m: the force is ``K d^1.5 (1 + c d')`` (Hunt & Crossley, J. Appl. Mech. 42, 440,
        1975).
    bristle_stiffness, bristle_damping
        LuGre friction in 1/m and s/m (Canudas de Wit et al., IEEE Trans. Autom. Control 40, 419, 1995).
    normal_strain, shear_strain
        Newtons at the piezo per newton of normal and tangential contact force.
    pad_radiation, shear_radiation
        Pascals at the air microphone per m/s^2 of the pad: ``0.7 rho S / (4 pi r)``, S = 5 cm^2, r = 18 mm. Sliding
        sideways moves next to no air: that is why a smooth surface is quiet in air.
    shake_radiation
        Pascals per m/s^2 of the finger itself: the air microphone's sensitivity to being shaken.
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


FLEXURE = (
    Mode(2300.0, 1.6e-3, 0.08, 9e-5, strain=0.20),
    Mode(4700.0, 1.2e-3, 0.06, 9e-5, strain=0.18),
    Mode(7600.0, 1.2e-3, 0.06, 9e-5, strain=0.07),
)
"""Bending modes of the printed shell under the pad."""


class Electronics(NamedTuple):
    """Microphones, preamplifier and the noise around them.

    Parameters
    ----------
    contact_gain, air_gain
        Full scale per newton at the piezo, and per pascal at the air microphone (1 Pa is 94 dB SPL).
    contact_corner, air_corner
        High-pass corners in Hz: piezo capacitance into the preamplifier's input, and the MEMS's vent.
    contact_hum_dbfs, contact_noise_dbfs, contact_rumble_dbfs
        A high-impedance input beside motors: mains hum, white noise, and handling rumble (12 to 80 Hz).
    air_noise_dbfs, room_dbfs
        The microphone's own noise, and the room's, which falls by 3 dB an octave.
    motor_air_dbfs, motor_contact_dbfs
        Motors at full speed, through the air and through the arm.
    mains
        In Hz.
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
    mains: float = 50.0
