"""From force and pressure to digital full scale: transducers, room, noise, hum, motors
and clipping.

The piezo is a capacitance into the preamplifier's input resistance, a second-order
high-pass here; the MEMS has its vent. In a box, the box's resonances filter a body's
sound on its way to the air microphone. Noise is made from the normals of each sample,
so that it does not depend on block size. Finger, microphones and room vary a little
from one recording session to the next.
"""

import functools
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import FloatArray
from tactophone_lab.simulation.contact import Array, ContactSignals
from tactophone_lab.simulation.finger import FLEXURE, Electronics, Finger, tip_named
from tactophone_lab.simulation.mechanics import compiled
from tactophone_lab.simulation.modes import Mode, Mounting

NORMALS = 5
"""Unit normals a sample: contact noise, rumble, room, air noise, motor."""

_PINK = (
    (0.049922035, -0.095993537, 0.050612699, -0.004408786),
    (1.0, -2.494956002, 2.017265875, -0.522189400),
)
"""-3 dB an octave (J. O. Smith, *Spectral Audio Signal Processing*, 2011, "Synthesis of
1/F noise")."""

_HUM = ((1, 1.0), (2, 0.35), (3, 0.5), (5, 0.3), (7, 0.2), (9, 0.1))
"""Mains harmonics and their amplitudes, as rectifiers make them: odd ones first."""

_MOTOR = (1.0, 0.6, 0.45, 0.3, 0.2, 0.15)
"""Amplitudes of the first harmonics of a geared motor's whine."""

_STILL = 0.02
"""Activity, 0 to 1, under which a motor stands."""

_BRAKE = 0.05
"""Seconds of standing after which a motor's brake closes; a turn is shorter."""

_JERK_DECAY = 0.1
"""Seconds in which a jerk falls to 1/e. A start of the one gripper that was recorded
lasts 0.4 s (docs/research/contact.md)."""

_GEAR_CORNER = 1500.0
"""Frequency in Hz over which gears fall by 6 dB an octave. The motion of the same
gripper reaches 2 kHz."""

_CEILING = 1.0 - 2.0**-23
"""Largest sample of a converter of 24 bits, as a share of full scale."""


class Filter(NamedTuple):
    """Second-order sections and their state, shape ``(sections, 6)`` and ``(sections,
    2)``."""

    sections: Array
    state: Array


class Electrics(NamedTuple):
    """Filters, wave tables and linear gains of one recording session."""

    contact: Filter
    air: Filter
    rumble: Filter
    room: Filter
    cavity: Filter
    hum: Array
    whine: Array
    # Phase of the whine, seconds of standing, jerk, newest sample of the gears.
    motor: Array
    whine_frequency: float
    gains: Array


class Microphones:
    """Two microphones with preamplifiers and converters; keeps its state between
    blocks."""

    def __init__(
        self,
        electronics: Electronics,
        cavity: Mounting,
        *,
        seed: np.random.SeedSequence,
        rate: int,
    ) -> None:
        rng = np.random.default_rng(seed)
        self._rate = rate
        self._electrics = _wire(electronics, cavity, rng, rate)
        self._position = 0

    def convert(
        self, signals: ContactSignals, motor: Array, normals: Array
    ) -> FloatArray:
        """Return contact and air, shape ``(samples, 2)``, from -1 to 1.

        ``motor`` is the motors' activity (0-1), shape ``(samples,)``; ``normals`` is
        unit noise ``(samples, NORMALS)``.
        """
        out = np.empty((signals.strain.size, 2), np.float32)
        _convert(
            signals,
            motor,
            normals,
            self._electrics,
            self._position,
            float(self._rate),
            out,
        )
        self._position += len(out)
        return out


def cavity_sections(mounting: Mounting, rng: np.random.Generator, rate: int) -> Array:
    """Resonances of the air in a box of 20 to 40 cm, as peaks of 5 to 7 dB; none
    elsewhere."""
    if mounting not in (Mounting.BOX, Mounting.MAT):
        return np.zeros((0, 6))
    peaks = ((180, 320, 7, 5), (380, 560, 6, 6), (640, 900, 5, 7))
    return np.array(
        [_peak(rng.uniform(low, high), gain, q, rate) for low, high, gain, q in peaks]
    )


def _peak(frequency: float, gain_db: float, q: float, rate: int) -> Array:
    """A peaking equaliser (R. Bristow-Johnson, *Audio EQ Cookbook*)."""
    gain = 10 ** (gain_db / 40)
    omega = 2 * np.pi * frequency / rate
    alpha = np.sin(omega) / (2 * q)
    b = np.array([1 + alpha * gain, -2 * np.cos(omega), 1 - alpha * gain])
    a = np.array([1 + alpha / gain, -2 * np.cos(omega), 1 - alpha / gain])
    return np.concatenate([b / a[0], a / a[0]])


