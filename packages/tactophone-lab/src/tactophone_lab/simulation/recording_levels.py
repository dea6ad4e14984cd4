"""Levels of the recording channel: gains, corners and noise of both microphones.

``first`` are those that the shipped models were trained with. They were chosen so that
the noise floor came out a little under -26 dBFS. ``derived`` follow from the parts'
data sheets and from the one number that the authors' code states of their recordings;
docs/research/recording-levels.md has the derivation and what stays open. They were
written down before any detector was scored on them, on 2026-11-28.
"""

import math
from types import MappingProxyType
from typing import NamedTuple

from tactophone.core.errors import ConfigError
from tactophone.core.tips import DEFAULT_TIP
from tactophone_lab.simulation.finger import Electronics
from tactophone_lab.simulation.microphone_models import COMPETITION

PIEZO_CHARGE = 400e-12
"""Coulombs a newton: d33 of soft PZT, as discs have it (300 to 600)."""

PIEZO_CAPACITANCE = 10e-9
"""Farads of a disc of 12 mm, as data sheets have it (8 to 20 nF)."""

INPUT_RESISTANCE = 1.5e6
"""Ohms of a Scarlett 2i2's instrument input, by its data sheet."""

CONTACT_CORNER = 1 / (2 * math.pi * INPUT_RESISTANCE * PIEZO_CAPACITANCE)
"""Corner of the contact microphone in Hz: 11."""

CONTACT_GAIN = 1.8
"""Full scale per newton at the piezo: strong strokes over rough stones just clip."""

PIEZO_FULL_SCALE = PIEZO_CHARGE / PIEZO_CAPACITANCE / CONTACT_GAIN
"""Peak volts of the piezo at digital full scale: 22 mV."""

PREAMPLIFIER_NOISE = 15e-9 * math.sqrt(20e3)
"""Volts rms at the input: 15 nV per root hertz, as of a high-impedance stage with a
field-effect transistor, over 20 kHz."""

MICROPHONE_SENSITIVITY = 10 ** (-42 / 20)
"""Volts a pascal of an SPW2430, by its data sheet."""

MICROPHONE_NOISE_SPL = 94 - 59 + 2
"""dB SPL: the data sheet's ratio of signal to noise is 59 dB (A); white noise is 2 dB
more without the weighting."""

LOUDEST_INPUT = math.sqrt(2) * 0.775 * 10 ** (12.5 / 20)
"""Peak volts of the instrument input at its least gain: +12.5 dBu."""

MOST_GAIN = 10 ** (56 / 20)
"""Range of the preamplifier's gain, by its data sheet."""

AIR_GAIN = MICROPHONE_SENSITIVITY * MOST_GAIN / LOUDEST_INPUT
"""Full scale per pascal: 1.08."""

HUM_DBFS = -50.0
"""Mains hum in the contact channel: 230 V through 3 fF into the piezo. From 1 to 100 fF
it is -60 to -20 dBFS; the sum of all noise decides, see `SILENCE`."""

RUMBLE_DBFS = -54.0
"""Rumble of a robot that stands, 12 to 80 Hz: the rest of the sum."""

WHINE_DBFS = -54.0
"""Motors at full speed, in the contact channel."""

GEAR_DBFS = -56.0
"""Gears and joints at full speed, in the contact channel."""

SILENCE = 0.005
"""Mean absolute value of 256 ms at 2 kHz that contact exceeds in the authors' code. It
"slightly exceeds" the noise floor: by 3.2 dB with motors that stand, 2.5 dB with motors
at full speed (loudest window in 3 s)."""

LABORATORY_SPL = 45.0
"""dB SPL of a robot's fans and computers; 38 to 55 are as likely."""

MOTORS_SPL = 50.0
"""dB SPL of motors at full speed, at the fingertip; 40 to 60."""

HALL_SPL = 62.0
"""dB SPL in a box with a curtain, in a hall of 70 dB (A) with an audience and its
loudspeakers; 50 to 70."""

HALL_MAINS = 60.0
"""Hz; the finals were held in Long Beach, California."""


def _dbfs(spl: float) -> float:
    """Return the level in dBFS of a sound pressure level at the air microphone."""
    return spl - 94 + 20 * math.log10(AIR_GAIN)


class RecordingLevels(NamedTuple):
    """Levels in the laboratory, and in the competition's hall with motors running."""

    laboratory: Electronics
    hall: Electronics


_LABORATORY = Electronics(
    contact_gain=CONTACT_GAIN,
    air_gain=AIR_GAIN,
    contact_corner=CONTACT_CORNER,
    contact_hum_dbfs=HUM_DBFS,
    contact_noise_dbfs=20 * math.log10(PREAMPLIFIER_NOISE / PIEZO_FULL_SCALE),
    contact_rumble_dbfs=RUMBLE_DBFS,
    air_noise_dbfs=_dbfs(MICROPHONE_NOISE_SPL),
    room_dbfs=_dbfs(LABORATORY_SPL),
    motor_air_dbfs=_dbfs(MOTORS_SPL),
    motor_contact_dbfs=WHINE_DBFS,
    gear_dbfs=GEAR_DBFS,
)

FIRST = "first"

LEVELS = MappingProxyType(
    {
        FIRST: RecordingLevels(Electronics(), COMPETITION),
        "derived": RecordingLevels(
            _LABORATORY,
            _LABORATORY._replace(room_dbfs=_dbfs(HALL_SPL), mains=HALL_MAINS),
        ),
    }
)
"""By the word of ``tactophone simulate --levels``."""


def electronics(levels: str, *, hall: bool, tip: str) -> Electronics | None:
    """Return the electronics of a session; ``None`` means the tip's own.

    Raises `ConfigError` for levels that say nothing of this tip.
    """
    if levels == FIRST:
        return COMPETITION if hall else None
    if tip != DEFAULT_TIP:
        raise ConfigError(
            f"--levels {levels}: was derived for the paper's finger, tip "
            f"{DEFAULT_TIP}, not for {tip}; omit one of them"
        )
    chosen = LEVELS[levels]
    return chosen.hall if hall else chosen.laboratory
