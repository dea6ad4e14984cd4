"""Calibrates a set-up from silence, a stroke and taps, and keeps the result in a file
that other commands read.

Three sounds give the contact threshold and show the faults of a set-up; a fourth, of a
robot that moves in the air, gives the margin by which bands have to exceed their noise.
At the threshold, silence is loud enough to pass for contact a chosen number of times a
minute. Five seconds suffice to find it: the upper tail of the power of noise falls
exponentially (Pickands, "Statistical inference using extreme order statistics", Ann.
Statist. 3, 119, 1975), and its mean excess is known from the loudest fifth.
"""

import dataclasses
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Self, TypeAlias

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from tactophone.core.errors import ConfigError
from tactophone.core.microphones import AIR, CONTACT, MICROPHONES
from tactophone.core.processes import atomic_write
from tactophone.core.small_files import read_small
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.signal.perception.contact import (
    CLEAR_DB,
    Contact,
    ContactGate,
)
from tactophone.signal.perception.health import (
    HARMLESS_HUM_DBFS,
    ChannelStatistics,
    FaultDetector,
    FaultKind,
    Reference,
    SensorFault,
    SignalStatistics,
)
from tactophone.signal.perception.levels import (
    BANDS_HOP,
    FAST,
    SLOW,
    BandLevels,
    LoudnessRule,
)
from tactophone.signal.perception.noise_floor import (
    BAND_MARGIN_DB,
    SHORTEST_ALARM,
    NoiseFloor,
    measure_floor,
)
from tactophone.signal.silences import TOUCH_HOLD

CLIPPED = 0.05
"""Share of clipped samples in a half second that is a fault once the gain was found
good: a knob was turned."""

_TABLE = "calibration"


MOST_BYTES = 1 << 14
"""Of a calibration file; `Calibration.write` makes about 500."""

Level: TypeAlias = Annotated[float, Meta(ge=-300, le=20)]
"""In dBFS: what microphones deliver, digital silence included."""

Levels: TypeAlias = Annotated[tuple[Level, ...], Meta(min_length=1, max_length=2)]


@dataclass(frozen=True, slots=True)
class Calibration:
    """Levels of a set-up (a finger, its microphones, their gain); one entry for each
    channel where several."""

    made: str
    source: str
    """`made` and `source`: date and time in ISO 8601, and the name of the source."""
    sample_rate: Annotated[int, Meta(ge=1_000, le=768_000)]
    """In Hz."""
    false_alarms_per_minute: Annotated[float, Meta(ge=0, le=1_000)]
    """Chosen: false contacts in a minute of silence."""
    threshold_dbfs: Level
    """Level of the contact microphone from which there is contact, for
    :class:`ContactGate`."""
    window_dbfs: Level
    """The same for a whole window of 256 ms, as in the paper: lower, as a level over a
    longer time varies less."""
    floor_dbfs: Levels
    hum_dbfs: Levels
    """`floor_dbfs` and `hum_dbfs`: level and hum in silence."""
    stroke_dbfs: Levels
    peak_dbfs: Levels
    """`stroke_dbfs` and `peak_dbfs`: median level and highest peak while stroked."""
    banded_dbfs: Annotated[float, Meta(ge=-300)] = math.inf
    """``threshold_dbfs`` by the rule ``banded``; infinite in files of versions that did
    not measure it."""
    margin_db: Annotated[float, Meta(ge=3, le=12)] = BAND_MARGIN_DB
    """How far over its noise a band is heard: as little as the robot's own motion
    allows."""

    def threshold_for(self, rule: LoudnessRule) -> float | None:
        """Return the contact threshold for a model's rule, if it was measured."""
        if rule == "rms":
            return self.threshold_dbfs
        return (
            self.banded_dbfs
            if rule == "banded" and math.isfinite(self.banded_dbfs)
            else None
        )

    @property
    def channels(self) -> int:
        """1 or 2; channel 0 is contact."""
        return len(self.floor_dbfs)

    @property
    def reference(self) -> Reference:
        """The normal state that sensor faults are compared with."""
        levels = (self.floor_dbfs, self.stroke_dbfs)
        contrast_db = (
            min(each[CONTACT] - each[AIR] for each in levels)
            if self.channels > 1
            else 0.0
        )
        return Reference(
            self.window_dbfs, self.floor_dbfs, self.hum_dbfs, CLIPPED, contrast_db
        )

    def write(self, path: Path) -> None:
        """Write the file; raises `ConfigError` if it cannot be written."""
        # Texts, numbers and lists are written alike in JSON and TOML; only infinity is
        # not.
        entries = {
            name: json.dumps(value, ensure_ascii=False)
            for name, value in dataclasses.asdict(self).items()
        }
        lines = (
            f"{name} = {'inf' if value == 'Infinity' else value}\n"
            for name, value in entries.items()
        )
        try:
            with atomic_write(path) as unfinished:
                unfinished.write_text(f"[{_TABLE}]\n{''.join(lines)}", encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"{path}: {error.strerror}; give a folder that can be written to"
            ) from None

    @classmethod
    def read(cls, path: Path) -> Self:
        """Read a file; raises `ConfigError` if it is missing, or not a file of
        :meth:`write`."""
        again = "make one with `tactophone check`"
        try:
            content = read_small(path, MOST_BYTES)
            found: Self = msgspec.toml.decode(content, type=dict[str, cls])[_TABLE]  # type: ignore[valid-type]
            levels = (found.hum_dbfs, found.stroke_dbfs, found.peak_dbfs)
            if any(len(each) != found.channels for each in levels):
                raise ValueError("levels of one channel and of two")
            return found
        except OSError as error:
            raise ConfigError(f"{path}: {error.strerror}; {again}") from None
        except (ValueError, RecursionError, KeyError) as error:
            raise ConfigError(
                f"{path}: not a calibration file ({type(error).__name__}: {error}); "
                f"{again}"
            ) from None