def _wire(
    electronics: Electronics, cavity: Mounting, rng: np.random.Generator, rate: int
) -> Electrics:
    e = electronics
    rumble, room, gains = _noise_filters(rate)
    levels = (
        e.contact_noise_dbfs,
        e.contact_rumble_dbfs,
        e.room_dbfs,
        e.air_noise_dbfs,
    )
    noise = np.array([_amplitude(level) for level in levels]) / gains
    motors = [
        _amplitude(level)
        for level in (e.motor_contact_dbfs, e.motor_air_dbfs, e.gear_dbfs, e.jerk_dbfs)
    ]
    return Electrics(
        contact=_filter(
            signal.butter(2, e.contact_corner, "high", fs=rate, output="sos")
        ),
        air=_filter(signal.butter(2, e.air_corner, "high", fs=rate, output="sos")),
        rumble=_filter(rumble),
        room=_filter(room),
        cavity=_filter(cavity_sections(cavity, rng, rate)),
        hum=_hum(e, rng, rate),
        whine=_wave(4096, enumerate(_MOTOR, start=1), rng),
        motor=np.array([0.0, 1.0, 0.0, 0.0]),
        whine_frequency=float(rng.uniform(240, 420)),
        gains=np.array([e.contact_gain, e.air_gain, *noise, *motors]),
    )


@functools.cache
def _noise_filters(rate: int) -> tuple[Array, Array, tuple[float, ...]]:
    """Return the filters of rumble and of a room's noise, and the rms gains of the four
    noises through theirs."""
    rumble = signal.butter(2, [12, 80], "band", fs=rate, output="sos")
    room = np.vstack(
        [signal.tf2sos(*_PINK), signal.butter(2, 45, "high", fs=rate, output="sos")]
    )
    return rumble, room, (1.0, _rms_gain(rumble), _rms_gain(room), 1.0)


def _filter(sections: Array) -> Filter:
    return Filter(
        np.ascontiguousarray(sections, dtype=float), np.zeros((len(sections), 2))
    )


def _amplitude(level_dbfs: float) -> float:
    return float(10 ** (level_dbfs / 20))


def _rms_gain(sections: Array) -> float:
    impulse = np.zeros(1 << 16)
    impulse[0] = 1
    return float(np.sqrt((signal.sosfilt(sections, impulse) ** 2).sum()))


def _hum(electronics: Electronics, rng: np.random.Generator, rate: int) -> Array:
    """One period of the mains hum, in full scale."""
    wave = _wave(round(rate / electronics.mains), _HUM, rng)
    return np.asarray(wave / wave.std() * _amplitude(electronics.contact_hum_dbfs))


def _wave(
    size: int, harmonics: Iterable[tuple[int, float]], rng: np.random.Generator
) -> Array:
    """One period of harmonics of these numbers and amplitudes, in random phase."""
    phase = 2 * np.pi * np.arange(size) / size
    terms = [
        gain * np.sin(k * phase + rng.uniform(0, 2 * np.pi)) for k, gain in harmonics
    ]
    return np.asarray(np.sum(terms, axis=0))


@compiled
def _filtered(x: float, sections: Array, state: Array) -> float:
    for k in range(sections.shape[0]):
        y = sections[k, 0] * x + state[k, 0]
        state[k, 0] = sections[k, 1] * x - sections[k, 4] * y + state[k, 1]
        state[k, 1] = sections[k, 2] * x - sections[k, 5] * y
        x = y
    return x


@compiled
def _motor(electrics: Electrics, activity: float, normal: float, rate: float) -> float:
    """The whine's next sample; pitch and loudness follow the motor's activity."""
    phase = (
        electrics.motor[0] + electrics.whine_frequency * (0.4 + 0.6 * activity) / rate
    )
    electrics.motor[0] = phase - np.floor(phase)
    place = electrics.motor[0] * electrics.whine.size
    left = int(place)
    right = (left + 1) % electrics.whine.size
    wave = electrics.whine[left] * (left + 1 - place) + electrics.whine[right] * (
        place - left
    )
    return wave * activity * (1.0 + 0.15 * normal)


