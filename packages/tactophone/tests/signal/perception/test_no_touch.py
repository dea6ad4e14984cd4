import numpy as np

from benchmarks.no_touch_sounds import NO_TOUCH_RATE, draw_no_touch
from tactophone.core.types import AudioBlock, Touch
from tactophone.signal.perception.models import open_touch_detector
from tactophone.signal.perception.no_touch import NoTouchCheck

SMOOTH, ROUGH = (0.0, 0.8, 0.2), (0.0, 0.2, 0.8)


def test_a_voice_beside_the_air_microphone_is_noticed_and_then_never_rough() -> None:
    sound = draw_no_touch("voice", 6.0, 500)
    detector = open_touch_detector(
        "stylus", sample_rate=NO_TOUCH_RATE, follow_floor=True
    )
    noticed, after = np.inf, []
    for start in range(0, len(sound) - 160, 160):
        found = detector.push(
            AudioBlock(sound[start : start + 160], NO_TOUCH_RATE, start)
        )
        after += [each.touch for each in found if start / NO_TOUCH_RATE > noticed]
        if (
            noticed == np.inf
            and (misfit := detector.misfit)
            and misfit.code == "no-touch"
        ):
            noticed = start / NO_TOUCH_RATE
    assert noticed < 5.0
    assert Touch.SMOOTH in after
    assert Touch.ROUGH not in after


def test_one_window_is_no_notice_and_touch_ends_it() -> None:
    check = NoTouchCheck(np.ones(1, np.float32), 0.0)
    assert check.push(np.array([9.0], np.float32), ROUGH, loud=True)
    assert not check.noticed
    for _ in range(100):
        check.push(np.array([9.0], np.float32), ROUGH, loud=True)
    assert check.noticed
    assert check.push(np.array([-9.0], np.float32), ROUGH, loud=True)
    for _ in range(1000):
        check.push(np.array([-9.0], np.float32), SMOOTH, loud=True)
    assert not check.noticed


def test_a_smooth_touch_is_never_taken_for_speech() -> None:
    check = NoTouchCheck(np.ones(1, np.float32), 0.0)
    assert not any(
        check.push(np.array([9.0], np.float32), SMOOTH, loud=True) for _ in range(1000)
    )