CALIBRATION_WINDOW = 0.256
"""Seconds over which the paper's gate measures the level."""

LEVEL_TAIL = 0.2
"""Share of the levels of silence, the loudest, that the threshold is extrapolated
from."""

SPECTRUM_OVERLAP = 8
"""Levels measured within the duration of one, to use the few seconds fully."""

CALIBRATION_DRIFT_DB = 0.5
"""Noise floors change by as much from one minute to the next."""

CLEARANCE_DB = 3.0
"""Margin over the threshold that a stroke must have half of its time: the paper's own
finger has 4 to 10."""

HEADROOM_DB = 6.0
"""Margin between the stroke's highest peak and full scale: people press harder
later."""

FAINT_DBFS = -30.0
"""A peak under this wastes more than four of the converter's bits and lets its noise
in."""

CALIBRATION_CLIPPED_SHARE = 2e-3
"""Of the samples of a half second: single peaks may touch full scale."""

RESTLESS_DB = 6.0
"""Margin over the median at which the loudest window of silence shows that it was not
silent."""

MARGINS_DB = tuple(np.arange(4.0, 8.5, 0.5).tolist())
"""Margins of the bands that are tried on a robot's motion."""

MOST_MOTION = 0.02
"""Share of the motion that may be contact."""

JERKS = 6
"""Starts and stops of the motion that was asked for."""

JERK = 0.5
"""Seconds that each start or stop may be contact: they sound like a touch."""

LOW_BANDS = 6
"""Bands under 500 Hz."""


@dataclass(frozen=True, slots=True)
class Finding:
    """A fault of a set-up and its remedy; a set-up with a ``fatal`` one cannot be
    used."""

    code: str
    message: str
    fatal: bool = True

    def __str__(self) -> str:
        return self.message


@dataclass(frozen=True, slots=True)
class CalibrationResult:
    """What was measured and found, and by how many dB to turn each channel's gain (0:
    leave it)."""

    calibration: Calibration
    findings: tuple[Finding, ...]
    gain_db: tuple[int, ...]
    motion_db: float = math.nan
    """How much louder than rest a robot's motion is under 500 Hz, in dB (median); NaN
    where it was not heard."""

    @property
    def passed(self) -> bool:
        """Whether the set-up may be used."""
        return not any(finding.fatal for finding in self.findings)


