"""The derived levels agree with the data sheets and with the authors' own threshold."""

import math

import numpy as np
import pytest
from scipy import signal

from tactophone.core.errors import ConfigError
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.competition import TASKS
from tactophone_lab.simulation.finger import Electronics
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.motion import LIFT, Move, single
from tactophone_lab.simulation.recording_levels import (
    AIR_GAIN,
    CONTACT_CORNER,
    LOUDEST_INPUT,
    MOST_GAIN,
    PIEZO_FULL_SCALE,
    SILENCE,
    electronics,
)
from tactophone_lab.simulation.render import RenderJob, RenderOptions
from tactophone_lab.simulation.source import MOTOR_SPEED, SimulatedFinger
from tactophone_lab.simulation.takes import TAKES

SECONDS = 4.0


def test_the_preamplifier_can_give_what_the_derivation_asks() -> None:
    assert 100 < LOUDEST_INPUT / PIEZO_FULL_SCALE < MOST_GAIN
    assert math.isclose(CONTACT_CORNER, 10.6, abs_tol=0.1)
    assert math.isclose(AIR_GAIN, 1.08, abs_tol=0.01)


def test_silence_lies_slightly_under_the_authors_threshold() -> None:
    still, moving = (loudest_window(speed) for speed in (0.0, MOTOR_SPEED))
    assert 2 < 20 * np.log10(SILENCE / still) < 6
    assert 1 < 20 * np.log10(SILENCE / moving) < 5
    assert still < moving


def test_silence_of_the_first_levels_counts_as_contact() -> None:
    assert loudest_window(0.0, levels="first") > 3 * SILENCE


def loudest_window(speed: float, *, levels: str = "derived") -> float:
    """Return the largest mean absolute value of 256 ms at 2 kHz of a finger in the
    air."""
    times = np.arange(0, SECONDS, 0.01)
    moves = [Move(float(t), speed * float(t), 0.035, LIFT) for t in times]
    wired = electronics(levels, hall=False, tip="pad") or Electronics()
    finger = SimulatedFinger(
        single(find("lava stone")),
        moves,
        session=SessionVariation(electronics=wired),
        place=(0.0, 0.035),
    )
    samples = finger.render(round(SECONDS * LIVE_SAMPLE_RATE)).samples
    return float(window_means(samples[LIVE_SAMPLE_RATE:, 0]).max())


def window_means(contact: FloatArray) -> FloatArray:
    low = np.abs(signal.resample_poly(contact, 1, 24))
    total = np.concatenate([[0.0], np.cumsum(low)])
    return np.asarray((total[512:] - total[:-512]) / 512)


def test_the_first_levels_keep_the_hash_of_rendered_files() -> None:
    """The cards of the shipped models name these files by their hash."""
    lava = find("lava stone")
    first, derived = (
        RenderJob(
            lava, lava.mounting, TAKES[0], RenderOptions(seed=21, levels=levels)
        ).fingerprint
        for levels in ("first", "derived")
    )
    assert first == "5fe611d72754e55e"
    assert derived != first


def test_another_tip_has_no_derived_levels() -> None:
    with pytest.raises(ConfigError, match="omit one"):
        electronics("derived", hall=False, tip="stylus")


def test_the_finals_set_their_knobs_anew_each_day_and_hum_at_sixty_hertz() -> None:
    days = [TASKS["finals"].session(seed, "pad").electronics for seed in range(20)]
    gains = 20 * np.log10([day.contact_gain for day in days])
    assert np.ptp(gains) > 4
    assert {day.mains for day in days} == {60.0}
    box = TASKS["box"].session(1, "pad")
    hall = electronics("first", hall=True, tip="pad")
    assert box == SessionVariation.draw(1, hall, tip="pad")
