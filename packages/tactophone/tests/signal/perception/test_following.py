"""The contact threshold of a whole detector that follows the noise."""

import numpy as np
import pytest

from tactophone.core.types import AudioBlock, FloatArray, Prediction, Touch
from tactophone.signal.perception.fallback import FallbackDetector
from tactophone.signal.perception.health import FaultDetector, Reference
from tactophone.signal.perception.models import open_touch_detector
from tests.sounds import blocks, noise

RATE = 48_000
REFERENCE = Reference(
    threshold_dbfs=-45.0,
    floor_dbfs=(-50.0, -60.0),
    hum_dbfs=(-80.0, -80.0),
    contrast_db=6.0,
)


def sound(gain_db: float = 0.0, seconds: float = 3.0) -> FloatArray:
    """Noise at -50 dBFS, and from 1.5 s on a stroke 24 dB over it that swells and
    fades."""
    samples = noise(level_dbfs=-50, duration=seconds)
    samples[:, 1] *= 0.3
    time = np.arange(len(samples) - RATE * 3 // 2) / RATE
    swell = 10 ** ((-26 + 5 * np.sin(2 * np.pi * 1.5 * time)) / 20)
    samples[RATE * 3 // 2 :] += swell[:, None] * noise(
        level_dbfs=0, duration=len(time) / RATE, seed=1
    )
    return np.asarray(samples * 10 ** (gain_db / 20), np.float32)


def predictions(
    samples: FloatArray, size: int = 4800, model: str = "texture"
) -> list[Prediction]:
    detector = open_touch_detector(model, sample_rate=RATE, follow_floor=True)
    return [
        prediction
        for block in blocks(samples, size)
        for prediction in detector.push(block)
    ]


@pytest.mark.slow
@pytest.mark.parametrize("size", [37, 480, 509])
@pytest.mark.parametrize("model", ["texture", "paper"])
def test_blocks_of_any_size_give_the_same_predictions(model: str, size: int) -> None:
    samples = sound(seconds=2.0)
    assert predictions(samples, size, model) == predictions(
        samples, len(samples), model
    )


@pytest.mark.parametrize("gain_db", [-30.0, 0.0, 10.0])
def test_a_touch_is_detected_within_milliseconds_at_any_gain(gain_db: float) -> None:
    found = predictions(sound(gain_db))
    assert not any(p.touch is not Touch.NONE for p in found if 0.7 < p.end < 1.48)
    first = next(p for p in found if p.end > 1.48 and p.touch is not Touch.NONE)
    assert first.end < 1.51
    held = [p.touch is not Touch.NONE for p in found if 1.6 < p.end < 2.9]
    assert np.mean(held) > 0.97


def test_an_assigned_threshold_wins_and_stays() -> None:
    detector = open_touch_detector("texture", sample_rate=RATE, follow_floor=True)
    detector.threshold.dbfs = -3.0
    assert detector.floor is None
    found = detector.push(AudioBlock(sound(), RATE))
    assert detector.threshold.dbfs == -3.0
    assert {p.touch for p in found} == {Touch.NONE}


def with_a_loose_microphone() -> FloatArray:
    silence = noise(level_dbfs=-50, duration=12.0)
    silence[:, 1] *= 0.3
    # A preamplifier without its microphone: 35 dB quieter, but no digital silence.
    silence[3 * RATE : 8 * RATE, 0] *= 10 ** (-35 / 20)
    return silence


@pytest.mark.slow
@pytest.mark.parametrize("size", [240, 701])
def test_a_faulty_microphone_changes_the_same_predictions_at_any_block_size(
    size: int,
) -> None:
    def found(size: int) -> list[Prediction]:
        main = open_touch_detector("texture", sample_rate=RATE, follow_floor=True)
        detector = FallbackDetector(main, FaultDetector(RATE, REFERENCE))
        return [
            p
            for block in blocks(with_a_loose_microphone(), size)
            for p in detector.push(block)
        ]

    assert found(size) == found(6000)


def test_a_faulty_microphone_leaves_the_floor_as_it_was() -> None:
    main = open_touch_detector("texture", sample_rate=RATE, follow_floor=True)
    detector = FallbackDetector(main, FaultDetector(RATE, REFERENCE))
    thresholds, touches = [], []
    for block in blocks(with_a_loose_microphone(), 6000):
        touches += [p for p in detector.push(block) if p.end > 1]
        thresholds.append(main.threshold.dbfs)
    assert thresholds[-1] == pytest.approx(thresholds[20], abs=1.0)
    assert np.mean([p.touch is not Touch.NONE for p in touches]) < 0.02