@dataclass(frozen=True, slots=True, eq=False)
class CalibrationSounds:
    """The recordings of a calibration; all at one rate, float32 ``(samples,
    channels)``."""

    sample_rate: int
    silence: FloatArray
    stroke: FloatArray
    tap: FloatArray
    motion: FloatArray | None = None
    """Of a robot that moves all the time, with three starts and stops, and touches
    nothing."""


def measure_calibration(
    sounds: CalibrationSounds,
    *,
    made: str,
    source: str,
    false_alarms_per_minute: float = 1.0,
) -> CalibrationResult:
    """Measure the levels of a set-up and find what is wrong with it.

    - ``sounds``: at least a second of each that there is.
    - ``made``, ``source``: for the file: date and time, and name of the source.
    - ``false_alarms_per_minute``: false contacts to allow in a minute of silence.

    Raises `ValueError` if a sound is shorter than a second.
    """
    motion = sounds.silence if sounds.motion is None else sounds.motion
    if (
        min(map(len, (sounds.silence, sounds.stroke, sounds.tap, motion)))
        < sounds.sample_rate
    ):
        raise ValueError(
            "each of silence, stroke, tap and motion must last a second or more"
        )
    silence, stroke = (
        SignalStatistics(sounds.sample_rate).push(AudioBlock(part, sounds.sample_rate))
        for part in (sounds.silence, sounds.stroke)
    )
    # A stroke pauses where it turns: its louder half is contact.
    touching = sorted(stroke, key=lambda statistics: statistics.level_dbfs[CONTACT])[
        len(stroke) // 2 :
    ]
    peaks = 20 * np.log10(np.maximum(np.abs(sounds.stroke).max(axis=0), 1e-6))
    margin, heard, motion_db = (
        (BAND_MARGIN_DB, 0.0, math.nan)
        if sounds.motion is None
        else _measure_motion(sounds)
    )
    calibration = Calibration(
        made=made,
        source=source,
        sample_rate=sounds.sample_rate,
        false_alarms_per_minute=false_alarms_per_minute,
        threshold_dbfs=gate_threshold(sounds, false_alarms_per_minute),
        window_dbfs=level_threshold(
            sounds, CALIBRATION_WINDOW, false_alarms_per_minute
        ),
        floor_dbfs=_median(statistics.level_dbfs for statistics in silence),
        hum_dbfs=_median(statistics.hum_dbfs for statistics in silence),
        stroke_dbfs=_median(statistics.level_dbfs for statistics in touching),
        peak_dbfs=tuple(round(float(level), 2) for level in peaks),
        banded_dbfs=_banded_threshold(
            motion, sounds.sample_rate, false_alarms_per_minute
        ),
        margin_db=margin,
    )
    gain_db = tuple(
        _gain_db(sounds.stroke, channel) for channel in range(calibration.channels)
    )
    faults = tuple(_faults(sounds, calibration, gain_db))
    codes = {finding.code for finding in faults}
    weaknesses = _weaknesses(sounds, calibration, silence, gain_db)
    findings = [
        *faults,
        *(finding for finding in weaknesses if finding.code not in codes),
    ]
    if heard > MOST_MOTION:
        found = (
            f"{heard:.0%} of the robot's motion is contact, even if bands are "
            f"heard from {margin:g} dB over noise"
        )
        findings.append(
            Finding(
                "loud-motion",
                f"{found}; keep its motors and cables from the finger",
                fatal=False,
            )
        )
    return CalibrationResult(calibration, tuple(findings), gain_db, motion_db)


def gate_threshold(sounds: CalibrationSounds, false_alarms_per_minute: float) -> float:
    """Return the threshold in dBFS at which silence opens the contact gate this often a
    minute."""
    fast, slow = (
        level_threshold(sounds, seconds, false_alarms_per_minute)
        for seconds in (FAST, SLOW)
    )
    return round(max(slow, fast - CLEAR_DB), 2)


