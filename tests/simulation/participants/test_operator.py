import numpy as np
import pytest

from tactophone.simulation.participants.fingertip_model import feel_waveform
from tactophone.simulation.participants.operator import Bank, Operator, make_bank, play, render_visits
from tactophone.types import Touch

RATE = 48_000


def vibration(frequency: float, amplitude: float) -> np.ndarray:
    return (amplitude * np.sin(2 * np.pi * frequency * np.arange(8 * RATE) / RATE)).astype(np.float32)


def bank(smooth: np.ndarray, rough: np.ndarray) -> Bank:
    percepts = {Touch.SMOOTH: (feel_waveform(smooth, RATE),), Touch.ROUGH: (feel_waveform(rough, RATE),)}
    return Bank(percepts, percepts)


def test_the_papers_feel_is_told_apart_every_time_and_soon() -> None:
    rounds = play(bank(vibration(120, 10 ** (-25 / 20)), vibration(60, 1.0)), rounds=100)
    assert all(one.success and one.found for one in rounds)
    assert np.median([one.duration for one in rounds]) < 25


def test_where_there_is_nothing_to_tell_success_is_chance() -> None:
    same = vibration(100, 0.3)
    rounds = play(bank(same, same), rounds=400)
    assert np.mean([one.success for one in rounds]) == pytest.approx(0.1, abs=0.06)


def test_silence_teaches_nothing_and_raises_nothing() -> None:
    silent = np.zeros(8 * RATE, np.float32)
    assert len(play(bank(silent, silent), rounds=5)) == 5


def test_rounds_repeat_by_seed() -> None:
    felt = bank(vibration(110, 0.2), vibration(90, 0.25))
    assert play(felt, rounds=20, seed=4) == play(felt, rounds=20, seed=4) != play(felt, rounds=20, seed=5)


def test_evidence_points_to_what_was_practised() -> None:
    felt = bank(vibration(120, 0.05), vibration(60, 1.0))
    operator = Operator(felt.practice)
    assert operator.judge(felt.rounds[Touch.ROUGH][0])[0] > 2
    assert operator.judge(felt.rounds[Touch.SMOOTH][0])[0] < -2


def test_visits_are_rendered_and_felt() -> None:
    visits = render_visits(visits=1)
    felt = make_bank(visits, lambda samples: samples[:, 0])
    assert felt.rounds[Touch.ROUGH][0].level_db.max() > 10
    assert visits.rounds[Touch.ROUGH][0].shape[1] == 2
