"""Judges a set-up from three sounds: silence, a stroke and taps; finds its contact threshold and names its faults.

The threshold lies where silence is loud enough to be taken for a touch so many times a minute. Five seconds tell where:
the upper tail of the power of noise falls exponentially (Pickands, "Statistical inference using extreme order
statistics", Ann. Statist. 3, 119, 1975), and its mean excess is known from the loudest fifth.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.perception.contact import CLEAR_DB, FAST, SLOW, STEP_RATE
from tactophone.perception.sensor_health.calibration_file import Calibration
from tactophone.perception.sensor_health.faults import (
    CHANNELS,
    HARMLESS_HUM_DBFS,
    FaultWatch,
    Kind,
    Reference,
    SensorFault,
)
from tactophone.perception.sensor_health.signal_statistics import ChannelStatistics, SignalStatistics
from tactophone.types import CONTACT, AudioBlock, FloatArray

WINDOW = 0.256
"""Seconds over which the paper's gate takes the level."""

TAIL = 0.2
"""Share of silence's looks, the loudest, that the threshold is extrapolated from."""

OVERLAP = 8
"""Looks within one look's duration: few seconds should count for all that they are worth."""

DRIFT_DB = 0.5
"""Noise floors move by as much from one minute to the next."""

CLEARANCE_DB = 3.0
"""By which a stroke must stand over the threshold half of its time: the paper's own finger has 4 to 10."""

HEADROOM_DB = 6.0
"""Wanted between the stroke's highest peak and full scale: people press harder later."""

FAINT_DBFS = -30.0
"""A peak under this wastes more than four of the converter's bits and lets its noise in."""

CLIPPED_SHARE = 2e-3
"""Of the samples of a half second: single peaks may touch full scale."""

RESTLESS_DB = 6.0
"""By which the loudest window of silence may stand over its median; more, and it was no silence."""


@dataclass(frozen=True, slots=True)
class Finding:
    """Something wrong with a set-up, and what to do; ``fatal`` if nothing good can come of it as it is."""

    code: str
    words: str
    fatal: bool = True

    def __str__(self) -> str:
        return self.words


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What was measured, what is wrong, and by how many dB to turn each channel's gain (0: leave it)."""

    calibration: Calibration
    findings: tuple[Finding, ...]
    gain_db: tuple[int, ...]

    @property
    def blessed(self) -> bool:
        """Whether the set-up may be used."""
        return not any(finding.fatal for finding in self.findings)


@dataclass(frozen=True, slots=True, eq=False)
class Sounds:
    """The three things asked of the user, as they sounded; all at one rate, float32 ``(samples, channels)``."""

    sample_rate: int
    silence: FloatArray
    stroke: FloatArray
    tap: FloatArray


