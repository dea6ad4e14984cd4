"""Sensor faults at run time: a fault is reported when its sign persists in the signal statistics.

A contact microphone measures force, an air microphone acceleration: so contact sound is the louder and the duller of
the two at the gains of any sensible set-up. That order reveals swapped microphones and a covered one. A sign is
present, absent or hidden (hum under a loud stroke; a covered microphone in silence): a hidden one neither raises a
fault nor ends it.
"""

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tactophone.perception.sensor_health.signal_statistics import ChannelStatistics, SignalStatistics
from tactophone.types import AIR, CONTACT, AudioBlock

RAISE_AFTER = 3
"""Consecutive measures with the sign: with the half second that each covers, a fault is reported within 0.875 s."""

HEAL_AFTER = 8
"""Consecutive measures without it: a second, so that a loose plug does not flicker."""


class FaultKind(enum.StrEnum):
    """What can be wrong with a microphone."""

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

    >>> print(SensorFault(FaultKind.DEAD, AIR))
    air microphone dead: no sound comes from it; check its plug, cable and supply
    """

    kind: FaultKind
    channel: int | None = None

    @property
    def code(self) -> str:
        """For programs: ``air-dead``."""
        return str(self.kind) if self.channel is None else f"{MICROPHONES[self.channel]}-{self.kind}"

    def __str__(self) -> str:
        sign, remedy = _MESSAGES[self.kind]
        subject = "microphones" if self.channel is None else f"{MICROPHONES[self.channel]} microphone"
        return f"{subject} {self.kind.replace('offset', 'off centre')}: {sign}; {remedy}"


MICROPHONES = ("contact", "air")

_MESSAGES: Mapping[FaultKind, tuple[str, str]] = MappingProxyType(
    {
        FaultKind.DEAD: ("no sound comes from it", "check its plug, cable and supply"),
        FaultKind.CLIPPED: ("its loud parts are cut off", "turn its gain down"),
        FaultKind.OFFSET: ("its sound has a constant part (DC)", "check the interface's coupling and the supply"),
        FaultKind.HUM: ("mains hum stands out from its noise", "mend its shield or ground, keep away from supplies"),
        FaultKind.COVERED: (
            "a touch that the contact microphone picks up hardly reaches it",
            "open the case or clear its port",
        ),
        FaultKind.SWAPPED: ("channel 1 sounds like the contact microphone", "exchange the two plugs"),
        FaultKind.ALIKE: ("both channels carry the same sound", "switch off direct monitoring and mono mixing"),
    }
)
"""The sign and the remedy of each kind."""

FAULTS = (
    *(
        SensorFault(kind, channel)
        for kind in (FaultKind.DEAD, FaultKind.CLIPPED, FaultKind.OFFSET, FaultKind.HUM)
        for channel in (0, 1)
    ),
    SensorFault(FaultKind.COVERED, AIR),
    SensorFault(FaultKind.SWAPPED),
    SensorFault(FaultKind.ALIKE),
)
"""All faults that can be reported."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Levels of a set-up without faults; the defaults hold for any set-up, less sharply."""

    threshold_dbfs: float = -26.0
    """Level of the contact channel from which there is contact."""
    floor_dbfs: tuple[float, ...] = (-70.0, -70.0)
    hum_dbfs: tuple[float, ...] = (-32.0, -32.0)
    """`floor_dbfs` and `hum_dbfs`: level and hum of each channel in silence."""
    clipped: float = 0.3
    """Largest share of clipped samples that is no fault."""
    contrast_db: float = 0.0
    """By how much contact is louder than air, in silence or during a stroke, whichever is less; 0 if unknown."""


UNCALIBRATED = Reference()

SILENCE_DBFS = -90.0
"""No microphone and preamplifier is so quiet, but three steps of a 16-bit converter are."""

DEAD_DROP_DB = 20.0
"""Under the calibrated floor: a room may fall silent, but a microphone's own noise does not."""

OFFSET = 0.05
"""Of full scale: -26 dBFS, the level of the paper's contact threshold."""

HUM_RISE_DB = 8.0
"""Over the hum of the set-up at its calibration."""

HARMLESS_HUM_DBFS = -45.0
"""Hum under this changes no prediction."""

MAX_CORRELATION = 0.97
"""Two microphones on one stroke reach 0.9; copies fall short of 1 only by the codec's noise."""

_ELECTRIC = (FaultKind.DEAD, FaultKind.CLIPPED, FaultKind.OFFSET)
_CLEAR_DB = 9.0
_MARGIN_DB = 3.0
_DULLER_DB = 1.0
_STRONG_DB = 6.0


class FaultDetector:
    """Finds faults of the microphones in a stream of sound; the same at any block size.

    Attributes
    ----------
    faults
        Present now. Read at every block, found at every eighth of a second.

    Examples
    --------
    >>> import numpy as np
    >>> detector = FaultDetector(48_000, Reference())
    >>> sound = np.random.default_rng(1).normal(0, 0.01, (48_000, 2)).astype(np.float32)
    >>> sound[:, AIR] = 0
    >>> detector.push(AudioBlock(sound, 48_000))
    >>> [fault.code for fault in detector.faults]
    ['air-dead']
    """

    def __init__(self, sample_rate: int, reference: Reference | None = None) -> None:
        self.sample_rate = sample_rate
        self._statistics = SignalStatistics(sample_rate)
        self._reference = reference or UNCALIBRATED
        self.faults: tuple[SensorFault, ...] = ()
        self.reset()

    @property
    def cell_size(self) -> int:
        """Samples between two measures."""
        return self._statistics.cell_size

    def push(self, block: AudioBlock) -> None:
        """Take sound."""
        for statistics in self._statistics.push(block):
            for fault, sign in find_signs(statistics, self._reference).items():
                self._update(fault, sign)
            # Where one concerns both channels, those of single channels are left out.
            present = tuple(fault for fault in FAULTS if self._present[fault])
            self.faults = tuple(fault for fault in present if fault.channel is None) or present

    def reset(self) -> None:
        """Return to the initial state: no faults."""
        self._statistics.reset()
        self.faults = ()
        self._present = dict.fromkeys(FAULTS, False)
        self._streak = dict.fromkeys(FAULTS, 0)

    def _update(self, fault: SensorFault, sign: bool | None) -> None:
        """Count measures that contradict the present state; enough of them in a row change it."""
        if sign is None:
            # A hidden sign breaks the row towards a fault, but not the row towards its end.
            self._streak[fault] *= self._present[fault]
            return
        self._streak[fault] = 0 if sign is self._present[fault] else self._streak[fault] + 1
        if self._streak[fault] >= (RAISE_AFTER if sign else HEAL_AFTER):
            self._present[fault], self._streak[fault] = sign, 0


