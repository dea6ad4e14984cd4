"""Health of the microphones: statistics of each signal, and the faults that show in
them.

Statistics are half a second of sound in a few numbers, eight times a second. Everything
is measured under 4 kHz, on sound averaged down to about 8 kHz, so that a codec's
bandwidth does not change it; only clipping is measured on the original sound. Measures
lie on a fixed grid of cells, whatever the block size.

A fault is reported when its sign persists in the statistics. A contact microphone
measures force, an air microphone acceleration: so contact sound is the louder and the
duller of the two at the gains of any sensible set-up. That order reveals swapped
microphones and a covered one. A sign is present, absent or hidden (hum under a loud
stroke; a covered microphone in silence): a hidden one neither raises a fault nor ends
it.
"""

import enum
import functools
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.core.microphones import AIR, CONTACT, MICROPHONES, check_channels
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.signal.perception.levels import mean_of_neighbours

HEALTH_CELL = 0.125
"""Seconds between two measures."""

CELLS = 4
"""Cells that a measure covers: half a second separates 50 Hz from 60 Hz and holds
several strokes of a wiggle."""

MAINS = (50, 60)
"""Hz."""

FAINTEST_DBFS = -150.0
"""Level of digital silence: under the last bit of any converter, and still finite."""

_BASS_RATE = 1000
_TREBLE_STEPS = 8
TREBLE_LOWEST_RATE = _BASS_RATE * _TREBLE_STEPS
"""Hz, of sound that can be measured."""
_HARMONICS = 7
FULL_SCALE = 0.999
"""From here a sample is at full scale; the page's lamps have the same figure
(``faces/web/static/meter.js``)."""

FAULT_CLIPPED_SHARE = 5e-3
"""A recording is clipped when more than this share of one channel is: more than single
peaks of hard strokes."""

_LOUD = 0.1
"""From here equal neighbours are flat against a rail: in quiet sound of few bits they
are common."""

_LARGEST = 4
"""Samples are limited to so many times full scale before they are measured."""


class ChannelStatistics(msgspec.Struct, frozen=True):
    """Half a second of sound in numbers; one entry a channel where there are
    several."""

    end: float
    """Seconds since the stream began."""
    level_dbfs: tuple[float, ...]
    treble_dbfs: tuple[float, ...]
    """`level_dbfs` and `treble_dbfs`: RMS without the mean, and that of the difference
    of neighbours at 8 kHz, which weighs 1 to 4 kHz most."""
    offset: tuple[float, ...]
    """The mean (DC), of full scale."""
    clipped: tuple[float, ...]
    """Share of samples at full scale or flat against a rail."""
    hum_dbfs: tuple[float, ...]
    masking_dbfs: tuple[float, ...]
    """`hum_dbfs` and `masking_dbfs`: RMS of the mains' harmonics, and of the noise in
    the same narrow bands, which can hide hum of that level."""
    mains: int
    """50 or 60, whichever has more power in its harmonics, in Hz."""
    correlation: float
    """Correlation of the two channels' treble, -1 to 1; 0 with one channel."""

    def tilt_db(self, channel: int) -> float:
        """Brightness of a channel: treble over level, in dB; independent of gain."""
        return self.treble_dbfs[channel] - self.level_dbfs[channel]


