"""Windows computed together are what each is alone, but for the last bits of what is
computed in one batch."""

from typing import Any

import numpy as np
import pytest

from tactophone.core.types import AudioBlock, FloatArray, Prediction
from tactophone.signal.perception.model_file import Engine, read_model
from tactophone.signal.perception.models import model_path
from tactophone.signal.perception.window_detector import (
    WindowDetector,
    classify_windows,
)
from tests.sounds import blocks, strokes

RATE = 48_000


def open_model(name: str) -> WindowDetector:
    return WindowDetector(read_model(model_path(name)), sample_rate=RATE)


def sounds(count: int) -> list[FloatArray]:
    """Strokes that begin at another time for each detector, the fifth and later without
    air."""
    contact = strokes()[:, 0]
    rolled = [np.roll(contact, 4800 * n)[: RATE // 2] for n in range(count)]
    return [
        np.stack((each, 0.1 * each * (n < 4)), axis=1) for n, each in enumerate(rolled)
    ]


def together(
    detectors: list[WindowDetector], samples: list[FloatArray], size: int
) -> list[list[Prediction]]:
    found: list[list[Prediction]] = [[] for _ in detectors]
    for parts in zip(*(blocks(each, size) for each in samples), strict=True):
        windows = [each.take(part) for each, part in zip(detectors, parts, strict=True)]
        new = classify_windows(detectors, windows)
        found = [before + after for before, after in zip(found, new, strict=True)]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ["texture", "stylus", "paper"])
@pytest.mark.parametrize("count", [1, 2, 5, 10])
def test_detectors_together_predict_what_each_does_alone(name: str, count: int) -> None:
    samples = sounds(count)
    found = together([open_model(name) for _ in samples], samples, 240)
    for own, each in zip(found, samples, strict=True):
        alone = open_model(name)
        expected = [
            prediction
            for block in blocks(each, 240)
            for prediction in alone.push(block)
        ]
        assert [(one.touch, one.level_dbfs, one.end) for one in own] == [
            (one.touch, one.level_dbfs, one.end) for one in expected
        ]
        probabilities, others = (
            [one.probabilities for one in predictions]
            for predictions in (own, expected)
        )
        assert np.array(probabilities) == pytest.approx(
            np.array(others), abs=1e-5 if name != "paper" else 0
        )
        assert own


def test_windows_that_fall_due_together_reach_the_network_together(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rows: list[int] = []
    run = Engine.run

    def count(engine: Engine, sound: FloatArray, *others: Any) -> Any:
        rows.append(len(sound))
        return run(engine, sound, *others)

    monkeypatch.setattr(Engine, "run", count)
    found = together([open_model("texture") for _ in range(5)], sounds(5), 240)
    assert rows == [5] * len(found[0])
    rows.clear()
    together(
        [open_model(name) for name in ("texture", "stylus", "texture")], sounds(3), 240
    )
    assert set(rows) == {1, 2}


def test_blocks_without_air_among_others_are_blocks_of_silent_air() -> None:
    samples = sounds(1)[0]
    silent, absent = open_model("texture"), open_model("texture")
    expected, found = [], []
    for number, block in enumerate(blocks(samples, 240)):
        channels = 1 + number % 2
        without_air = block.samples * np.float32([1, channels - 1])
        expected += silent.push(AudioBlock(without_air, RATE, block.start))
        found += absent.push(AudioBlock(block.samples[:, :channels], RATE, block.start))
    assert found == expected
    assert found