def diagnose(sounds: Sounds, *, made: str, source: str, false_alarms_per_minute: float = 1.0) -> Diagnosis:
    """TouchDetector a set-up.

    Parameters
    ----------
    sounds
        At least a second of each.
    made, source
        For the file: when, and from what.
    false_alarms_per_minute
        Touches that may be felt in a minute of silence.

    Raises
    ------
    ValueError
        If a sound is shorter than a second.
    """
    if min(map(len, (sounds.silence, sounds.stroke, sounds.tap))) < sounds.sample_rate:
        raise ValueError("each of silence, stroke and tap must last a second or more")
    silence, stroke = (_vitals(part, sounds.sample_rate) for part in (sounds.silence, sounds.stroke))
    touched = sorted(stroke, key=lambda one: one.level_dbfs[CONTACT])[len(stroke) // 2 :]
    calibration = Calibration(
        made=made,
        source=source,
        sample_rate=sounds.sample_rate,
        false_alarms_per_minute=false_alarms_per_minute,
        threshold_dbfs=gate_threshold(sounds, false_alarms_per_minute),
        window_dbfs=level_threshold(sounds, WINDOW, false_alarms_per_minute),
        floor_dbfs=_median(one.level_dbfs for one in silence),
        hum_dbfs=_median(one.hum_dbfs for one in silence),
        stroke_dbfs=_median(one.level_dbfs for one in touched),
        peak_dbfs=tuple(_peaks_dbfs(sounds.stroke)),
    )
    gain_db = tuple(_gain_db(sounds.stroke, channel) for channel in range(calibration.channels))
    faults = tuple(_faults(sounds, calibration, gain_db))
    told = {finding.code for finding in faults}
    weak = [one for one in _weaknesses(sounds, calibration, silence, gain_db) if one.code not in told]
    return Diagnosis(calibration, (*faults, *weak), gain_db)


def gate_threshold(sounds: Sounds, false_alarms_per_minute: float) -> float:
    """Find the threshold in dBFS with which silence opens the contact gate so many times a minute."""
    fast, slow = (level_threshold(sounds, steps / STEP_RATE, false_alarms_per_minute) for steps in (FAST, SLOW))
    return round(max(slow, fast - CLEAR_DB), 2)


def level_threshold(sounds: Sounds, duration: float, false_alarms_per_minute: float) -> float:
    """Find the level in dBFS that silence reaches so many times a minute, when taken over ``duration`` seconds."""
    powers = _powers(sounds.silence[:, CONTACT], round(duration * sounds.sample_rate), overlap=OVERLAP)
    loud = np.quantile(powers, 1 - TAIL)
    excess = float((powers[powers > loud] - loud).mean()) if (powers > loud).any() else 0.0
    # The mean of so few excesses is uncertain: one standard error, that of exponential values, is added.
    excess *= 1 + 1 / math.sqrt(TAIL * len(sounds.silence) / (duration * sounds.sample_rate))
    chance = min(TAIL, false_alarms_per_minute * duration / 60)
    return round(_dbfs(float(loud) + excess * math.log(TAIL / chance)) + DRIFT_DB, 2)


def _powers(samples: FloatArray, size: int, *, overlap: int = 1) -> NDArray[np.float64]:
    total = np.concatenate([[0.0], np.cumsum(np.square(samples, dtype=np.float64))])
    return np.asarray((total[size:] - total[:-size])[:: max(1, size // overlap)] / size)


def _dbfs(power: float) -> float:
    return 10 * math.log10(max(power, 1e-12))


def _vitals(samples: FloatArray, sample_rate: int) -> list[ChannelStatistics]:
    return SignalStatistics(sample_rate).push(AudioBlock(samples, sample_rate))


def _median(entries: Iterable[Sequence[float]]) -> tuple[float, ...]:
    return tuple(np.round(np.median(list(entries), axis=0), 2).tolist())


def _peaks_dbfs(samples: FloatArray) -> list[float]:
    peaks = np.abs(samples).max(axis=0)
    return [round(float(level), 2) for level in 20 * np.log10(np.maximum(peaks, 1e-6))]


def _gain_db(stroke: FloatArray, channel: int) -> int:
    """By how much to turn the gain, so that the stroke keeps its headroom but is not faint.

    What is cut off hides its own height; the quiet half tells it: a peak is four standard deviations or more.
    """
    loud = np.abs(stroke[:, channel])
    if not loud.any():
        return 0
    sigma = float(np.median(loud)) / 0.6745
    highest = max(float(loud.max()), 4 * sigma)
    room_db = -20 * math.log10(highest) - HEADROOM_DB
    return round(room_db) if room_db < 0 or highest < 10 ** (FAINT_DBFS / 20) else 0


def _faults(sounds: Sounds, calibration: Calibration, gain_db: Sequence[int]) -> Iterator[Finding]:
    """What the run-time watch finds in the three sounds, held to a stricter measure."""
    reference = Reference(calibration.window_dbfs, calibration.floor_dbfs, clipped=CLIPPED_SHARE)
    watch = FaultWatch(sounds.sample_rate, reference)
    named = _named(watch, np.concatenate([sounds.silence, sounds.stroke]))
    # Taps are as hard as one likes: that they clip says nothing.
    named |= {fault: None for fault in _named(watch, sounds.tap) if fault.kind is not Kind.CLIPPED}
    doubted = any(fault.channel is None for fault in named)
    for fault in named:
        if fault.channel is None:
            yield Finding(fault.code, str(fault))
        elif not doubted:
            turn = f" by {-gain_db[fault.channel]} dB or more" if fault.kind is Kind.CLIPPED else ""
            yield Finding(fault.code, f"{fault}{turn}")


def _named(watch: FaultWatch, samples: FloatArray) -> dict[SensorFault, None]:
    """Every fault that is named at any time, in order."""
    named: dict[SensorFault, None] = {}
    for start in range(0, len(samples), watch.cell_size):
        watch.push(AudioBlock(samples[start : start + watch.cell_size], watch.sample_rate))
        named |= dict.fromkeys(watch.faults)
    return named


def _weaknesses(
    sounds: Sounds, calibration: Calibration, silence: Sequence[ChannelStatistics], gain_db: Sequence[int]
) -> Iterator[Finding]:
    """What is wrong with the session, or less than good with the set-up."""
    levels = 10 * np.log10(np.maximum(_powers(sounds.silence[:, CONTACT], round(WINDOW * sounds.sample_rate)), 1e-12))
    if levels.max() > np.median(levels) + RESTLESS_DB:
        yield Finding(
            "restless", "the silence was not silent: keep the finger and the table still, and calibrate again"
        )
    clearance_db = calibration.stroke_dbfs[CONTACT] - calibration.window_dbfs
    if clearance_db < CLEARANCE_DB:
        yield Finding(
            "faint-stroke",
            f"the stroke is {clearance_db:+.1f} dB from the contact threshold, but {CLEARANCE_DB:+g} dB is wanted: "
            "press harder, lower the noise, or turn the contact microphone's gain up",
        )
    tap_dbfs = _dbfs(float(_powers(sounds.tap[:, CONTACT], sounds.sample_rate * FAST // STEP_RATE).max()))
    if tap_dbfs < calibration.threshold_dbfs + CLEAR_DB:
        yield Finding("no-tap", "no tap was heard: tap the pad on something hard, about twice a second")
    for channel, name in enumerate(CHANNELS[: calibration.channels]):
        hum, floor = calibration.hum_dbfs[channel], calibration.floor_dbfs[channel]
        if hum > max(floor - 3, HARMLESS_HUM_DBFS):
            words = f"half of the {name} microphone's noise is hum at {silence[-1].mains} Hz and its multiples"
            yield Finding(f"{name}-hum", f"{words}; better shielding would let lighter touches be felt", fatal=False)
        if gain_db[channel] > 0:
            words = f"the {name} microphone peaks at {calibration.peak_dbfs[channel]:.0f} dBFS"
            yield Finding(f"{name}-faint", f"{words}; turn its gain up by {gain_db[channel]} dB", fatal=False)
