"""One microphone on an interface of two inputs is sound of one channel, whichever input
it is on."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.settings import Settings
from tactophone.core.types import AudioBlock, FloatArray, Prediction, Touch
from tactophone.signal.perception.fallback import FallbackDetector, FallbackMode
from tactophone.signal.perception.health import FaultDetector, Reference
from tactophone.signal.perception.opening import DetectorOptions, open_detector
from tactophone.signal.pipeline import open_pipeline_for
from tests.sounds import blocks

RATE = 48_000


def microphone(seconds: float = 7.0) -> FloatArray:
    """Silence, and two strokes of 1.5 s from 2.0 and from 4.5 s on."""
    random = np.random.default_rng(1)
    size = round(RATE * seconds)
    samples = random.normal(0, 1e-3, size)
    time = np.arange(size) / RATE
    stroke = random.normal(0, 0.08, size) * (
        0.4 + np.abs(np.sin(2 * np.pi * 23 * time))
    )
    samples += stroke * (((time > 2) & (time < 3.5)) | ((time > 4.5) & (time < 6)))
    return samples.astype(np.float32)


def beside_an_open_input(level_dbfs: float, used: int) -> FloatArray:
    """Return sound of a microphone on one input, and of a converter on the other."""
    own = microphone()
    noise = np.random.default_rng(2).normal(0, 10 ** (level_dbfs / 20), len(own))
    pair = [noise, noise]
    pair[used] = own
    return np.stack(pair, axis=1).astype(np.float32)


def live(samples: FloatArray) -> list[Prediction]:
    pipeline = open_pipeline_for(Settings(), channels=samples.shape[1])
    return [
        prediction
        for block in blocks(samples, 240)
        for prediction in pipeline.push(block).predictions
    ]


def recorded(samples: FloatArray, path: Path) -> list[Prediction]:
    soundfile.write(path, samples, RATE, subtype="PCM_24")
    return [
        prediction
        for step in tactophone.open_recording(path).steps()
        for prediction in step.predictions
    ]


def touches(found: list[Prediction], *, after: float = 0.0) -> list[tuple[int, Touch]]:
    return [(round(100 * each.end), each.touch) for each in found if each.end > after]


@pytest.mark.slow
@pytest.mark.parametrize("used", [CONTACT, AIR])
@pytest.mark.parametrize("level_dbfs", [-80.0, -92.0, -100.0, -120.0])
def test_a_recording_beside_an_open_input_is_one_of_one_channel(
    level_dbfs: float, used: int, tmp_path: Path
) -> None:
    samples = beside_an_open_input(level_dbfs, used)
    pair = recorded(samples, tmp_path / "pair.wav")
    alone = recorded(samples[:, used : used + 1], tmp_path / "alone.wav")
    assert touches(pair) == touches(alone)
    assert 0.3 < np.mean([each.touch is not Touch.NONE for each in pair]) < 0.6


@pytest.mark.slow
@pytest.mark.parametrize("used", [CONTACT, AIR])
@pytest.mark.parametrize("level_dbfs", [-80.0, -92.0, -100.0, -120.0])
def test_live_sound_beside_an_open_input_is_of_one_channel_once_that_was_found(
    level_dbfs: float, used: int
) -> None:
    samples = beside_an_open_input(level_dbfs, used)
    pair, alone = live(samples), live(samples[:, used : used + 1])
    # The first touch shows that the other input is open; the next is felt in full.
    ours, theirs = (
        [touch for _, touch in touches(found, after=4.4)] for found in (pair, alone)
    )
    felt, expected = (
        sum(touch is not Touch.NONE for touch in each) for each in (ours, theirs)
    )
    if used == AIR and level_dbfs > -90:
        # Found during a touch, from which the noise of the other input had to be
        # learnt anew: where it errs, it is quiet.
        assert 0.5 * expected < felt <= expected
        return
    rough, roughly = (
        sum(touch is Touch.ROUGH for touch in each) for each in (ours, theirs)
    )
    assert felt == pytest.approx(expected, rel=0.05)
    assert rough == pytest.approx(roughly, rel=0.1)


def opened(calibrated: bool = False) -> FallbackDetector:
    detector = open_detector(DetectorOptions(sample_rate=RATE, channels=2))
    assert isinstance(detector, FallbackDetector)
    if calibrated:
        return FallbackDetector(detector.main, FaultDetector(RATE, Reference(-25.0)))
    return detector


def push(detector: FallbackDetector, samples: FloatArray, start: int = 0) -> int:
    """Push sound that begins at sample ``start``; returns where it ends."""
    for block in blocks(samples, 480):
        detector.push(AudioBlock(block.samples, RATE, start + block.start))
    return start + len(samples)


def test_an_input_that_comes_back_is_used_again() -> None:
    detector = opened()
    end = push(detector, beside_an_open_input(-100, AIR)[: 4 * RATE])
    assert detector.mode is FallbackMode.ONE_CHANNEL
    both = np.stack([microphone(), 0.3 * np.roll(microphone(), 90)], axis=1)
    end = push(detector, both, end)
    assert detector.mode is FallbackMode.FULL


def test_the_air_microphone_takes_no_broken_contact_microphones_place() -> None:
    detector = opened()
    both = np.stack([microphone(), 0.3 * np.roll(microphone(), 90)], axis=1)
    end = push(detector, both[: 4 * RATE])
    assert detector.mode is FallbackMode.FULL
    push(detector, beside_an_open_input(-100, AIR), end)
    assert detector.mode is FallbackMode.SILENCE


def test_nor_does_it_where_a_calibration_says_that_both_are_there() -> None:
    detector = opened(calibrated=True)
    push(detector, beside_an_open_input(-100, AIR)[: 4 * RATE])
    assert detector.mode is FallbackMode.SILENCE


def test_two_quiet_microphones_are_not_open() -> None:
    quiet = np.random.default_rng(0).normal(0, 1e-4, (3 * RATE, 2)).astype(np.float32)
    detector = opened()
    push(detector, quiet * np.array([1.0, 0.5], np.float32))
    assert not [fault for fault in detector.sensor_faults if "open" in fault.code]
