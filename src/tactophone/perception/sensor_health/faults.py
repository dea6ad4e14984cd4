"""Sensor faults at run time: each sign is looked for in the vitals, and a fault is named when its sign persists.

A contact microphone feels force, an air microphone hears acceleration: so contact sound is the louder and the duller of
the two at the gains of any sensible set-up. That order is what tells swapped microphones and a covered one. A sign is
there, not there, or cannot be seen (hum under a loud stroke; a covered microphone in silence): what cannot be seen
neither raises a fault nor ends it.
"""

import enum
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tactophone.perception.sensor_health.signal_statistics import ChannelStatistics, SignalStatistics
from tactophone.types import AIR, CONTACT, AudioBlock

RAISE_AFTER = 3
"""Measures in a row with the sign: with the half second that each looks back, a fault is named within 0.875 s."""

HEAL_AFTER = 8
"""Measures in a row without it: a second, so that a loose plug does not flicker."""


class Kind(enum.StrEnum):
    """What can be wrong with microphones."""

    DEAD = "dead"
    CLIPPED = "clipped"
    OFFSET = "offset"
    HUM = "hum"
    COVERED = "covered"
    SWAPPED = "swapped"
    ALIKE = "alike"


@dataclass(frozen=True, slots=True, order=True)
class SensorFault:
    """A fault and the channel that has it; ``SWAPPED`` and ``ALIKE`` concern both.

    >>> print(SensorFault(Kind.DEAD, AIR))
    air microphone dead: no sound comes from it; look to its plug, cable and supply
    """

    kind: Kind
    channel: int | None = None

    @property
    def code(self) -> str:
        """For programs: ``air-dead``."""
        return str(self.kind) if self.channel is None else f"{CHANNELS[self.channel]}-{self.kind}"

    def __str__(self) -> str:
        found, remedy = WORDS[self.kind]
        who = "microphones" if self.channel is None else f"{CHANNELS[self.channel]} microphone"
        return f"{who} {self.kind.replace('offset', 'off centre')}: {found}; {remedy}"


CHANNELS = ("contact", "air")

WORDS: Mapping[Kind, tuple[str, str]] = MappingProxyType(
    {
        Kind.DEAD: ("no sound comes from it", "look to its plug, cable and supply"),
        Kind.CLIPPED: ("its loud parts are cut off", "turn its gain down"),
        Kind.OFFSET: ("its sound has a constant part (DC)", "look to the interface's coupling and the supply"),
        Kind.HUM: ("mains hum stands over its noise", "mend its shield or ground, keep away from supplies"),
        Kind.COVERED: ("it hardly hears what the contact microphone feels", "open the case or clear its port"),
        Kind.SWAPPED: ("channel 1 sounds like the contact microphone", "exchange the two plugs"),
        Kind.ALIKE: ("both channels carry the same sound", "switch off direct monitoring and mono mixing"),
    }
)
"""What was found, and what to do, for each kind."""

FAULTS = (
    *(SensorFault(kind, channel) for kind in (Kind.DEAD, Kind.CLIPPED, Kind.OFFSET, Kind.HUM) for channel in (0, 1)),
    SensorFault(Kind.COVERED, AIR),
    SensorFault(Kind.SWAPPED),
    SensorFault(Kind.ALIKE),
)
"""All that can be named."""


@dataclass(frozen=True, slots=True)
class Reference:
    """What a set-up sounded like when it was good; the defaults hold for any set-up, less sharply.

    Parameters
    ----------
    threshold_dbfs
        Contact level over which there is touch.
    floor_dbfs, hum_dbfs
        Level and hum of each channel in silence.
    clipped
        Largest share of clipped samples that is still taken for sound.
    contrast_db
        By how much contact is louder than air, in silence or when stroked, whichever is less; 0 if unknown.
    """

    threshold_dbfs: float = -26.0
    floor_dbfs: tuple[float, ...] = (-70.0, -70.0)
    hum_dbfs: tuple[float, ...] = (-32.0, -32.0)
    clipped: float = 0.3
    contrast_db: float = 0.0