class SignalStatistics:
    """Measures a stream: blocks of any size in, a :class:`ChannelStatistics` out at
    each full cell.

    >>> statistics = SignalStatistics(48_000)
    >>> tone = np.sin(2 * np.pi * 50 * np.arange(48_000) / 48_000).astype(np.float32)
    >>> sound = np.stack([tone, 0 * tone], axis=1) / 2
    >>> measured = statistics.push(AudioBlock(sound, 48_000))
    >>> len(measured), round(measured[-1].hum_dbfs[0], 1), measured[-1].mains
    (5, -9.1, 50)
    """

    def __init__(self, sample_rate: int) -> None:
        self._rate = sample_rate
        self._decimation = max(1, sample_rate // TREBLE_LOWEST_RATE)
        self.cell_size = (
            round(HEALTH_CELL * _BASS_RATE) * _TREBLE_STEPS * self._decimation
        )
        self.reset()

    def push(self, block: AudioBlock) -> list[ChannelStatistics]:
        """Take sound; return the measures that it completes, oldest first."""
        measured = []
        rest = block.samples
        while len(rest):
            taken = min(self.cell_size - self._filled, len(rest))
            self._parts.append(rest[:taken])
            self._filled += taken
            rest = rest[taken:]
            if self._filled == self.cell_size:
                measured.extend(self._close(block.end - len(rest)))
        return measured

    def reset(self) -> None:
        self._parts: list[FloatArray] = []
        self._filled = 0
        self._decimated: deque[NDArray[np.float64]] = deque(maxlen=CELLS)
        self._clipped: deque[NDArray[np.float64]] = deque(maxlen=CELLS)

    def _close(self, end: int) -> list[ChannelStatistics]:
        # Channels first from here on: a sum over rows of two numbers takes ten times as
        # long as one along a row.
        cell = np.ascontiguousarray(np.concatenate(self._parts).T)
        self._parts = []
        self._filled = 0
        peak = np.abs(cell).max()
        self._clipped.append(
            clipped_samples(cell).mean(axis=1) if peak > _LOUD else np.zeros(len(cell))
        )
        if peak > _LARGEST:
            cell = cell.clip(-_LARGEST, _LARGEST)
        finite = cell.astype(np.float64)
        self._decimated.append(mean_of_neighbours(finite, self._decimation))
        if len(self._decimated) < CELLS:
            return []
        sound = np.concatenate(self._decimated, axis=1)
        clipped = np.mean(self._clipped, axis=0)
        return [
            _measure(
                sound, clipped, rate=self._rate / self._decimation, end=end / self._rate
            )
        ]


def _measure(
    sound: NDArray[np.float64], clipped: NDArray[np.float64], *, rate: float, end: float
) -> ChannelStatistics:
    """Measure sound of shape ``(channels, samples)``."""
    treble = np.diff(sound)
    hums, maskings = _hum_powers(sound, rate / _TREBLE_STEPS)
    stronger = int(hums.max(axis=1).argmax())
    return ChannelStatistics(
        end,
        level_dbfs=_dbfs(sound.var(axis=1)),
        treble_dbfs=_dbfs(np.vecdot(treble, treble) / treble.shape[1]),
        offset=tuple(sound.mean(axis=1).tolist()),
        clipped=tuple(clipped.tolist()),
        hum_dbfs=_dbfs(hums[stronger]),
        masking_dbfs=_dbfs(maskings[stronger]),
        mains=MAINS[stronger],
        correlation=_correlation(treble),
    )


def clipped_samples(sound: FloatArray) -> NDArray[np.bool_]:
    """Return which samples are at full scale or flat against a rail, of sound and in
    shape ``(channels, samples)``."""
    loud = np.abs(sound)
    railed: NDArray[np.bool_] = loud >= FULL_SCALE
    railed[:, 1:] |= (sound[:, 1:] == sound[:, :-1]) & (loud[:, 1:] > _LOUD)
    return railed


def _hum_powers(
    sound: NDArray[np.float64], rate: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the power of each mains' harmonics, and of the noise in their bands; shape
    ``(mains, channels)`` each."""
    bass = mean_of_neighbours(sound, _TREBLE_STEPS)
    size = bass.shape[1]
    taper, tones, noises = _harmonics(size, rate)
    # The main lobe of a Hann window, three bins, holds all but 0.1 % of a tone;
    # one-sided, so twice its power.
    power = (
        2
        * np.abs(np.fft.rfft((bass - bass.mean(axis=1)[:, None]) * taper)) ** 2
        / (size * (taper**2).sum())
    )
    # The median of a noise bin's power, exponentially distributed, is its mean times ln
    # 2. Of an even number of bins it is the mean of the two in the middle; `np.median`
    # for each band takes ten times as long.
    middle = noises.shape[-1] // 2
    medians = np.sort(power[:, noises])[..., middle - 1 : middle + 1].mean(axis=-1)
    noise = 3 * medians / np.log(2)
    total = np.maximum(power[:, tones].sum(axis=-1) - noise, 0.0).sum(axis=-1)
    return total.T, noise.sum(axis=-1).T


@functools.cache
def _harmonics(
    size: int, rate: float
) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.intp]]:
    """Return a taper, ``(size,)``, and the bins of tones and of noise, ``(mains,
    harmonics, bins)`` each."""
    centres = np.array(
        [
            [round(n * mains * size / rate) for n in range(1, _HARMONICS + 1)]
            for mains in MAINS
        ]
    )
    noises = [*range(-7, -2), *range(3, 8)]
    return (
        np.hanning(size + 1)[:-1],
        centres[..., None] + [-1, 0, 1],
        centres[..., None] + noises,
    )


def _correlation(treble: NDArray[np.float64]) -> float:
    if len(treble) < 2:
        return 0.0
    contact = treble[CONTACT]
    air = treble[AIR]
    scale = math.sqrt(np.vecdot(contact, contact) * np.vecdot(air, air))
    return float(np.vecdot(contact, air)) / scale if scale > 0 else 0.0


def _dbfs(power: NDArray[np.float64]) -> tuple[float, ...]:
    return tuple(
        (10 * np.log10(np.maximum(power, 10 ** (FAINTEST_DBFS / 10)))).tolist()
    )


RAISE_AFTER = 3
"""Consecutive measures with the sign: with the half second that each covers, a fault is
reported within 0.875 s."""

HEAL_AFTER = 8
"""Consecutive measures without it: a second, so that a loose plug does not flicker."""


class FaultKind(enum.StrEnum):
    """What can be wrong with a microphone."""

    DEAD = "dead"
    OPEN = "open"
    CLIPPED = "clipped"
    OFFSET = "offset"
    HUM = "hum"
    COVERED = "covered"
    SWAPPED = "swapped"
    ALIKE = "alike"


class SensorFault(msgspec.Struct, frozen=True, order=True):
    """A fault and the channel that has it; ``SWAPPED`` and ``ALIKE`` concern both.

    >>> print(SensorFault(FaultKind.DEAD, AIR))
    air microphone dead: no sound comes from it; check its plug, cable and supply
    """

    kind: FaultKind
    channel: int | None = None

    @property
    def code(self) -> str:
        """For programs: ``air-dead``."""
        return (
            str(self.kind)
            if self.channel is None
            else f"{MICROPHONES[self.channel]}-{self.kind}"
        )

    def __str__(self) -> str:
        sign, remedy = _MESSAGES[self.kind]
        subject = (
            "microphones"
            if self.channel is None
            else f"{MICROPHONES[self.channel]} microphone"
        )
        return (
            f"{subject} {self.kind.replace('offset', 'off centre')}: {sign}; {remedy}"
        )


_MESSAGES: Mapping[FaultKind, tuple[str, str]] = MappingProxyType(
    {
        FaultKind.DEAD: ("no sound comes from it", "check its plug, cable and supply"),
        FaultKind.OPEN: (
            "nothing but an input's own noise comes from it while the other sounds",
            "plug it in, or choose one input",
        ),
        FaultKind.CLIPPED: ("its loud parts are cut off", "turn its gain down"),
        FaultKind.OFFSET: (
            "its sound has a constant part (DC)",
            "check the interface's coupling and the supply",
        ),
        FaultKind.HUM: (
            "mains hum stands out from its noise",
            "mend its shield or ground, keep away from supplies",
        ),
        FaultKind.COVERED: (
            "a touch that the contact microphone picks up hardly reaches it",
            "open the case or clear its port",
        ),
        FaultKind.SWAPPED: (
            "input 2 (air) sounds like the contact microphone",
            "exchange the two plugs",
        ),
        FaultKind.ALIKE: (
            "both channels carry the same sound",
            "switch off direct monitoring and mono mixing",
        ),
    }
)
"""The sign and the remedy of each kind."""

FAULTS = (
    *(
        SensorFault(kind, channel)
        for kind in (
            FaultKind.DEAD,
            FaultKind.OPEN,
            FaultKind.CLIPPED,
            FaultKind.OFFSET,
            FaultKind.HUM,
        )
        for channel in (0, 1)
    ),
    SensorFault(FaultKind.COVERED, AIR),
    SensorFault(FaultKind.SWAPPED),
    SensorFault(FaultKind.ALIKE),
)
"""All faults that can be reported."""


@dataclass(frozen=True, slots=True)
class Reference:
    """Levels of a set-up without faults; the defaults hold for any set-up, less
    sharply."""

    threshold_dbfs: float = -26.0
    """Level of the contact channel from which there is contact."""
    floor_dbfs: tuple[float, ...] = (-70.0, -70.0)
    hum_dbfs: tuple[float, ...] = (-32.0, -32.0)
    """`floor_dbfs` and `hum_dbfs`: level and hum of each channel in silence."""
    clipped: float = 0.3
    """Largest share of clipped samples that is no fault."""
    contrast_db: float = 0.0
    """By how much contact is louder than air, in silence or during a stroke, whichever
    is less; 0 if unknown."""


UNCALIBRATED = Reference()

DEAD_DBFS = -90.0
"""No microphone and preamplifier is so quiet, but three steps of a 16-bit converter
are."""

OPEN_DBFS = -78.0
"""Level, under 4 kHz, that an input without a microphone stays under: converters and
preamplifiers have noise of -80 to -120 dBFS. A microphone beside a touch is louder: the
quieter of a simulated pair has -54 dBFS at least."""

OPEN_CONTRAST_DB = 30.0
"""By how much the other microphone has to be louder before an input that stays under
`OPEN_DBFS` is open: in a quiet room a working microphone may be as quiet. Two simulated
microphones on one touch differ by 19 dB at most."""

DEAD_DROP_DB = 20.0
"""Under the calibrated floor: a room may fall silent, but a microphone's own noise does
not."""

FAULT_OFFSET = 0.05
"""Of full scale: -26 dBFS, the level of the paper's contact threshold."""

HUM_RISE_DB = 8.0
"""Over the hum of the set-up at its calibration."""

HARMLESS_HUM_DBFS = -45.0
"""Hum under this changes no prediction."""

MAX_CORRELATION = 0.97
"""Two microphones on one stroke reach 0.9; copies fall short of 1 only by the codec's
noise."""

_ELECTRIC = (FaultKind.DEAD, FaultKind.CLIPPED, FaultKind.OFFSET)
_CLEAR_DB = 9.0
_MARGIN_DB = 3.0
_DULLER_DB = 1.0
_STRONG_DB = 6.0


class FaultDetector:
    """Finds faults of the microphones in a stream of sound; the same at any block size.

    Sound that was lost is passed over: what comes next is measured together with what
    came before.

    - ``faults``: present now. Read at every block, found at every eighth of a second.
    - ``calibrated``: whether there is a reference, so that each microphone is known to
      have been there.
    - ``sounding``: channels that the newest measure heard more of than an open input's
      noise.

    >>> import numpy as np
    >>> detector = FaultDetector(48_000, Reference())
    >>> sound = np.random.default_rng(1).normal(0, 0.01, (48_000, 2)).astype(np.float32)
    >>> sound[:, AIR] = 0
    >>> detector.push(AudioBlock(sound, 48_000))
    True
    >>> [fault.code for fault in detector.faults]
    ['air-dead']
    """

    def __init__(self, sample_rate: int, reference: Reference | None = None) -> None:
        self.sample_rate = sample_rate
        self._statistics = SignalStatistics(sample_rate)
        self._reference = reference or UNCALIBRATED
        self.calibrated = self._reference != UNCALIBRATED
        self.faults: tuple[SensorFault, ...] = ()
        self.sounding: frozenset[int] = frozenset()
        self.reset()

    @property
    def cell_size(self) -> int:
        return self._statistics.cell_size

    def push(self, block: AudioBlock) -> bool:
        """Take sound; return whether it completed a measure. Raises `ModelError` at
        over two channels."""
        check_channels(block.channels)
        measured = self._statistics.push(block)
        for statistics in measured:
            for fault, sign in find_signs(statistics, self._reference).items():
                self._update(fault, sign)
            self.sounding = frozenset(
                channel
                for channel, level_dbfs in enumerate(statistics.level_dbfs)
                if level_dbfs >= OPEN_DBFS
            )
            # Where one concerns both channels, those of single channels are left out.
            present = tuple(fault for fault in FAULTS if self._present[fault])
            self.faults = (
                tuple(fault for fault in present if fault.channel is None) or present
            )
        return bool(measured)

    def reset(self) -> None:
        """Return to the initial state: no faults."""
        self.restart()
        self.faults = ()
        self._present = dict.fromkeys(FAULTS, False)
        self._streak = dict.fromkeys(FAULTS, 0)

    def restart(self) -> None:
        """Begin another stream of the same microphones: their faults stay known until
        it shows that they have healed."""
        self._statistics.reset()
        self.sounding = frozenset()

    def _update(self, fault: SensorFault, sign: bool | None) -> None:
        """Count measures that contradict the present state; enough of them in a row
        change it."""
        if sign is None:
            # A hidden sign breaks the row towards a fault, but not the row towards its
            # end.
            self._streak[fault] *= self._present[fault]
            return
        self._streak[fault] = (
            0 if sign is self._present[fault] else self._streak[fault] + 1
        )
        if self._streak[fault] >= (RAISE_AFTER if sign else HEAL_AFTER):
            self._present[fault], self._streak[fault] = sign, 0


def find_signs(
    statistics: ChannelStatistics, reference: Reference
) -> dict[SensorFault, bool | None]:
    """Return whether the sign of each fault is present; ``None`` where it is hidden by
    the sound or another fault."""
    channels = range(len(statistics.level_dbfs))
    if max(statistics.level_dbfs) < DEAD_DBFS and reference == UNCALIBRATED:
        # Files and paused sources are digital silence too; only a calibration gives the
        # level of silence here.
        return dict.fromkeys(FAULTS)
    found: dict[SensorFault, bool | None] = {}
    for channel in channels:
        dead = statistics.level_dbfs[channel] < DEAD_DBFS
        clipped = statistics.clipped[channel] > reference.clipped
        found[SensorFault(FaultKind.DEAD, channel)] = dead
        found[SensorFault(FaultKind.OPEN, channel)] = (
            None if dead else _open(statistics, channel)
        )
        found[SensorFault(FaultKind.CLIPPED, channel)] = None if dead else clipped
        found[SensorFault(FaultKind.OFFSET, channel)] = (
            None if clipped else abs(statistics.offset[channel]) > FAULT_OFFSET
        )
    paired = len(channels) > 1 and not any(found.values())
    alike = paired and abs(statistics.correlation) > MAX_CORRELATION
    swapped = paired and not alike and _swapped(statistics, reference)
    for channel in channels:
        hidden = (
            alike
            or swapped
            or any(found[SensorFault(kind, channel)] for kind in _ELECTRIC)
        )
        found[SensorFault(FaultKind.HUM, channel)] = (
            None if hidden else _shows_hum(statistics, reference, channel)
        )
        if not hidden:
            alive_from = max(DEAD_DBFS, reference.floor_dbfs[channel] - DEAD_DROP_DB)
            found[SensorFault(FaultKind.DEAD, channel)] = (
                statistics.level_dbfs[channel] < alive_from
            )
    if len(channels) > 1:
        hidden = alike or swapped or any(found.values())
        found[SensorFault(FaultKind.ALIKE)] = alike if paired else None
        found[SensorFault(FaultKind.SWAPPED)] = swapped if paired else None
        found[SensorFault(FaultKind.COVERED, AIR)] = (
            None if hidden else _covered(statistics, reference)
        )
    return found


def _open(statistics: ChannelStatistics, channel: int) -> bool | None:
    """Whether an input gives nothing but its own noise while the other one sounds;
    hidden while both are quiet."""
    levels_dbfs = statistics.level_dbfs
    if levels_dbfs[channel] >= OPEN_DBFS:
        return False
    if max(levels_dbfs) >= levels_dbfs[channel] + OPEN_CONTRAST_DB:
        return True
    return None


def _shows_hum(
    statistics: ChannelStatistics, reference: Reference, channel: int
) -> bool | None:
    """Hum is present when it is clear of the noise in its bands, and absent when that
    noise could not hide it."""
    limit = max(reference.hum_dbfs[channel] + HUM_RISE_DB, HARMLESS_HUM_DBFS)
    hum = statistics.hum_dbfs[channel]
    masking = statistics.masking_dbfs[channel]
    if hum > limit and hum > masking + _CLEAR_DB:
        return True
    return False if max(hum, masking) < limit else None


def _covered(statistics: ChannelStatistics, reference: Reference) -> bool | None:
    """Whether the air microphone is under its floor, or a touch leaves it there or
    reaches it only as a thud; hidden where it may be an input without a microphone.

    A thud is duller than the same touch on the contact microphone: by 1.9 dB at least
    over simulated objects, while a free microphone is brighter, or on a glazed tile up
    to 0.4 dB duller.
    """
    if statistics.level_dbfs[AIR] < OPEN_DBFS and reference == UNCALIBRATED:
        return None
    touch_db = statistics.level_dbfs[CONTACT] - reference.threshold_dbfs
    air_db = statistics.level_dbfs[AIR] - reference.floor_dbfs[AIR]
    # A room may have become quieter since it was calibrated; but not while something in
    # it is touched.
    if air_db < (-_MARGIN_DB if touch_db > 0 else -_CLEAR_DB):
        return True
    if touch_db < _STRONG_DB:
        return None
    fainter = statistics.level_dbfs[AIR] < statistics.level_dbfs[CONTACT] - _STRONG_DB
    return air_db < _MARGIN_DB or (
        fainter and statistics.tilt_db(AIR) < statistics.tilt_db(CONTACT) - _DULLER_DB
    )


def _swapped(statistics: ChannelStatistics, reference: Reference) -> bool:
    """Whether channel 1, without hum, is the louder one, and is also duller or was
    never the louder one at calibration.

    Without a calibration the gains could be such that air is louder, so there it must
    also be duller, as contact is.
    """
    contact, air = (_without_hum(statistics, channel) for channel in (CONTACT, AIR))
    if air < contact + _MARGIN_DB:
        return False
    duller = (
        statistics.treble_dbfs[AIR] - air
        < statistics.treble_dbfs[CONTACT] - contact - _DULLER_DB
    )
    return duller or reference.contrast_db > _CLEAR_DB


def _without_hum(statistics: ChannelStatistics, channel: int) -> float:
    power = 10 ** (statistics.level_dbfs[channel] / 10) - 10 ** (
        statistics.hum_dbfs[channel] / 10
    )
    # A hundredth of the hum escapes its bands: the rest must be above that to be
    # anything else.
    return 10 * math.log10(
        max(power, 0.02 * 10 ** (statistics.level_dbfs[channel] / 10))
    )