def level_threshold(
    sounds: CalibrationSounds, duration: float, false_alarms_per_minute: float
) -> float:
    """Return the level in dBFS, measured over ``duration`` s, that silence reaches this
    often a minute."""
    powers = _powers(
        sounds.silence[:, CONTACT],
        round(duration * sounds.sample_rate),
        overlap=SPECTRUM_OVERLAP,
    )
    loud = np.quantile(powers, 1 - LEVEL_TAIL)
    excess = (
        float((powers[powers > loud] - loud).mean()) if (powers > loud).any() else 0.0
    )
    # The mean of so few excesses is uncertain: one standard error, that of exponential
    # values, is added.
    excess *= 1 + 1 / math.sqrt(
        LEVEL_TAIL * len(sounds.silence) / (duration * sounds.sample_rate)
    )
    chance = min(LEVEL_TAIL, false_alarms_per_minute * duration / 60)
    return round(
        _dbfs(float(loud) + excess * math.log(LEVEL_TAIL / chance))
        + CALIBRATION_DRIFT_DB,
        2,
    )


def _banded_threshold(
    quiet: FloatArray, rate: int, false_alarms_per_minute: float
) -> float:
    """Return the gate's threshold by the rule ``banded``; infinite where silence, or
    motion, was not steady."""
    share = min(1.0, false_alarms_per_minute * SHORTEST_ALARM / 60)
    floor = measure_floor(
        [AudioBlock(quiet, rate)], sample_rate=rate, rule="banded", false_alarms=share
    )
    return round(floor.threshold_dbfs, 2) if floor.known else math.inf


def _measure_motion(sounds: CalibrationSounds) -> tuple[float, float, float]:
    """Return the least margin with which motion is hardly contact, or the greatest; the
    share that is; `motion_db`."""
    rate = sounds.sample_rate
    motion = np.asarray(sounds.motion, np.float32)
    for margin in MARGINS_DB:
        floor = NoiseFloor(math.inf)
        floor.margin_db = margin
        gate = ContactGate(
            math.inf,
            sample_rate=rate,
            rule="banded",
            floor=floor,
            bands=True,
            hold=TOUCH_HOLD,
        )
        gate.push(AudioBlock(sounds.silence, rate))
        share = _without_jerks(gate.push(AudioBlock(motion, rate)))
        if share <= MOST_MOTION:
            break
    rest, moving = (
        np.median(
            BandLevels(rate, hop=round(BANDS_HOP * rate)).push(
                part.T[CONTACT : CONTACT + 1]
            ),
            axis=0,
        )[0]
        for part in (sounds.silence, motion)
    )
    return margin, share, round(float((moving - rest)[:LOW_BANDS].mean()), 1)


def _without_jerks(contacts: Sequence[Contact]) -> float:
    """Return the share of contact but for starts and stops, from changes and
    heartbeats."""
    times = np.array([each.time for each in (*contacts, contacts[-1])])
    edges = np.flatnonzero(
        np.diff([each.touching for each in contacts], prepend=False, append=False)
    )
    touches = np.diff(times[edges])[::2]
    jerks = np.sort(np.minimum(touches, JERK))[-JERKS:]
    return float((touches.sum() - jerks.sum()) / (times[-1] - times[0]))