@compiled
def _gears(electrics: Electrics, activity: float, normal: float, rate: float) -> float:
    """The next sample of gears, cables and joints, and of the jerk where the motors
    start or their brakes close."""
    motor, share = electrics.motor, 2 * np.pi * _GEAR_CORNER / rate
    stood, motor[1] = motor[1], motor[1] + 1 / rate if activity < _STILL else 0.0
    if (stood < _BRAKE) != (motor[1] < _BRAKE):
        motor[2] = 1.0
    motor[2] *= 1 - 1 / (_JERK_DECAY * rate)
    motor[3] += share * (
        normal / np.sqrt(share / (2 - share)) - motor[3]
    )  # of unit rms, as the normals
    return motor[3] * (electrics.gains[8] * activity + electrics.gains[9] * motor[2])


@compiled
def _convert(
    signals: ContactSignals,
    motor: Array,
    normals: NDArray[np.float64],
    e: Electrics,
    position: int,
    rate: float,
    out: FloatArray,
) -> None:
    g = e.gains
    for i in range(signals.strain.size):
        whine = _motor(e, motor[i], normals[i, 4], rate)
        contact = g[0] * _filtered(
            signals.strain[i], e.contact.sections, e.contact.state
        )
        contact += e.hum[(position + i) % e.hum.size] + g[2] * normals[i, 0]
        contact += (
            g[3] * _filtered(normals[i, 1], e.rumble.sections, e.rumble.state)
            + g[6] * whine
        )
        contact += _gears(e, motor[i], normals[i, 4], rate)
        pressure = signals.finger[i] + _filtered(
            signals.body[i], e.cavity.sections, e.cavity.state
        )
        air = (
            g[1] * _filtered(pressure, e.air.sections, e.air.state)
            + g[5] * normals[i, 3]
        )
        air += (
            g[4] * _filtered(normals[i, 2], e.room.sections, e.room.state)
            + g[7] * whine
        )
        out[i, 0] = min(max(contact, -1.0), _CEILING)
        out[i, 1] = min(max(air, -1.0), _CEILING)


@dataclass(frozen=True, slots=True)
class SessionVariation:
    """What is constant within a session.

    - ``finger``, ``electronics``: mechanics and microphones.
    - ``seed``: draws the objects' modes and the phase of the hum.
    - ``flexure``: bending modes of what holds the tip.
    """

    finger: Finger = field(default_factory=Finger)
    electronics: Electronics = field(default_factory=Electronics)
    seed: int = 0
    flexure: tuple[Mode, ...] = FLEXURE

    @classmethod
    def of_tip(cls, tip: str, seed: int) -> Self:
        """Return the set-up as built for the default tip; for another, a session drawn
        with that seed."""
        return cls() if tip == DEFAULT_TIP else cls.draw(seed, tip=tip)

    @classmethod
    def draw(
        cls,
        seed: int,
        electronics: Electronics | None = None,
        *,
        tip: str = DEFAULT_TIP,
    ) -> Self:
        """Draw a session: gains vary by 1 dB (1 sigma), silicone by 10 %, microphone
        places by 15 to 25 %.

        ``electronics`` replaces the tip's own; ``tip`` is one of
        `~tactophone_lab.simulation.finger.TIPS`.
        """
        rng, tip_rng = (
            np.random.default_rng([0x5E75, seed]),
            np.random.default_rng([0x71B, seed]),
        )
        chosen = tip_named(tip)
        finger = chosen.draw_finger(tip_rng)
        wired = (electronics or chosen.electronics).amplified(
            0.0, tip_rng.uniform(*chosen.air_gain_db)
        )
        closeness = rng.uniform(0.85, 1.2)
        return cls(
            finger=finger._replace(
                pad_stiffness=finger.pad_stiffness * rng.uniform(0.9, 1.1),
                shear_stiffness=finger.shear_stiffness * rng.uniform(0.9, 1.1),
                normal_strain=finger.normal_strain * rng.uniform(0.8, 1.2),
                shear_strain=finger.shear_strain * rng.uniform(0.75, 1.25),
                pad_radiation=finger.pad_radiation * closeness,
                shear_radiation=finger.shear_radiation * closeness,
            ),
            electronics=wired._replace(
                contact_gain=wired.contact_gain * 10 ** (rng.normal(0, 1.0) / 20),
                air_gain=wired.air_gain * 10 ** (rng.normal(0, 1.0) / 20),
                contact_hum_dbfs=wired.contact_hum_dbfs + rng.normal(0, 0.5),
                room_dbfs=wired.room_dbfs + rng.normal(0, 2.5),
            ),
            seed=seed,
            flexure=chosen.flexure,
        )


COMPETITION = Electronics(
    room_dbfs=-48.0, motor_air_dbfs=-50.0, motor_contact_dbfs=-43.0
)
"""A hall full of people, and running motors."""