UNCALIBRATED = Reference()

SILENCE_DBFS = -90.0
"""No microphone and preamplifier is so quiet, but three steps of a 16-bit converter are."""

DEAD_DROP_DB = 20.0
"""A room may fall silent, a microphone's own noise may not."""

OFFSET = 0.05
"""Of full scale: -26 dBFS, the level of the paper's contact threshold."""

HUM_RISE_DB = 8.0
"""Over the hum that the set-up always had."""

HARMLESS_HUM_DBFS = -45.0
"""Of this no detector here takes notice."""

ALIKENESS = 0.97
"""Two microphones in one stroke reach 0.9; copies fall short of 1 only by the codec's noise."""

_ELECTRIC = (Kind.DEAD, Kind.CLIPPED, Kind.OFFSET)
_CLEAR_DB = 9.0
_MARGIN_DB = 3.0
_DULLER_DB = 1.0
_STRONG_DB = 6.0


class FaultWatch:
    """Names what is wrong with the microphones, as the sound streams by; the same at any block size.

    Examples
    --------
    >>> import numpy as np
    >>> watch = FaultWatch(48_000, Reference())
    >>> sound = np.random.default_rng(1).normal(0, 0.01, (48_000, 2)).astype(np.float32)
    >>> sound[:, AIR] = 0
    >>> watch.push(AudioBlock(sound, 48_000))
    >>> [fault.code for fault in watch.faults]
    ['air-dead']
    """

    def __init__(self, sample_rate: int, reference: Reference | None = None) -> None:
        self.sample_rate = sample_rate
        self._signs = SignalStatistics(sample_rate)
        self._reference = reference or UNCALIBRATED
        self.reset()

    @property
    def cell_size(self) -> int:
        """Samples between two looks."""
        return self._signs.cell_size

    @property
    def faults(self) -> tuple[SensorFault, ...]:
        """What is wrong now; where both channels are in doubt, nothing is said of one."""
        named = tuple(fault for fault in FAULTS if self._present[fault])
        return tuple(fault for fault in named if fault.channel is None) or named

    def push(self, block: AudioBlock) -> None:
        """Take sound in."""
        for vitals in self._signs.push(block):
            for fault, sign in signs(vitals, self._reference).items():
                self._weigh(fault, sign)

    def reset(self) -> None:
        """Become as new: nothing is known to be wrong."""
        self._signs.reset()
        self._present = dict.fromkeys(FAULTS, False)
        self._streak = dict.fromkeys(FAULTS, 0)

    def _weigh(self, fault: SensorFault, sign: bool | None) -> None:
        if sign is None:
            self._streak[fault] *= self._present[fault]
            return
        self._streak[fault] = 0 if sign is self._present[fault] else self._streak[fault] + 1
        if self._streak[fault] >= (RAISE_AFTER if sign else HEAL_AFTER):
            self._present[fault], self._streak[fault] = sign, 0


