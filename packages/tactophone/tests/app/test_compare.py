"""Two recordings are put in order, from Python."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone.core.types import FloatArray
from tests.surfaces import RATE, scrape

SCREWS = Path(__file__).parents[4] / "tests" / "data" / "ramp" / "screws.flac"


def strokes(*, rough: bool) -> FloatArray:
    """Four strokes on a surface, by one microphone."""
    return np.concatenate(
        [scrape(rough=rough, seed=seed, channels=1) for seed in range(4)]
    )


def test_the_rougher_of_two_is_named_whichever_comes_first() -> None:
    rough, smooth = strokes(rough=True), strokes(rough=False)
    found = tactophone.compare(rough, smooth, sample_rate=RATE, tip="stylus")
    turned = tactophone.compare(smooth, rough, sample_rate=RATE, tip="stylus")
    assert (found.rougher, turned.rougher) == (0, 1)
    assert found.probability == pytest.approx(1 - turned.probability)
    assert found.certainty == pytest.approx(turned.certainty)


def test_an_object_beside_itself_is_not_sure() -> None:
    rough = strokes(rough=True)
    found = tactophone.compare(rough, rough, sample_rate=RATE, tip="stylus")
    assert (found.rougher, found.probability) == (None, 0.5)
    assert found.heard_enough


def test_files_are_compared_as_their_samples_are(tmp_path: Path) -> None:
    both = [strokes(rough=rough) for rough in (True, False)]
    paths = [tmp_path / f"{number}.wav" for number in range(2)]
    for path, samples in zip(paths, both, strict=True):
        soundfile.write(path, samples, RATE, subtype="FLOAT")
    assert tactophone.compare(*paths, tip="stylus") == tactophone.compare(
        *both, sample_rate=RATE, tip="stylus"
    )


def test_sound_unlike_any_touch_is_not_compared() -> None:
    found = tactophone.compare(SCREWS, SCREWS)
    assert not found.heard_enough
    assert (found.rougher, found.certainty) == (None, 0.5)
