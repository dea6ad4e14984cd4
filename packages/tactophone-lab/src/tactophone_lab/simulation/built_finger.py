"""The finished finger on the bench, sound and with each fault that a builder can make.

A pad on its bed takes an impulse ``P``: the disc hears the blow, and then the bed's
force, ``P w exp(-z w t) sin(w t)``; the air hears the pad's acceleration. The model of
a bench test; no finger was measured. Noise and gains are those of
`~tactophone_lab.simulation.recording_levels`.
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone_lab.simulation.finger import Electronics, Finger
from tactophone_lab.simulation.recording_levels import LEVELS, MOST_GAIN

BALL_MASS = 2.1e-3
"""Of a steel ball of 8 mm, in kg."""

BALL_SPEED = 0.99
"""m/s after a fall of 50 mm."""

RESTITUTION = (0.4, 0.6)
"""Of a steel ball on plastic; each drop differs."""

WEIGHT_IMPULSE = 8e-3
"""Impulse of a pencil's tap on a weight that stands on the pad, in N s."""

TAP_IMPULSE = 2e-3
"""Impulse of a pencil's tap on the pad, in N s."""

BALL_CONTACT = 1.5e-4
"""Seconds that a steel ball touches the pad."""

PENCIL_CONTACT = 10 * BALL_CONTACT
"""Seconds that a pencil touches a weight: it is softer than steel."""

TAP_CONTACT = 5e-4
"""Seconds that a pencil touches the pad, which yields."""

GAIN = 0.025
"""Full scale per newton of the blow, with the preamplifier turned down for a ball."""

CONVERTER_DBFS = -113.0
"""Noise of the converter: its dynamic range is 110 dB of a full sine."""

DURATION = 3
"""Seconds of each sound."""

LOUDNESS_BESIDE_AIR = 0.3
"""Share of a blow that the disc still hears with air under it."""

TREBLE_LIMIT_BESIDE_AIR = 400.0
"""Hz over which a disc with air under it hears little."""

RATTLE = 0.05
"""Share of a blow's peak at which a loose joint rattles at first."""

RATTLING = 0.02
"""Seconds in which a rattle falls to 1/e."""

SHARE_OF_NAIL = 0.1
"""Share of a blow on the nail that reaches the bed: the phalanx is clamped."""


@dataclass(frozen=True, slots=True)
class BuiltFinger:
    """A finger as built."""

    stiffness: float = 11.8e3
    """Stiffness of the bed in N/m; more with a hard silicone or a thin bed."""
    corner: float = 16.0
    """High-pass corner in Hz: 16 of a high-impedance input, 1,600 of a line input."""
    pad: float = 4.4e-3
    """Mass of pad, ring and disc, in kg."""
    air: bool = False
    """Whether air is left under the disc: it hears less, and hardly any treble."""
    loose: bool = False
    """Whether disc or ring rattle on the pad."""
    upside_down: bool = False
    """Whether the finger is clamped with its nail up."""
    board_db: float = 0.0
    """Gain of the air microphone's board over the one in the parts list."""
    motors_db: float = 0.0
    """How much more of the robot's motors reaches the contact microphone than in the
    paper's laboratory."""


def bench_sounds(
    built: BuiltFinger, *, weight: float, seed: int = 0
) -> dict[str, FloatArray]:
    """Render silence, motors, ball, tap and weight; each float32 ``(samples, 2)`` at 48
    kHz; ``weight`` in kg."""
    rng = np.random.default_rng([0xBE4C, seed])
    laboratory = LEVELS["derived"].laboratory
    gain_db = 20 * np.log10(GAIN / laboratory.contact_gain)
    # Both knobs stand at the same mark; the air channel's was at its end.
    air_db = gain_db + 46.4 - 20 * np.log10(MOST_GAIN) + built.board_db
    usual = laboratory.amplified(gain_db, air_db)
    size = DURATION * LIVE_SAMPLE_RATE
    struck = {"ball": 0.0, "tap": 0.0, "weight": weight}
    sounds = {name: _rest(usual, rng, size) for name in ("silence", "motors", *struck)}
    sounds["motors"][:, 0] += _motors(usual, built, rng, size)
    for name, mass in struck.items():
        sound = sounds[name]
        for start in np.arange(0.4, 2.6, 0.6) + rng.uniform(0, 0.1, 4):
            impulse = rng.uniform(0.8, 1.2) * {
                "ball": 0.0,
                "tap": TAP_IMPULSE,
                "weight": WEIGHT_IMPULSE,
            }[name] or BALL_MASS * BALL_SPEED * (1 + rng.uniform(*RESTITUTION))
            hit = _hit(built, impulse, mass, name, usual.air_gain, rng)
            first = round(start * LIVE_SAMPLE_RATE)
            heard = hit[: len(sound) - first]
            sound[first : first + len(heard)] += heard
    return {
        name: np.clip(sound, -1, 1).astype(np.float32) for name, sound in sounds.items()
    }


