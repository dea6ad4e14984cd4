import numpy as np
import pytest

from tactophone.measurement.impulse_latency import RATE, Clicker, analyse
from tactophone.telemetry import MARKS
from tactophone.telemetry.memory import MARK

PERIOD = 128
LAGS = {"captured": 0.0001, "sent": 0.0003, "received": 0.0004, "released": 0.0005, "decoded": 0.0007, "judged": 0.0009}
"""After the period in which the click came, in s."""


@pytest.fixture
def clicker(monkeypatch: pytest.MonkeyPatch) -> Clicker:
    """A run of ten clicks, each felt three periods after the one in which it came, on a clock that is exact."""
    clicker = Clicker(10, seed=3)
    monkeypatch.setattr(
        "tactophone.measurement.impulse_latency.time.monotonic", lambda: 100.0 + clicker.position / RATE
    )
    felt = np.zeros_like(clicker.felt)
    for click in clicker.clicks:
        felt[_period(click) + 3 * PERIOD + 5 :][:480] = 0.1
    out = np.zeros(PERIOD, np.float32)
    while not clicker.done:
        clicker.process([felt[clicker.position : clicker.position + PERIOD]], [out])
    return clicker


def _period(sample: int) -> int:
    return int(sample) // PERIOD * PERIOD


def _marks(clicker: Clicker) -> dict[str, np.ndarray]:
    marks = {name: [] for name in MARKS}
    for click in clicker.clicks:
        begun = 100.0 + _period(click) / RATE
        for name, lag in LAGS.items():
            marks[name].append((_period(click) + PERIOD, begun + lag))
        marks["rendered"].append((_period(click) + PERIOD, begun + 3 * PERIOD / RATE - 0.0001))
    return {name: np.array(rows, MARK) for name, rows in marks.items()}


def test_the_budget_adds_up_to_what_is_counted(clicker: Clicker) -> None:
    measured = analyse(clicker, _marks(clicker), period=PERIOD)
    assert measured.missed == 0
    offsets = np.array([click - _period(click) for click in clicker.clicks])
    np.testing.assert_allclose(measured.end_to_end, (3 * PERIOD + 5 - offsets) / RATE)
    np.testing.assert_allclose(np.sum(list(measured.stages.values()), axis=0), measured.end_to_end, atol=1e-9)
    assert measured.disagreement < 1e-9
    np.testing.assert_allclose(measured.stages["network"], 0.0001, atol=1e-9)
    np.testing.assert_allclose(measured.stages["playout"], 0.0001, atol=1e-9)


def test_clicks_that_were_not_felt_are_missed(clicker: Clicker) -> None:
    clicker.felt[clicker.clicks[4] :][: RATE // 5] = 0.0
    assert analyse(clicker, _marks(clicker), period=PERIOD).missed == 1


def test_every_phase_of_the_period_comes_up() -> None:
    assert len({int(click) % PERIOD for click in Clicker(300).clicks}) > 100
