import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.no_touch_sounds import NO_TOUCH_RATE, draw_no_touch
from tactophone.core.errors import ModelError
from tactophone.core.types import AudioBlock, Touch
from tactophone.signal.perception.detector import TouchDetector
from tactophone.signal.perception.model_file import Model, read_model
from tactophone.signal.perception.models import (
    model_path,
    open_touch_detector,
    shipped_models,
)
from tactophone.signal.perception.no_touch import (
    NO_TOUCH,
    NoTouchCheck,
    read_no_touch,
)

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


def copied(name: str, folder: Path) -> str:
    return str(shutil.copy(model_path(name), folder / "mine.onnx"))


WAYS: dict[str, Callable[[str, Path], str | Model]] = {
    "by name": lambda name, folder: name,
    "by path": lambda name, folder: str(model_path(name)),
    "by the path of a copy": copied,
    "as an object": lambda name, folder: read_model(model_path(name)),
}
"""How a model can be given."""


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", shipped_models())
def test_a_model_brings_the_same_checks_however_it_is_given(
    way: str, name: str, tmp_path: Path
) -> None:
    detector = open(WAYS[way](name, tmp_path))
    first = detector.window_detector
    assert (first.no_touch is not None) is (name == "stylus")
    assert (first.fit is not None) is (not name.startswith("paper"))
    if first.fit:
        named = open(name).window_detector
        assert named.fit
        assert (first.fit.tip, first.fit.air) == (named.fit.tip, named.fit.air)
        assert first.fit.tip == first.card.tip


def open(model: str | Model) -> TouchDetector:
    return open_touch_detector(model, sample_rate=NO_TOUCH_RATE, follow_floor=True)


def test_a_voice_is_taken_for_the_same_however_the_model_is_given(
    tmp_path: Path,
) -> None:
    sound = draw_no_touch("voice", 2.0, 500)
    block = AudioBlock(sound, NO_TOUCH_RATE)
    first, *others = [open(way("stylus", tmp_path)) for way in WAYS.values()]
    predictions = first.push(block)
    assert first.misfit
    for other in others:
        assert other.push(block) == predictions
        assert other.misfit == first.misfit


@pytest.mark.parametrize(
    "entry",
    [
        "loud",
        {"weights": [1.0]},
        {"weights": [1.0], "bias": 0.0},
        {"weights": [0.0] * 41 + [float("nan")], "bias": 0.0},
        {"weights": [0.0] * 42, "bias": float("inf")},
        {"weights": ["0"] * 42, "bias": 0.0},
    ],
)
def test_a_card_without_a_weight_for_each_feature_is_refused(entry: Any) -> None:
    model = read_model(model_path("stylus"))
    card = replace(model.card, settings={**model.card.settings, NO_TOUCH: entry})
    with pytest.raises(ModelError, match=r"no_touch in its card .*train it again"):
        read_no_touch(replace(model, card=card))


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