def signs(vitals: ChannelStatistics, reference: Reference) -> dict[SensorFault, bool | None]:
    """Look for the sign of each fault; ``None`` where it cannot be seen just now, or another fault hides it."""
    channels = range(len(vitals.level_dbfs))
    if max(vitals.level_dbfs) < SILENCE_DBFS and reference == UNCALIBRATED:
        # Digital silence is how files and paused sources sound, too; only a calibration knows what silence is here.
        return dict.fromkeys(FAULTS)
    found: dict[SensorFault, bool | None] = {}
    for channel in channels:
        dead = vitals.level_dbfs[channel] < SILENCE_DBFS
        clipped = vitals.clipped[channel] > reference.clipped
        found[SensorFault(Kind.DEAD, channel)] = dead
        found[SensorFault(Kind.CLIPPED, channel)] = None if dead else clipped
        found[SensorFault(Kind.OFFSET, channel)] = None if clipped else abs(vitals.offset[channel]) > OFFSET
    paired = len(channels) > 1 and not any(found.values())
    alike = paired and abs(vitals.likeness) > ALIKENESS
    swapped = paired and not alike and _swapped(vitals, reference)
    for channel in channels:
        hidden = alike or swapped or any(found[SensorFault(kind, channel)] for kind in _ELECTRIC)
        found[SensorFault(Kind.HUM, channel)] = None if hidden else _hum(vitals, reference, channel)
        if not hidden:
            found[SensorFault(Kind.DEAD, channel)] = _dead(vitals, reference, channel)
    if len(channels) > 1:
        hidden = alike or swapped or any(found.values())
        found[SensorFault(Kind.ALIKE)] = alike if paired else None
        found[SensorFault(Kind.SWAPPED)] = swapped if paired else None
        found[SensorFault(Kind.COVERED, AIR)] = None if hidden else _covered(vitals, reference)
    return found


def explain(faults: Iterable[SensorFault]) -> str:
    """Say in one line what is wrong."""
    return ". ".join(str(fault) for fault in faults)


def _dead(vitals: ChannelStatistics, reference: Reference, channel: int) -> bool:
    return vitals.level_dbfs[channel] < max(SILENCE_DBFS, reference.floor_dbfs[channel] - DEAD_DROP_DB)


def _hum(vitals: ChannelStatistics, reference: Reference, channel: int) -> bool | None:
    """Hum is there when it stands clear of the noise in its bands, and not there when that noise could not hide it."""
    limit = max(reference.hum_dbfs[channel] + HUM_RISE_DB, HARMLESS_HUM_DBFS)
    hum, masking = vitals.hum_dbfs[channel], vitals.masking_dbfs[channel]
    if hum > limit and hum > masking + _CLEAR_DB:
        return True
    return False if max(hum, masking) < limit else None


def _covered(vitals: ChannelStatistics, reference: Reference) -> bool | None:
    """The air microphone falls under its floor; or a touch leaves it there, or reaches it as a thud only.

    A thud is duller than what the contact microphone makes of the same touch.
    """
    touch_db = vitals.level_dbfs[CONTACT] - reference.threshold_dbfs
    heard_db = vitals.level_dbfs[AIR] - reference.floor_dbfs[AIR]
    # A room may have become quieter since it was calibrated; but not while something in it is touched.
    if heard_db < (-_MARGIN_DB if touch_db > 0 else -_CLEAR_DB):
        return True
    if touch_db < _STRONG_DB:
        return None
    fainter = vitals.level_dbfs[AIR] < vitals.level_dbfs[CONTACT] - _STRONG_DB
    return heard_db < _MARGIN_DB or (fainter and vitals.tilt_db(AIR) < vitals.tilt_db(CONTACT))


def _swapped(vitals: ChannelStatistics, reference: Reference) -> bool:
    """Besides hum, of which either can have too much, channel 1 is the louder one, where it never was or is the duller.

    Without a calibration the gains could be such that air is louder, so there it must sound like contact, too.
    """
    contact, air = (_without_hum(vitals, channel) for channel in (CONTACT, AIR))
    if air < contact + _MARGIN_DB:
        return False
    duller = vitals.treble_dbfs[AIR] - air < vitals.treble_dbfs[CONTACT] - contact - _DULLER_DB
    return duller or reference.contrast_db > _CLEAR_DB


def _without_hum(vitals: ChannelStatistics, channel: int) -> float:
    power = 10 ** (vitals.level_dbfs[channel] / 10) - 10 ** (vitals.hum_dbfs[channel] / 10)
    # A hundredth of the hum escapes its bands: what is under that is not told from it.
    return 10 * math.log10(max(power, 0.02 * 10 ** (vitals.level_dbfs[channel] / 10)))
