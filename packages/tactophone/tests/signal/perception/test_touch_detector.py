"""Contact gate and window detector together, with a detector whose predictions are
given."""

import itertools
from collections import Counter
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from tactophone.core.types import AudioBlock, ContactThreshold, Prediction, Touch
from tactophone.signal.perception import contact_state, touch_state
from tactophone.signal.perception.contact import Contact, ContactGate
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.detector import (
    FADED_DB,
    FADED_PAUSE,
    LANDED,
    PAUSE,
    TouchDetector,
)
from tactophone.signal.perception.touch_state import (
    ANSWERS,
    RULES,
    Moment,
    TouchState,
    next_state,
)

RATE = 8000
HOP = 80


class Scripted:
    """Predicts from a list, every 10 ms."""

    name = "scripted"
    hop = 0.01
    latency = 0.0
    bandwidth = 4000.0
    contact_at = None

    card, no_touch = SimpleNamespace(decision=DecisionRule(), channels=2), None

    def __init__(
        self, touches: list[Touch], level_dbfs: float = -20.0, smooth: float = 0.5
    ) -> None:
        self._touches = touches
        self._level_dbfs = level_dbfs
        self._smooth = smooth
        self._done = 0
        self.faults: Counter[str] = Counter()
        self.threshold, self.margin_db = ContactThreshold(-40.0), 0.0

    def take(self, block: AudioBlock) -> list[int]:
        first, self._done = self._done, block.end // HOP
        return list(range(first, min(self._done, len(self._touches))))

    def predict(self, number: int) -> Prediction:
        touch, end = self._touches[number], (number + 1) * self.hop
        share = self._smooth if touch is Touch.SMOOTH else 0.5
        return Prediction(
            (0.0, share, 1 - share),
            touch,
            0.8 * touch / 2,
            self._level_dbfs,
            end - 0.032,
            end,
        )

    def flush(self) -> list[Prediction]:
        return []

    def reset(self) -> None:
        self._done = 0


@pytest.mark.parametrize("decided", [Touch.SMOOTH, Touch.ROUGH])
def test_a_window_too_quiet_to_classify_leaves_the_last_decision_of_the_touch(
    decided: Touch,
) -> None:
    touches = [Touch.NONE] * 10 + [decided] * 10 + [Touch.NONE] * 5 + [Touch.NONE] * 5
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    sound[10 * HOP : 25 * HOP] = 0.1 * np.random.default_rng(0).standard_normal(
        (15 * HOP, 1)
    )
    detector = TouchDetector(
        Scripted(touches),
        ContactGate(-40, sample_rate=RATE, rule="banded"),
        window=0.032,
    )
    found = detector.push(AudioBlock(sound, RATE))
    during = [each for each in found if 0.2 < each.end <= 0.25]
    assert {(each.touch, each.roughness) for each in during} == {
        (decided, 0.8 * decided / 2)
    }
    assert found[-1].touch is Touch.NONE


def test_rough_outlasts_the_gates_level_by_a_short_pause() -> None:
    touches = [Touch.ROUGH] * 20 + [Touch.NONE] * 20
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    sound[: 20 * HOP] = 0.1 * np.random.default_rng(0).standard_normal((20 * HOP, 1))
    gate = ContactGate(-40, sample_rate=RATE, rule="banded", hold=0.1)
    found = TouchDetector(Scripted(touches), gate, window=0.032).push(
        AudioBlock(sound, RATE)
    )
    silent = next(
        each.end for each in found if each.touch is Touch.SMOOTH and each.end > 0.2
    )
    # The gate's longer level falls for up to 32 ms before the hold begins.
    assert (
        max(each.end for each in found if each.touch is Touch.ROUGH)
        < 0.2 + 0.032 + PAUSE
    )
    assert {each.touch for each in found if silent <= each.end < silent + 0.05} == {
        Touch.SMOOTH
    }


@pytest.mark.parametrize(
    ("over_db", "pause"), [(FADED_DB + 1, PAUSE), (FADED_DB - 1, FADED_PAUSE)]
)
def test_rough_outlasts_sound_that_fades_for_longer_than_sound_that_stops(
    over_db: float, pause: float
) -> None:
    touches = [Touch.ROUGH] * 20 + [Touch.NONE] * 20
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    sound[: 20 * HOP] = 0.1 * np.random.default_rng(0).standard_normal((20 * HOP, 1))
    gate = ContactGate(-40, sample_rate=RATE, rule="banded", hold=0.1)
    found = TouchDetector(Scripted(touches, -40 + over_db), gate, window=0.032).push(
        AudioBlock(sound, RATE)
    )
    held_from = next(contact.time for contact in _contacts(sound) if contact.held)
    ends = max(each.end for each in found if each.touch is Touch.ROUGH)
    assert held_from + pause - 0.01 <= ends < held_from + pause


