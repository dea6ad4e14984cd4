"""The finished finger on the bench, sound and with each fault that a builder can make.

A pad on its bed takes an impulse ``P``: the disc hears the blow, and then the bed's
force, ``P w exp(-z w t) sin(w t)``. The model of a bench test; no finger was measured.
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone_lab.simulation.finger import Electronics, Finger

PAD_MASS = 2e-3
"""Of pad, ring and disc, in kg."""

BALL_IMPULSE, WEIGHT_IMPULSE, TAP_IMPULSE = 3e-3, 8e-3, 4e-3
"""In N s: a steel ball of 2 g from 50 mm that comes back at half its speed; a pencil's
tap on a weight; on the pad."""

BLOW = 1.5e-4
"""Seconds that a ball touches."""

GAIN = 0.025
"""Full scale per newton of the blow, with the preamplifier turned down for a ball."""


@dataclass(frozen=True, slots=True)
class BuiltFinger:
    """A finger as built.

    - ``stiffness``: of the bed, in N/m: 12e3 in training; more of a hard silicone or a thin bed.
    - ``corner``: high-pass corner in Hz: 16 of a high-impedance input, 1,600 of a line input.
    - ``air``: whether air is left under the disc: it hears less, and hardly any treble.
    - ``motors_db``: by how much more of the robot's motors reaches the contact microphone than in training.
    """

    stiffness: float = 11.8e3
    corner: float = 16.0
    air: bool = False
    motors_db: float = 0.0


def bench_sounds(
    built: BuiltFinger, *, weight: float, seed: int = 0
) -> dict[str, FloatArray]:
    """Render silence, motors, ball, tap and weight; each float32 ``(samples, 2)`` at 48
    kHz; ``weight`` in kg."""
    rng = np.random.default_rng([0xBE4C, seed])
    struck = {
        "ball": (BALL_IMPULSE, 0.0),
        "tap": (TAP_IMPULSE, 0.0),
        "weight": (WEIGHT_IMPULSE, weight),
    }
    usual = Electronics().amplified(20 * np.log10(GAIN / Electronics().contact_gain))
    floors = 10 ** (np.array([usual.contact_noise_dbfs, usual.room_dbfs]) / 20)
    size = 3 * LIVE_SAMPLE_RATE
    sounds = {
        name: rng.standard_normal((size, 2)) * floors
        for name in ("silence", "motors", *struck)
    }
    band = signal.butter(2, (80, 400), "bandpass", fs=LIVE_SAMPLE_RATE, output="sos")
    motors = signal.sosfilt(band, rng.standard_normal(size))
    sounds["motors"][:, 0] += (
        motors
        / motors.std()
        * 10 ** ((usual.motor_contact_dbfs + built.motors_db) / 20)
    )
    for name, (impulse, mass) in struck.items():
        for start in np.arange(0.4, 2.6, 0.6) + rng.uniform(0, 0.1, 4):
            hit = _hit(built, impulse * rng.uniform(0.8, 1.2), mass)
            first = round(start * LIVE_SAMPLE_RATE)
            sounds[name][first : first + len(hit), 0] += hit[
                : len(sounds[name]) - first
            ]
            sounds[name][first : first + len(hit), 1] += (
                0.1 * hit[: len(sounds[name]) - first]
            )
    return {
        name: np.clip(sound, -1, 1).astype(np.float32) for name, sound in sounds.items()
    }


def _hit(built: BuiltFinger, impulse: float, mass: float) -> FloatArray:
    """Return the piezo's sound of a blow on the pad that carries ``mass`` kg, over 0.4
    s."""
    time = np.arange(round(0.4 * LIVE_SAMPLE_RATE)) / LIVE_SAMPLE_RATE
    moved, finger = PAD_MASS + mass, Finger()
    # The damper has training's loss at the pad's own mass.
    loss = finger.pad_damping / (2 * np.sqrt(finger.pad_stiffness * finger.pad_mass))
    damping = loss * np.sqrt(PAD_MASS / moved)
    omega = np.sqrt(built.stiffness / moved)
    bed = impulse * omega * np.exp(-damping * omega * time) * np.sin(omega * time)
    lasting = BLOW * (10 if mass else 1)  # a pencil is softer than steel
    blow = (
        impulse * np.pi / (2 * lasting) * np.sin(np.pi * np.minimum(time / lasting, 1))
    )
    heard = GAIN * Finger().normal_strain * (bed + blow)
    for corner, kind in (
        (built.corner, "highpass"),
        *(((400.0, "lowpass"),) if built.air else ()),
    ):
        heard = signal.sosfilt(
            signal.butter(1, corner, kind, fs=LIVE_SAMPLE_RATE, output="sos"), heard
        )
    return np.asarray(heard * (0.3 if built.air else 1.0))