def find_signs(statistics: ChannelStatistics, reference: Reference) -> dict[SensorFault, bool | None]:
    """Return whether the sign of each fault is present; ``None`` where it is hidden by the sound or another fault."""
    channels = range(len(statistics.level_dbfs))
    if max(statistics.level_dbfs) < SILENCE_DBFS and reference == UNCALIBRATED:
        # Files and paused sources are digital silence too; only a calibration gives the level of silence here.
        return dict.fromkeys(FAULTS)
    found: dict[SensorFault, bool | None] = {}
    for channel in channels:
        dead = statistics.level_dbfs[channel] < SILENCE_DBFS
        clipped = statistics.clipped[channel] > reference.clipped
        found[SensorFault(FaultKind.DEAD, channel)] = dead
        found[SensorFault(FaultKind.CLIPPED, channel)] = None if dead else clipped
        found[SensorFault(FaultKind.OFFSET, channel)] = None if clipped else abs(statistics.offset[channel]) > OFFSET
    paired = len(channels) > 1 and not any(found.values())
    alike = paired and abs(statistics.correlation) > MAX_CORRELATION
    swapped = paired and not alike and _swapped(statistics, reference)
    for channel in channels:
        hidden = alike or swapped or any(found[SensorFault(kind, channel)] for kind in _ELECTRIC)
        found[SensorFault(FaultKind.HUM, channel)] = None if hidden else _hum(statistics, reference, channel)
        if not hidden:
            alive_from = max(SILENCE_DBFS, reference.floor_dbfs[channel] - DEAD_DROP_DB)
            found[SensorFault(FaultKind.DEAD, channel)] = statistics.level_dbfs[channel] < alive_from
    if len(channels) > 1:
        hidden = alike or swapped or any(found.values())
        found[SensorFault(FaultKind.ALIKE)] = alike if paired else None
        found[SensorFault(FaultKind.SWAPPED)] = swapped if paired else None
        found[SensorFault(FaultKind.COVERED, AIR)] = None if hidden else _covered(statistics, reference)
    return found


def _hum(statistics: ChannelStatistics, reference: Reference, channel: int) -> bool | None:
    """Hum is present when it is clear of the noise in its bands, and absent when that noise could not hide it."""
    limit = max(reference.hum_dbfs[channel] + HUM_RISE_DB, HARMLESS_HUM_DBFS)
    hum, masking = statistics.hum_dbfs[channel], statistics.masking_dbfs[channel]
    if hum > limit and hum > masking + _CLEAR_DB:
        return True
    return False if max(hum, masking) < limit else None


def _covered(statistics: ChannelStatistics, reference: Reference) -> bool | None:
    """Whether the air microphone is under its floor, or a touch leaves it there or reaches it only as a thud.

    A thud is duller than the same touch on the contact microphone: by 1.9 dB at least over simulated objects, while a
    free microphone is brighter, or on a glazed tile up to 0.4 dB duller.
    """
    touch_db = statistics.level_dbfs[CONTACT] - reference.threshold_dbfs
    air_db = statistics.level_dbfs[AIR] - reference.floor_dbfs[AIR]
    # A room may have become quieter since it was calibrated; but not while something in it is touched.
    if air_db < (-_MARGIN_DB if touch_db > 0 else -_CLEAR_DB):
        return True
    if touch_db < _STRONG_DB:
        return None
    fainter = statistics.level_dbfs[AIR] < statistics.level_dbfs[CONTACT] - _STRONG_DB
    return air_db < _MARGIN_DB or (fainter and statistics.tilt_db(AIR) < statistics.tilt_db(CONTACT) - _DULLER_DB)


def _swapped(statistics: ChannelStatistics, reference: Reference) -> bool:
    """Whether channel 1, without hum, is the louder one, and is also duller or was never the louder one at calibration.

    Without a calibration the gains could be such that air is louder, so there it must also be duller, as contact is.
    """
    contact, air = (_without_hum(statistics, channel) for channel in (CONTACT, AIR))
    if air < contact + _MARGIN_DB:
        return False
    duller = statistics.treble_dbfs[AIR] - air < statistics.treble_dbfs[CONTACT] - contact - _DULLER_DB
    return duller or reference.contrast_db > _CLEAR_DB


def _without_hum(statistics: ChannelStatistics, channel: int) -> float:
    power = 10 ** (statistics.level_dbfs[channel] / 10) - 10 ** (statistics.hum_dbfs[channel] / 10)
    # A hundredth of the hum escapes its bands: the rest must be above that to be anything else.
    return 10 * math.log10(max(power, 0.02 * 10 ** (statistics.level_dbfs[channel] / 10)))