def _contacts(sound: np.ndarray) -> list[Contact]:
    return ContactGate(-40, sample_rate=RATE, rule="banded", hold=0.1).push(
        AudioBlock(sound, RATE)
    )


def test_a_touch_begins_smooth_whatever_the_last_one_was() -> None:
    touches = [Touch.ROUGH] * 10 + [Touch.NONE] * 20
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    loud = 0.1 * np.random.default_rng(0).standard_normal((10 * HOP, 1))
    sound[: 10 * HOP], sound[20 * HOP :] = loud, loud
    detector = TouchDetector(
        Scripted(touches),
        ContactGate(-40, sample_rate=RATE, rule="banded"),
        window=0.032,
    )
    found = detector.push(AudioBlock(sound, RATE))
    assert {each.touch for each in found if each.end > 0.21} == {Touch.SMOOTH}


@pytest.mark.parametrize(
    ("rough", "smooth", "share", "remains"),
    [
        (60, 3, 0.6, True),
        (60, 3, 0.99, False),
        (60, 20, 0.6, False),
        (6, 3, 0.6, False),
    ],
)
def test_rough_stands_until_smooth_is_evident_and_the_sooner_the_shorter_it_was(
    rough: int, smooth: int, share: float, remains: bool
) -> None:
    touches = [Touch.ROUGH] * rough + [Touch.SMOOTH] * smooth + [Touch.ROUGH] * 5
    sound = 0.1 * np.random.default_rng(0).standard_normal(
        (len(touches) * HOP, 1)
    ).astype(np.float32)
    gate = ContactGate(-40, sample_rate=RATE, rule="banded")
    found = TouchDetector(Scripted(touches, smooth=share), gate, window=0.032).push(
        AudioBlock(sound, RATE)
    )
    later = {each.touch for each in found if each.end > 0.055}
    assert later == ({Touch.ROUGH} if remains else {Touch.ROUGH, Touch.SMOOTH})


def test_a_landing_is_not_rough() -> None:
    sound = 0.1 * np.random.default_rng(0).standard_normal((20 * HOP, 1)).astype(
        np.float32
    )
    gate = ContactGate(-40, sample_rate=RATE, rule="banded")
    found = TouchDetector(Scripted([Touch.ROUGH] * 20), gate, window=0.032).push(
        AudioBlock(sound, RATE)
    )
    begin = next(each.end for each in found if each.touch is not Touch.NONE)
    early = {each.touch for each in found if begin <= each.end < begin + LANDED - 0.001}
    assert early == {Touch.SMOOTH}
    assert found[-1].touch is Touch.ROUGH


def test_every_rule_of_the_states_is_reached_and_leads_to_one_answer() -> None:
    choices = itertools.product([False, True], repeat=7)
    moments = [Moment(*flags, window) for flags in choices for window in Touch]
    reached = {
        next(rule.when for rule in RULES if rule.holds(moment)) for moment in moments
    }
    assert reached == {rule.when for rule in RULES}
    assert set(ANSWERS) == {next_state(moment) for moment in moments} == set(TouchState)


def test_nothing_but_a_full_window_of_a_touch_that_has_landed_is_rough() -> None:
    for flags in itertools.product([False, True], repeat=7):
        for window in Touch:
            moment = Moment(*flags, window)
            if next_state(moment) is TouchState.ROUGH:
                assert moment.touching
                assert moment.usable
                assert moment.landed
                assert moment.sounds_like_touch
                assert not moment.faulty
                assert not moment.held
                assert not moment.paused


@pytest.mark.parametrize("machine", [contact_state, touch_state])
def test_the_page_about_the_detector_shows_the_states_as_they_are(
    machine: ModuleType,
) -> None:
    page = Path(__file__).parents[5] / "docs" / "reference" / "detector.md"
    assert machine.describe() in page.read_text(encoding="utf-8"), (
        "run `python scripts/touch_states.py`"
    )
