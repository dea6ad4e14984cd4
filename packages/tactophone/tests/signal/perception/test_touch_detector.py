"""Contact gate and window detector together, with a detector whose predictions are
given."""

import itertools
from collections import Counter
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import cast

import numpy as np
import pytest

from tactophone.core.types import (
    AudioBlock,
    ContactThreshold,
    FloatArray,
    Prediction,
    Touch,
)
from tactophone.signal.perception import contact_state, touch_state
from tactophone.signal.perception.contact import LONGEST_WAIT, Contact, ContactGate
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.detector import FADED_DB, TouchDetector
from tactophone.signal.perception.evidence import (
    GREATEST_STEP,
    LEAST,
    MOST,
    ROUGH_FROM,
)
from tactophone.signal.perception.models import open_touch_detector
from tactophone.signal.perception.touch_state import (
    ANSWERS,
    RULES,
    Moment,
    TouchState,
    next_state,
)
from tactophone.signal.perception.window_detector import WindowDetector
from tactophone.signal.silences import FADED_PAUSE, LIFT, PAUSE

RATE = 8000
HOP = 80

SURE = 0.95
"""Probability that a scripted window is what it is: a step of 2.9 nats."""


class Scripted:
    """Predicts from a list, every 10 ms."""

    name = "scripted"
    hop = 0.01
    bandwidth = 4000.0
    contact_at = None

    card, no_touch = SimpleNamespace(decision=DecisionRule(), channels=2), None

    def __init__(
        self,
        touches: list[Touch],
        level_dbfs: float = -20.0,
        smooth: float = SURE,
        latency: float = 0.0,
    ) -> None:
        self.latency = latency
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
        share = self._smooth if touch is Touch.SMOOTH else 1 - SURE
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


def felt_of(
    scripted: Scripted, gate: ContactGate, sound: FloatArray, *, window: float = 0.032
) -> list[Prediction]:
    """Return what a detector says of sound whose windows a script answers, in the place
    of the model."""
    detector = TouchDetector(cast(WindowDetector, scripted), gate, window=window)
    heard = detector.take(AudioBlock(sound, RATE))
    numbers = cast(list[int], heard.windows)
    return detector.complete(heard, [scripted.predict(number) for number in numbers])


@pytest.mark.parametrize("decided", [Touch.SMOOTH, Touch.ROUGH])
def test_a_window_too_quiet_to_classify_leaves_the_last_decision_of_the_touch(
    decided: Touch,
) -> None:
    touches = [Touch.NONE] * 10 + [decided] * 10 + [Touch.NONE] * 5 + [Touch.NONE] * 5
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    sound[10 * HOP : 25 * HOP] = 0.1 * np.random.default_rng(0).standard_normal(
        (15 * HOP, 1)
    )
    gate = ContactGate(-40, sample_rate=RATE, rule="banded")
    found = felt_of(Scripted(touches), gate, sound)
    during = [each for each in found if 0.2 < each.end <= 0.25]
    assert {each.touch for each in during} == {decided}
    roughness = SURE if decided is Touch.ROUGH else 1 - SURE
    assert {round(each.roughness, 6) for each in during} == {round(roughness, 6)}
    assert found[-1].touch is Touch.NONE


def test_rough_outlasts_the_gates_level_by_a_short_pause() -> None:
    touches = [Touch.ROUGH] * 20 + [Touch.NONE] * 20
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    sound[: 20 * HOP] = 0.1 * np.random.default_rng(0).standard_normal((20 * HOP, 1))
    gate = ContactGate(-40, sample_rate=RATE, rule="banded", hold=0.1)
    found = felt_of(Scripted(touches), gate, sound)
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


@pytest.mark.parametrize("latency", [0.0, 0.01])
@pytest.mark.parametrize(
    ("over_db", "pause"), [(FADED_DB + 1, PAUSE), (FADED_DB - 1, FADED_PAUSE)]
)
def test_rough_outlasts_sound_that_fades_for_longer_than_sound_that_stops(
    over_db: float, pause: float, latency: float
) -> None:
    touches = [Touch.ROUGH] * 20 + [Touch.NONE] * 20
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    sound[: 20 * HOP] = 0.1 * np.random.default_rng(0).standard_normal((20 * HOP, 1))
    gate = ContactGate(-40, sample_rate=RATE, rule="banded", hold=0.1)
    scripted = Scripted(touches, -40 + over_db, latency=latency)
    found = felt_of(scripted, gate, sound)
    held_from = next(contact.time for contact in _contacts(sound) if contact.held)
    ends = max(each.end for each in found if each.touch is Touch.ROUGH) + latency
    assert held_from + pause - 0.01 <= ends < held_from + pause


@pytest.mark.parametrize(("level_dbfs", "waits"), [(-43.0, True), (-20.0, False)])
def test_a_window_quieter_than_contact_counts_once_contact_fills_half_of_it(
    level_dbfs: float, waits: bool
) -> None:
    window = 0.256
    touches = [Touch.NONE] * 100 + [Touch.ROUGH] * 40
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    sound[100 * HOP :] = 0.1 * np.random.default_rng(0).standard_normal((40 * HOP, 1))
    gate = ContactGate(-40, sample_rate=RATE, rule="banded")
    found = felt_of(Scripted(touches, level_dbfs), gate, sound, window=window)
    landed = next(each.end for each in found if each.touch is not Touch.NONE)
    rough = next(each.end for each in found if each.touch is Touch.ROUGH)
    assert (rough - landed > window / 2) is waits