def _rest(usual: Electronics, rng: np.random.Generator, size: int) -> FloatArray:
    """Return what both channels hear of nothing: hum and rumble as hum, and noise."""
    time = np.arange(size) / LIVE_SAMPLE_RATE
    noise = rng.standard_normal((size, 2)) * _amplitudes(
        usual.contact_noise_dbfs, usual.room_dbfs
    )
    noise += rng.standard_normal((size, 2)) * _amplitudes(CONVERTER_DBFS)
    hum = np.sin(2 * np.pi * usual.mains * time + rng.uniform(0, 2 * np.pi))
    hum_level, rumble_level = _amplitudes(
        usual.contact_hum_dbfs, usual.contact_rumble_dbfs
    )
    noise[:, 0] += np.sqrt(2 * (hum_level**2 + rumble_level**2)) * hum
    return np.asarray(noise)


def _motors(
    usual: Electronics, built: BuiltFinger, rng: np.random.Generator, size: int
) -> FloatArray:
    """Return what motors at full speed add to the contact channel."""
    band = signal.butter(2, (80, 400), "bandpass", fs=LIVE_SAMPLE_RATE, output="sos")
    motors = signal.sosfilt(band, rng.standard_normal(size))
    levels = _amplitudes(usual.motor_contact_dbfs, usual.gear_dbfs)
    level = np.hypot(*levels) * 10 ** (built.motors_db / 20)
    return np.asarray(motors / motors.std() * level)


def _amplitudes(*levels_dbfs: float) -> FloatArray:
    return np.asarray(10 ** (np.array(levels_dbfs) / 20))


def _hit(
    built: BuiltFinger,
    impulse: float,
    mass: float,
    name: str,
    air_gain: float,
    rng: np.random.Generator,
) -> FloatArray:
    """Return what both microphones hear of a blow on the pad that carries ``mass`` kg,
    over 0.4 s."""
    time = np.arange(round(0.4 * LIVE_SAMPLE_RATE)) / LIVE_SAMPLE_RATE
    moved = built.pad + mass
    finger = Finger()
    # The damper has silicone's loss at the pad's own mass, a Q of about 2.
    loss = finger.pad_damping / (2 * np.sqrt(finger.pad_stiffness * finger.pad_mass))
    damping = loss * np.sqrt(built.pad / moved)
    omega = np.sqrt(built.stiffness / moved)
    swing = omega * np.sqrt(1 - damping**2)
    bed = impulse * omega * np.exp(-damping * omega * time) * np.sin(swing * time)
    lasting = {
        "ball": BALL_CONTACT,
        "tap": TAP_CONTACT,
        "weight": PENCIL_CONTACT,
    }[name]
    half_sine = np.sin(np.pi * np.minimum(time / lasting, 1))
    blow = impulse * np.pi / (2 * lasting) * half_sine
    force = bed + blow
    if built.upside_down:
        # The phalanx takes the blow, and the bed passes what is under its resonance.
        own = np.sqrt(built.stiffness / built.pad) / (2 * np.pi)
        through = signal.butter(2, own, fs=LIVE_SAMPLE_RATE, output="sos")
        force = SHARE_OF_NAIL * np.asarray(signal.sosfilt(through, blow))
    heard = GAIN * finger.normal_strain * force
    if built.loose:
        rattle = rng.standard_normal(len(time)) * np.exp(-time / RATTLING)
        heard += RATTLE * np.abs(heard).max() * rattle
    heard = _first_order(heard, built.corner, "highpass")
    if built.air:
        heard = LOUDNESS_BESIDE_AIR * _first_order(
            heard, TREBLE_LIMIT_BESIDE_AIR, "lowpass"
        )
    acceleration = (blow - bed) / moved
    air = air_gain * finger.pad_radiation * acceleration
    return np.column_stack((heard, air))


def _first_order(sound: FloatArray, corner: float, kind: str) -> FloatArray:
    """Filter a sound by a first-order filter whose corner is in Hz."""
    filtering = signal.butter(1, corner, kind, fs=LIVE_SAMPLE_RATE, output="sos")
    return np.asarray(signal.sosfilt(filtering, sound))
