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
"""Mass of pad, ring and disc, in kg."""

BALL_IMPULSE = 3e-3
"""Impulse of a steel ball of 2 g that falls from 50 mm and comes back at half its
speed, in N s."""

WEIGHT_IMPULSE = 8e-3
"""Impulse of a pencil's tap on a weight that stands on the pad, in N s."""

TAP_IMPULSE = 4e-3
"""Impulse of a pencil's tap on the pad, in N s."""

BALL_CONTACT = 1.5e-4
"""Seconds that a steel ball touches the pad."""

PENCIL_CONTACT = 10 * BALL_CONTACT
"""Seconds that a pencil touches a weight: it is softer than steel."""

GAIN = 0.025
"""Full scale per newton of the blow, with the preamplifier turned down for a ball."""

DURATION = 3
"""Seconds of each sound."""

LOUDNESS_BESIDE_AIR = 0.3
"""Share of a blow that the disc still hears with air under it."""

TREBLE_LIMIT_BESIDE_AIR = 400.0
"""Hz over which a disc with air under it hears little."""


@dataclass(frozen=True, slots=True)
class BuiltFinger:
    """A finger as built."""

    stiffness: float = 11.8e3
    """Stiffness of the bed in N/m: 12e3 in training; more with a hard silicone or a
    thin bed."""
    corner: float = 16.0
    """High-pass corner in Hz: 16 of a high-impedance input, 1,600 of a line input."""
    air: bool = False
    """Whether air is left under the disc: it hears less, and hardly any treble."""
    motors_db: float = 0.0
    """How much more of the robot's motors reaches the contact microphone than in
    training."""


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
    gain_db = 20 * np.log10(GAIN / Electronics().contact_gain)
    usual = Electronics().amplified(gain_db)
    floors = 10 ** (np.array([usual.contact_noise_dbfs, usual.room_dbfs]) / 20)
    size = DURATION * LIVE_SAMPLE_RATE
    sounds = {
        name: rng.standard_normal((size, 2)) * floors
        for name in ("silence", "motors", *struck)
    }
    band = signal.butter(2, (80, 400), "bandpass", fs=LIVE_SAMPLE_RATE, output="sos")
    motors = signal.sosfilt(band, rng.standard_normal(size))
    motors_dbfs = usual.motor_contact_dbfs + built.motors_db
    sounds["motors"][:, 0] += motors / motors.std() * 10 ** (motors_dbfs / 20)
    for name, (impulse, mass) in struck.items():
        sound = sounds[name]
        for start in np.arange(0.4, 2.6, 0.6) + rng.uniform(0, 0.1, 4):
            hit = _hit(built, impulse * rng.uniform(0.8, 1.2), mass)
            first = round(start * LIVE_SAMPLE_RATE)
            heard = hit[: len(sound) - first]
            sound[first : first + len(heard), 0] += heard
            # The air microphone hears a tenth of it.
            sound[first : first + len(heard), 1] += 0.1 * heard
    return {
        name: np.clip(sound, -1, 1).astype(np.float32) for name, sound in sounds.items()
    }


def _hit(built: BuiltFinger, impulse: float, mass: float) -> FloatArray:
    """Return the piezo's sound of a blow on the pad that carries ``mass`` kg, over 0.4
    s."""
    time = np.arange(round(0.4 * LIVE_SAMPLE_RATE)) / LIVE_SAMPLE_RATE
    moved = PAD_MASS + mass
    finger = Finger()
    # The damper has training's loss at the pad's own mass.
    loss = finger.pad_damping / (2 * np.sqrt(finger.pad_stiffness * finger.pad_mass))
    damping = loss * np.sqrt(PAD_MASS / moved)
    omega = np.sqrt(built.stiffness / moved)
    bed = impulse * omega * np.exp(-damping * omega * time) * np.sin(omega * time)
    lasting = PENCIL_CONTACT if mass else BALL_CONTACT
    half_sine = np.sin(np.pi * np.minimum(time / lasting, 1))
    blow = impulse * np.pi / (2 * lasting) * half_sine
    heard = GAIN * finger.normal_strain * (bed + blow)
    heard = _first_order(heard, built.corner, "highpass")
    if built.air:
        heard = LOUDNESS_BESIDE_AIR * _first_order(
            heard, TREBLE_LIMIT_BESIDE_AIR, "lowpass"
        )
    return np.asarray(heard)


def _first_order(sound: FloatArray, corner: float, kind: str) -> FloatArray:
    """Filter a sound by a first-order filter whose corner is in Hz."""
    filtering = signal.butter(1, corner, kind, fs=LIVE_SAMPLE_RATE, output="sos")
    return np.asarray(signal.sosfilt(filtering, sound))
