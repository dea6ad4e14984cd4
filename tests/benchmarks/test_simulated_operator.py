import numpy as np
import pytest

from simulated_operator import (
    Operator,
    Percepts,
    Visits,
    perceive,
    perceive_visits,
    play_rounds,
    render_visits,
)
from tactophone.core.types import Touch

RATE = 48_000


def vibration(frequency: float, amplitude: float) -> np.ndarray:
    return (
        amplitude * np.sin(2 * np.pi * frequency * np.arange(8 * RATE) / RATE)
    ).astype(np.float32)


def perceived(smooth: np.ndarray, rough: np.ndarray) -> Visits[Percepts]:
    percepts = {
        Touch.SMOOTH: (perceive(smooth, RATE),),
        Touch.ROUGH: (perceive(rough, RATE),),
    }
    return Visits(percepts, percepts)


def test_the_papers_vibrations_are_distinguished_every_time_and_soon() -> None:
    rounds = play_rounds(
        perceived(vibration(120, 10 ** (-25 / 20)), vibration(60, 1.0)), rounds=100
    )
    assert all(each.success and each.found for each in rounds)
    assert np.median([each.duration for each in rounds]) < 25


def test_success_is_chance_where_vibrations_are_equal() -> None:
    same = vibration(100, 0.3)
    rounds = play_rounds(perceived(same, same), rounds=400)
    assert np.mean([each.success for each in rounds]) == pytest.approx(0.1, abs=0.06)


def test_silence_raises_no_error() -> None:
    silent = np.zeros(8 * RATE, np.float32)
    assert len(play_rounds(perceived(silent, silent), rounds=5)) == 5


def test_rounds_repeat_by_seed() -> None:
    percepts = perceived(vibration(110, 0.2), vibration(90, 0.25))
    assert (
        play_rounds(percepts, rounds=20, seed=4)
        == play_rounds(percepts, rounds=20, seed=4)
        != play_rounds(percepts, rounds=20, seed=5)
    )


def test_evidence_points_to_what_was_practised() -> None:
    percepts = perceived(vibration(120, 0.05), vibration(60, 1.0))
    operator = Operator(percepts.practice)
    assert operator.decide(percepts.rounds[Touch.ROUGH][0])[0] > 2
    assert operator.decide(percepts.rounds[Touch.SMOOTH][0])[0] < -2


@pytest.mark.long
def test_visits_are_rendered_and_perceived() -> None:
    visits = render_visits(visits=1)
    percepts = perceive_visits(visits, lambda samples: samples[:, 0])
    assert percepts.rounds[Touch.ROUGH][0].level_db.max() > 10
    assert visits.rounds[Touch.ROUGH][0].shape[1] == 2
