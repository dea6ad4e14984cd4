import functools
import itertools
from collections.abc import Callable

import numpy as np
import pytest

from tactophone.perception.contact import ContactGate
from tactophone.perception.sensor_health.calibration import (
    WINDOW,
    Diagnosis,
    Sounds,
    diagnose,
    gate_threshold,
    level_threshold,
)
from tactophone.simulation import find
from tactophone.simulation.participants.participant import SimulatedParticipant
from tactophone.simulation.physics.sensor_faults import CODES, FaultSpan, FaultySource
from tactophone.types import AudioBlock

RATE = 48_000


def heard(source: FaultySource, seconds: float, act: Callable[[], None]) -> np.ndarray:
    act()
    blocks = iter(source)
    return np.concatenate([next(blocks).samples for _ in range(round(seconds * 100))])


@functools.cache
def judged(name: str, fault: str = "", gain_db: float = -9.0) -> Diagnosis:
    volunteer = SimulatedParticipant(find(name), gain_db=gain_db)
    source = FaultySource(volunteer, [FaultSpan(fault)] if fault else [])
    heard(source, 0.5, volunteer.rest)
    silence = heard(source, 5, volunteer.rest)
    stroke = heard(source, 5, lambda: volunteer.stroke(4.8))
    tap = heard(source, 3, lambda: volunteer.tap(3))
    return diagnose(Sounds(RATE, silence, stroke, tap), made="2026-01-01T00:00:00", source="the simulated finger")


@pytest.mark.parametrize("name", ["smooth competition stone", "whiteboard"])
def test_a_good_set_up_is_blessed(name: str) -> None:
    diagnosis = judged(name)
    assert diagnosis.blessed, diagnosis.findings
    assert diagnosis.calibration.threshold_dbfs > diagnosis.calibration.window_dbfs
    assert diagnosis.calibration.window_dbfs > diagnosis.calibration.floor_dbfs[0]


@pytest.mark.parametrize("fault", CODES)
def test_each_fault_is_named_and_the_set_up_refused(fault: str) -> None:
    diagnosis = judged("lava stone", fault, gain_db=-18.0)
    assert not diagnosis.blessed
    assert fault in {finding.code for finding in diagnosis.findings if finding.fatal}


def test_a_gain_too_high_is_told_by_how_much_until_it_fits() -> None:
    gain_db, diagnosis = 0.0, judged("lava stone", gain_db=0.0)
    assert [finding.code for finding in diagnosis.findings if finding.fatal] == ["contact-clipped"]
    while not diagnosis.blessed and gain_db > -40:
        gain_db += diagnosis.gain_db[0]
        diagnosis = judged("lava stone", gain_db=gain_db)
    assert diagnosis.blessed
    assert gain_db < -6


def test_what_the_user_left_out_is_asked_for() -> None:
    volunteer = SimulatedParticipant(find("whiteboard"), gain_db=-9)
    source = FaultySource(volunteer, [])
    heard(source, 0.5, volunteer.rest)
    still = heard(source, 5, volunteer.rest)
    diagnosis = diagnose(Sounds(RATE, still, still, still), made="", source="")
    assert {"faint-stroke", "no-tap"} <= {finding.code for finding in diagnosis.findings if finding.fatal}
    moved = heard(source, 5, lambda: volunteer.stroke(1.5))
    restless = diagnose(Sounds(RATE, moved, moved, moved), made="", source="")
    assert "restless" in {finding.code for finding in restless.findings}


@pytest.mark.parametrize("duration", [0.004, WINDOW])
def test_the_threshold_gives_about_the_chosen_number_of_false_alarms(duration: float) -> None:
    rng = np.random.default_rng(3)
    noise = rng.normal(0, 0.02, (RATE * 120, 1)).astype(np.float32)
    alarms = []
    for start in range(0, RATE * 60, RATE * 5):
        silence = noise[start : start + RATE * 5]
        threshold_dbfs = level_threshold(Sounds(RATE, silence, silence, silence), duration, 6.0)
        size = round(duration * RATE)
        levels = 10 * np.log10(np.square(noise[: len(noise) // size * size, 0]).reshape(-1, size).mean(axis=1))
        alarms.append(int((levels > threshold_dbfs).sum()) / 2)
    # A minute of independent looks; half a decibel is kept for drift, so there are fewer.
    assert np.median(alarms) <= 6.0


def test_silence_hardly_ever_opens_the_contact_gate_at_the_threshold_found() -> None:
    volunteer = SimulatedParticipant(find("whiteboard"))
    source = FaultySource(volunteer, [])
    heard(source, 0.5, volunteer.rest)
    silence = heard(source, 5, volunteer.rest)
    threshold_dbfs = gate_threshold(Sounds(RATE, silence, silence, silence), 6.0)
    gate = ContactGate(threshold_dbfs, sample_rate=RATE)
    changes = gate.push(AudioBlock(heard(source, 60, volunteer.rest), RATE))
    openings = sum(later.touching and not earlier.touching for earlier, later in itertools.pairwise(changes))
    # A few of either kind of look; five seconds cannot tell a rate of 6 to better than a factor of three.
    assert openings <= 18


def test_a_fainter_signal_is_told_to_be_turned_up() -> None:
    diagnosis = judged("whiteboard", gain_db=-40.0)
    assert diagnosis.gain_db[0] > 10
    assert "contact-faint" in {finding.code for finding in diagnosis.findings}


def test_sounds_too_short_are_our_own_slip() -> None:
    short = np.zeros((100, 2), np.float32)
    with pytest.raises(ValueError, match="second"):
        diagnose(Sounds(RATE, short, short, short), made="", source="")
