from tactophone.perception.debounce import CLEAR_DB, IN_A_ROW, ContactDebounce
from tactophone.types import Prediction, Touch

THRESHOLD = -40.0


def debounced(levels: list[float]) -> list[bool]:
    contact = ContactDebounce()
    touches = [Touch.SMOOTH if level >= THRESHOLD else Touch.NONE for level in levels]
    return [
        contact.update(Prediction((0.0, 1.0, 0.0), touch, 0.0, level, start=0.0, end=0.032), threshold_dbfs=THRESHOLD)
        for level, touch in zip(levels, touches, strict=True)
    ]


def test_noise_that_passes_the_threshold_now_and_then_is_no_touch() -> None:
    assert not any(debounced([-39.0, -39.0, -42.0, -39.0, -42.0, -39.0, -39.0, -41.0]))


def test_a_clear_touch_is_contact_at_once_and_lasts_while_it_is_loud() -> None:
    assert debounced([-50.0, THRESHOLD + CLEAR_DB, -39.0, -39.5, -41.0, -39.0]) == [
        False,
        True,
        True,
        True,
        False,
        False,
    ]


def test_a_faint_touch_is_contact_once_it_has_lasted() -> None:
    assert debounced([-39.0] * (IN_A_ROW + 1)) == [False] * (IN_A_ROW - 1) + [True] * 2


def test_reset_equals_new() -> None:
    contact = ContactDebounce()
    loud = Prediction((0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, -20.0, start=0.0, end=0.032)
    faint = Prediction((0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, -39.0, start=0.0, end=0.032)
    assert contact.update(loud, threshold_dbfs=THRESHOLD)
    contact.reset()
    assert not contact.update(faint, threshold_dbfs=THRESHOLD)