def _powers(samples: FloatArray, size: int, *, overlap: int = 1) -> NDArray[np.float64]:
    """Return the mean powers of windows of ``size`` samples, ``overlap`` of them
    starting within each."""
    total = np.concatenate([[0.0], np.cumsum(np.square(samples, dtype=np.float64))])
    return np.asarray((total[size:] - total[:-size])[:: max(1, size // overlap)] / size)


def _dbfs(power: float) -> float:
    return 10 * math.log10(max(power, 1e-12))


def _median(entries: Iterable[Sequence[float]]) -> tuple[float, ...]:
    return tuple(np.round(np.median(list(entries), axis=0), 2).tolist())


def _gain_db(stroke: FloatArray, channel: int) -> int:
    """Return by how much to turn the gain, so that the stroke keeps its headroom but is
    not faint.

    Clipping hides the height of a peak; it is estimated from the quieter half: a peak
    is four standard deviations or more, and the median of a normal distribution's
    absolute value is 0.6745 of one.
    """
    loud = np.abs(stroke[:, channel])
    if not loud.any():
        return 0
    highest = max(float(loud.max()), 4 * float(np.median(loud)) / 0.6745)
    room_db = -20 * math.log10(highest) - HEADROOM_DB
    return round(room_db) if room_db < 0 or highest < 10 ** (FAINT_DBFS / 20) else 0


def _faults(
    sounds: CalibrationSounds, calibration: Calibration, gain_db: Sequence[int]
) -> Iterator[Finding]:
    """Yield the faults that the run-time detector finds in the three sounds, by a
    stricter limit for clipping."""
    reference = Reference(
        calibration.window_dbfs,
        calibration.floor_dbfs,
        clipped=CALIBRATION_CLIPPED_SHARE,
    )
    detector = FaultDetector(sounds.sample_rate, reference)
    found = _faults_over_time(detector, np.concatenate([sounds.silence, sounds.stroke]))
    # Taps may be as hard as the user likes: that they clip is no fault.
    found |= {
        fault: None
        for fault in _faults_over_time(detector, sounds.tap)
        if fault.kind is not FaultKind.CLIPPED
    }
    both_in_doubt = any(fault.channel is None for fault in found)
    for fault in found:
        if fault.channel is None:
            yield Finding(fault.code, str(fault))
        elif not both_in_doubt:
            turn = (
                f" by {-gain_db[fault.channel]} dB or more"
                if fault.kind is FaultKind.CLIPPED
                else ""
            )
            yield Finding(fault.code, f"{fault}{turn}")


def _faults_over_time(
    detector: FaultDetector, samples: FloatArray
) -> dict[SensorFault, None]:
    """Return every fault that is present at any time, in order."""
    found: dict[SensorFault, None] = {}
    for start in range(0, len(samples), detector.cell_size):
        detector.push(
            AudioBlock(
                samples[start : start + detector.cell_size], detector.sample_rate
            )
        )
        found |= dict.fromkeys(detector.faults)
    return found


def _weaknesses(
    sounds: CalibrationSounds,
    calibration: Calibration,
    silence: Sequence[ChannelStatistics],
    gain_db: Sequence[int],
) -> Iterator[Finding]:
    """Yield what is wrong with the recordings, and what could be better in the
    set-up."""
    levels = 10 * np.log10(
        np.maximum(
            _powers(
                sounds.silence[:, CONTACT],
                round(CALIBRATION_WINDOW * sounds.sample_rate),
            ),
            1e-12,
        )
    )
    if levels.max() > np.median(levels) + RESTLESS_DB:
        yield Finding(
            "restless",
            "the silence was not silent: keep the finger and the table still, and "
            "calibrate again",
        )
    clearance_db = calibration.stroke_dbfs[CONTACT] - calibration.window_dbfs
    if clearance_db < CLEARANCE_DB:
        yield Finding(
            "faint-stroke",
            f"the stroke is {clearance_db:+.1f} dB from the contact threshold, but "
            f"needs {CLEARANCE_DB:+g} dB: "
            "press harder, lower the noise, or turn the contact microphone's gain up",
        )
    tap_dbfs = _dbfs(
        float(_powers(sounds.tap[:, CONTACT], round(FAST * sounds.sample_rate)).max())
    )
    if tap_dbfs < calibration.threshold_dbfs + CLEAR_DB:
        yield Finding(
            "no-tap",
            "no tap was found: tap the finger on something hard, about twice a second",
        )
    for channel, name in enumerate(MICROPHONES[: calibration.channels]):
        hum = calibration.hum_dbfs[channel]
        floor = calibration.floor_dbfs[channel]
        if hum > max(floor - 3, HARMLESS_HUM_DBFS):
            found = (
                f"half of the {name} microphone's noise is hum at "
                f"{silence[-1].mains} Hz and its multiples"
            )
            yield Finding(
                f"{name}-hum",
                f"{found}; better shielding would let lighter touches be detected",
                fatal=False,
            )
        if gain_db[channel] > 0:
            found = (
                f"the {name} microphone peaks at "
                f"{calibration.peak_dbfs[channel]:.0f} dBFS"
            )
            yield Finding(
                f"{name}-faint",
                f"{found}; turn its gain up by {gain_db[channel]} dB",
                fatal=False,
            )
