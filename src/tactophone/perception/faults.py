"""Sensor faults at run time: each sign is looked for in the vitals, and a fault is named when its sign persists.

A contact microphone feels force, an air microphone hears acceleration: so contact sound is the louder and the duller of
the two at the gains of any sensible set-up. That order is what tells swapped microphones and a covered one. A sign is
there, not there, or cannot be seen (hum under a loud stroke; a covered microphone in silence): what cannot be seen
neither raises a fault nor ends it.
"""

import enum
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tactophone.perception.vitals import Vitals, VitalSigns
from tactophone.types import AIR, CONTACT, AudioBlock

RAISE_AFTER = 2
"""Measures in a row with the sign: with the half second that each looks back, a fault is named within 0.75 s."""

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
        return self.kind if self.channel is None else f"{CHANNELS[self.channel]}-{self.kind}"

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
    """

    threshold_dbfs: float = -26.0
    floor_dbfs: tuple[float, ...] = (-70.0, -70.0)
    hum_dbfs: tuple[float, ...] = (-32.0, -32.0)
    clipped: float = 0.05


SILENCE_DBFS = -90.0
"""No microphone and preamplifier is so quiet, but three steps of a 16-bit converter are."""

DEAD_DROP_DB = 20.0
"""A room may fall silent, a microphone's own noise may not."""

OFFSET = 0.05
"""Of full scale: -26 dBFS, the level of the paper's contact threshold."""

HUM_RISE_DB = 8.0
"""Over the hum that the set-up always had."""

ALIKENESS = 0.97
"""Two microphones in one stroke reach 0.9; copies fall short of 1 only by the codec's noise."""

_CLEAR_DB = 9.0
_MARGIN_DB = 3.0
_STRONG_DB = 10.0


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
        self._signs = VitalSigns(sample_rate)
        self._reference = reference or Reference()
        self.reset()

    @property
    def cell_size(self) -> int:
        """Samples between two looks."""
        return self._signs.cell_size

    @property
    def faults(self) -> tuple[SensorFault, ...]:
        """What is wrong now, worst known first by kind."""
        return tuple(fault for fault in FAULTS if self._present[fault])

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
            return
        self._streak[fault] = 0 if sign is self._present[fault] else self._streak[fault] + 1
        if self._streak[fault] >= (RAISE_AFTER if sign else HEAL_AFTER):
            self._present[fault], self._streak[fault] = sign, 0


def signs(vitals: Vitals, reference: Reference) -> dict[SensorFault, bool | None]:
    """Look for the sign of each fault; ``None`` where it cannot be seen just now."""
    channels = range(len(vitals.level_dbfs))
    dead = [_dead(vitals, reference, channel) for channel in channels]
    found: dict[SensorFault, bool | None] = {}
    for channel in channels:
        found[SensorFault(Kind.DEAD, channel)] = dead[channel]
        for kind, look in _ALONE.items():
            found[SensorFault(kind, channel)] = None if dead[channel] else look(vitals, reference, channel)
    if len(channels) > 1:
        seen = not any(dead)
        found[SensorFault(Kind.COVERED, AIR)] = _covered(vitals, reference) if seen else None
        found[SensorFault(Kind.SWAPPED)] = _swapped(vitals) if seen else None
        found[SensorFault(Kind.ALIKE)] = abs(vitals.likeness) > ALIKENESS if seen else None
    return found


def explain(faults: Iterable[SensorFault]) -> str:
    """Say in one line what is wrong."""
    return ". ".join(str(fault) for fault in faults)


def _dead(vitals: Vitals, reference: Reference, channel: int) -> bool:
    return vitals.level_dbfs[channel] < max(SILENCE_DBFS, reference.floor_dbfs[channel] - DEAD_DROP_DB)


def _clipped(vitals: Vitals, reference: Reference, channel: int) -> bool:
    return vitals.clipped[channel] > reference.clipped


def _offset(vitals: Vitals, _: Reference, channel: int) -> bool:
    return abs(vitals.offset[channel]) > OFFSET


def _hum(vitals: Vitals, reference: Reference, channel: int) -> bool | None:
    """Hum is there when it stands clear of the noise in its bands, and not there when that noise could not hide it."""
    limit = reference.hum_dbfs[channel] + HUM_RISE_DB
    hum, masking = vitals.hum_dbfs[channel], vitals.masking_dbfs[channel]
    if hum > limit and hum > masking + _CLEAR_DB:
        return True
    return False if max(hum, masking) < limit else None


_ALONE: Mapping[Kind, Callable[[Vitals, Reference, int], bool | None]] = MappingProxyType(
    {Kind.CLIPPED: _clipped, Kind.OFFSET: _offset, Kind.HUM: _hum}
)


def _covered(vitals: Vitals, reference: Reference) -> bool | None:
    """In a strong touch the air microphone stays at its floor, or hears a thud duller than the contact microphone."""
    contact, air = vitals.level_dbfs[CONTACT], vitals.level_dbfs[AIR]
    if contact < reference.threshold_dbfs + _STRONG_DB:
        return None
    deaf = air < reference.floor_dbfs[AIR] + _MARGIN_DB
    dull = air < contact - 2 * _MARGIN_DB and vitals.tilt_db(AIR) < vitals.tilt_db(CONTACT)
    return deaf or dull


def _swapped(vitals: Vitals) -> bool:
    louder = vitals.level_dbfs[AIR] > vitals.level_dbfs[CONTACT] + _MARGIN_DB
    return louder and vitals.tilt_db(AIR) < vitals.tilt_db(CONTACT) - _MARGIN_DB
