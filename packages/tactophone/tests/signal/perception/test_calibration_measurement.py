import functools
import itertools
from collections.abc import Callable

import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone.signal.perception.calibration import (
    CALIBRATION_WINDOW,
    CalibrationResult,
    CalibrationSounds,
    gate_threshold,
    level_threshold,
    measure_calibration,
)
from tactophone.signal.perception.contact import ContactGate
from tactophone.signal.perception.noise_floor import BAND_MARGIN_DB
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.faults import CODES, FaultSpan, FaultySource
from tactophone_lab.simulation.participant import SimulatedParticipant
from tests.sounds import noise

RATE = 48_000


def record(
    source: SimulatedParticipant, seconds: float, act: Callable[[], None]
) -> np.ndarray:
    act()
    blocks = iter(source)
    return np.concatenate([next(blocks).samples for _ in range(round(seconds * 100))])


@functools.cache
def performed(
    name: str, gain_db: float
) -> tuple[SimulatedParticipant, list[AudioBlock]]:
    """A participant, and its settling, silence, strokes and taps, as microphones
    without a fault record them."""
    participant = SimulatedParticipant(find(name), gain_db=gain_db)
    acts = (
        (0.5, participant.rest),
        (5, participant.rest),
        (5, lambda: participant.stroke(4.8)),
        (3, lambda: participant.tap(3)),
    )
    sounds = [record(participant, seconds, act) for seconds, act in acts]
    starts = itertools.accumulate((len(sound) for sound in sounds), initial=0)
    return participant, list(map(AudioBlock, sounds, itertools.repeat(RATE), starts))


@functools.cache
def calibrated(name: str, fault: str = "", gain_db: float = -9.0) -> CalibrationResult:
    participant, sounds = performed(name, gain_db)
    source = FaultySource(participant, [FaultSpan(fault)] if fault else [])
    _, silence, stroke, tap = (source.apply(sound).samples for sound in sounds)
    return measure_calibration(
        CalibrationSounds(RATE, silence, stroke, tap),
        made="2026-01-01T00:00:00",
        source="the simulated finger",
    )


@pytest.mark.parametrize(
    "name",
    [pytest.param("smooth competition stone", marks=pytest.mark.slow), "whiteboard"],
)
def test_a_good_set_up_passes(name: str) -> None:
    result = calibrated(name)
    assert result.passed, result.findings
    assert result.calibration.threshold_dbfs > result.calibration.window_dbfs
    assert result.calibration.window_dbfs > result.calibration.floor_dbfs[0]


@pytest.mark.slow
@pytest.mark.parametrize("fault", CODES)
def test_each_fault_is_named_and_the_set_up_refused(fault: str) -> None:
    result = calibrated("lava stone", fault, gain_db=-18.0)
    assert not result.passed
    assert fault in {finding.code for finding in result.findings if finding.fatal}


@pytest.mark.slow
def test_a_gain_too_high_comes_with_the_change_that_mends_it() -> None:
    gain_db, result = 0.0, calibrated("lava stone", gain_db=0.0)
    assert [finding.code for finding in result.findings if finding.fatal] == [
        "contact-clipped"
    ]
    while not result.passed and gain_db > -40:
        gain_db += result.gain_db[0]
        result = calibrated("lava stone", gain_db=gain_db)
    assert result.passed
    assert gain_db < -6


def test_missing_strokes_and_taps_are_found() -> None:
    participant = SimulatedParticipant(find("whiteboard"), gain_db=-9)
    record(participant, 0.5, participant.rest)
    still = record(participant, 5, participant.rest)
    result = measure_calibration(
        CalibrationSounds(RATE, still, still, still), made="", source=""
    )
    assert {"faint-stroke", "no-tap"} <= {
        finding.code for finding in result.findings if finding.fatal
    }
    moved = record(participant, 5, lambda: participant.stroke(1.5))
    restless = measure_calibration(
        CalibrationSounds(RATE, moved, moved, moved), made="", source=""
    )
    assert "restless" in {finding.code for finding in restless.findings}