def _contacts(sound: np.ndarray) -> list[Contact]:
    return ContactGate(-40, sample_rate=RATE, rule="banded", hold=0.1).push(
        AudioBlock(sound, RATE)
    )


@pytest.mark.parametrize(("lift", "remembered"), [(LIFT - 0.2, True), (LIFT, False)])
def test_a_brief_lift_keeps_the_verdict_and_a_longer_one_forgets_it(
    lift: float, remembered: bool
) -> None:
    away = round(lift / 0.01)
    touches = [Touch.ROUGH] * 20 + [Touch.NONE] * away + [Touch.NONE] * 10
    sound = np.zeros((len(touches) * HOP, 1), np.float32)
    loud = 0.1 * np.random.default_rng(0).standard_normal((20 * HOP, 1))
    sound[: 20 * HOP] = loud
    sound[-10 * HOP :] = loud[: 10 * HOP]
    gate = ContactGate(-40, sample_rate=RATE, rule="banded")
    found = felt_of(Scripted(touches), gate, sound)
    landed = [each for each in found if each.end > 0.01 * (20 + away) + 0.005]
    felt = {each.touch for each in landed if each.touch is not Touch.NONE}
    assert felt == {Touch.ROUGH if remembered else Touch.SMOOTH}


@pytest.mark.parametrize(
    ("smooth", "share", "remains"),
    [(3, SURE, True), (20, SURE, False), (3, 0.999, True), (20, 0.6, True)],
)
def test_rough_stands_until_smooth_is_evident(
    smooth: int, share: float, remains: bool
) -> None:
    touches = [Touch.ROUGH] * 60 + [Touch.SMOOTH] * smooth
    sound = 0.1 * np.random.default_rng(0).standard_normal(
        (len(touches) * HOP, 1)
    ).astype(np.float32)
    gate = ContactGate(-40, sample_rate=RATE, rule="banded")
    found = felt_of(Scripted(touches, smooth=share), gate, sound)
    assert found[-1].touch is (Touch.ROUGH if remains else Touch.SMOOTH)


def test_no_touch_turns_sooner_than_its_limits_say() -> None:
    assert LEAST < 0 < ROUGH_FROM < MOST
    windows_to_rough = -(-(ROUGH_FROM - LEAST) // GREATEST_STEP)
    touches = [Touch.ROUGH] * 20 + [Touch.SMOOTH] * 20
    sound = 0.1 * np.random.default_rng(0).standard_normal((40 * HOP, 1)).astype(
        np.float32
    )
    gate = ContactGate(-40, sample_rate=RATE, rule="banded")
    found = felt_of(Scripted(touches, smooth=1.0), gate, sound)
    begin = next(each.end for each in found if each.touch is not Touch.NONE)
    rough = [each.end for each in found if each.touch is Touch.ROUGH]
    assert rough[0] >= begin + 0.01 * (windows_to_rough - 1) - 0.001
    windows_to_smooth = -(-(MOST - LEAST) // GREATEST_STEP)
    assert rough[-1] == pytest.approx(0.01 * (20 + windows_to_smooth - 1), abs=0.006)


def test_every_rule_of_the_states_is_reached_and_leads_to_one_answer() -> None:
    moments = [
        Moment(*flags)
        for flags in itertools.product([False, True], repeat=len(Moment._fields))
    ]
    reached = {
        next(rule.when for rule in RULES if rule.holds(moment)) for moment in moments
    }
    assert reached == {rule.when for rule in RULES}
    assert set(ANSWERS) == {next_state(moment) for moment in moments} == set(TouchState)


def test_only_evident_roughness_of_what_sounds_like_touch_is_rough() -> None:
    for flags in itertools.product([False, True], repeat=len(Moment._fields)):
        moment = Moment(*flags)
        if next_state(moment) is TouchState.ROUGH:
            assert moment.touching
            assert moment.rough
            assert moment.sounds_like_touch
            assert not moment.faulty
            assert not moment.silent


@pytest.mark.parametrize("machine", [contact_state, touch_state])
def test_the_page_about_the_detector_shows_the_states_as_they_are(
    machine: ModuleType,
) -> None:
    page = Path(__file__).parents[5] / "docs" / "reference" / "detector.md"
    assert machine.describe() in page.read_text(encoding="utf-8"), (
        "run `python scripts/touch_states.py`"
    )


@pytest.mark.parametrize("size", [120, 480, 4_000])
def test_sound_may_wait_for_the_next_window_and_for_11_ms_at_most(size: int) -> None:
    detector = open_touch_detector("texture", sample_rate=48_000)
    silence = np.zeros((size, 2), np.float32)
    for start in range(0, 24_000, size):
        detector.push(AudioBlock(silence, 48_000, start))
        wait = detector.due - start - size
        assert 0 < wait <= LONGEST_WAIT * 48_000