@pytest.mark.parametrize("duration", [0.004, CALIBRATION_WINDOW])
def test_the_threshold_gives_about_the_chosen_number_of_false_alarms(
    duration: float,
) -> None:
    rng = np.random.default_rng(3)
    noise = rng.normal(0, 0.02, (RATE * 120, 1)).astype(np.float32)
    alarms = []
    for start in range(0, RATE * 60, RATE * 5):
        silence = noise[start : start + RATE * 5]
        threshold_dbfs = level_threshold(
            CalibrationSounds(RATE, silence, silence, silence), duration, 6.0
        )
        size = round(duration * RATE)
        levels = 10 * np.log10(
            np.square(noise[: len(noise) // size * size, 0])
            .reshape(-1, size)
            .mean(axis=1)
        )
        alarms.append(int((levels > threshold_dbfs).sum()) / 2)
    # A minute of independent looks; half a decibel is kept for drift, so there are
    # fewer.
    assert np.median(alarms) <= 6.0


@pytest.mark.slow
def test_silence_hardly_ever_opens_the_contact_gate_at_the_threshold_found() -> None:
    participant = SimulatedParticipant(find("whiteboard"))
    record(participant, 0.5, participant.rest)
    silence = record(participant, 5, participant.rest)
    threshold_dbfs = gate_threshold(
        CalibrationSounds(RATE, silence, silence, silence), 6.0
    )
    gate = ContactGate(threshold_dbfs, sample_rate=RATE)
    changes = gate.push(AudioBlock(record(participant, 60, participant.rest), RATE))
    openings = sum(
        later.touching and not earlier.touching
        for earlier, later in itertools.pairwise(changes)
    )
    # A few of either kind of look; five seconds do not determine a rate of 6 to better
    # than a factor of three.
    assert openings <= 18


@pytest.mark.slow
def test_a_faint_signal_comes_with_the_gain_that_mends_it() -> None:
    result = calibrated("whiteboard", gain_db=-40.0)
    assert result.gain_db[0] > 10
    assert "contact-faint" in {finding.code for finding in result.findings}


def test_sounds_too_short_raise() -> None:
    short = np.zeros((100, 2), np.float32)
    with pytest.raises(ValueError, match="second"):
        measure_calibration(
            CalibrationSounds(RATE, short, short, short), made="", source=""
        )


def moving(
    motion_db: float, *, jerks: int = 6, seconds: float = 6.0
) -> CalibrationSounds:
    """A robot whose motion raises noise of -60 dBFS by ``motion_db`` in every other 0.1
    s, with bangs of 0.2 s."""
    _, (_, _, stroke, tap) = performed("whiteboard", -9.0)
    rest, motion = (
        noise(level_dbfs=-60, duration=duration, seed=seed)
        for duration, seed in ((3, 1), (seconds, 2))
    )
    time = np.arange(len(motion)) / RATE
    motion[time % 0.2 < 0.1] *= 10 ** (motion_db / 20)
    for jerk in range(jerks):
        motion[(time - 0.5 - jerk * seconds / jerks) % seconds < 0.2] *= 100
    return CalibrationSounds(
        RATE, rest, stroke.samples, tap.samples, motion.astype(np.float32)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("motion_db", "margin_db"), [(0.0, 4.0), (3.0, 5.0), (5.0, 7.0)]
)
def test_a_louder_robot_gets_a_larger_margin(
    motion_db: float, margin_db: float
) -> None:
    result = measure_calibration(moving(motion_db), made="", source="")
    assert abs(result.calibration.margin_db - margin_db) <= 0.5
    assert result.passed
    assert abs(result.motion_db - motion_db / 2) < 3


@pytest.mark.slow
def test_starts_and_stops_do_not_raise_the_margin_but_more_bangs_do() -> None:
    six, many = (
        measure_calibration(moving(0.0, jerks=jerks), made="", source="")
        for jerks in (6, 12)
    )
    assert six.calibration.margin_db == 4.0
    assert many.calibration.margin_db == 8.0
    loud = next(finding for finding in many.findings if finding.code == "loud-motion")
    assert not loud.fatal


def test_without_a_robot_the_margin_stays() -> None:
    result = calibrated("whiteboard")
    assert result.calibration.margin_db == BAND_MARGIN_DB
    assert np.isnan(result.motion_db)
