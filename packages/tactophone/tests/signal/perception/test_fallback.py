import functools
from collections.abc import Sequence

import numpy as np
import pytest

from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.types import AudioBlock, Prediction, Touch
from tactophone.signal.perception.fallback import (
    FallbackDetector,
    FallbackMode,
    fallback_mode,
)
from tactophone.signal.perception.health import (
    FAULTS,
    FaultDetector,
    FaultKind,
    Reference,
    SensorFault,
)
from tactophone.signal.perception.models import open_detector
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.faults import CODES, FaultSpan, FaultySource
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES

RATE = 48_000
REFERENCE = Reference(
    threshold_dbfs=-25.0,
    floor_dbfs=(-28.0, -60.0),
    hum_dbfs=(-31.0, -77.0),
    contrast_db=16.0,
)
BEGIN, END, SECONDS = 2.0, 4.0, 7.0


def open_both() -> FallbackDetector:
    fault_detector = FaultDetector(RATE, REFERENCE)
    full, spare = (
        open_detector(name, sample_rate=RATE) for name in ("paper", "paper-mono")
    )
    return FallbackDetector(full, spare, fault_detector)


@functools.cache
def sound(code: str) -> AudioBlock:
    scene = single(find("lava stone"))
    moves = take_moves(
        TAKES[1], scene.placed[0], duration=SECONDS, rng=np.random.default_rng(1)
    )
    finger = SimulatedFinger(scene, moves, seed=1, place=scene.placed[0].centre)
    spans = [FaultSpan(code, BEGIN, END)] if code else []
    return FaultySource(finger, spans).apply(finger.render(round(SECONDS * RATE)))


@functools.cache
def predictions(code: str, size: int = 4800) -> Sequence[Prediction]:
    detector, block = open_both(), sound(code)
    parts = (
        AudioBlock(block.samples[at : at + size], RATE, at)
        for at in range(0, block.size, size)
    )
    return [prediction for part in parts for prediction in detector.push(part)]


@pytest.mark.slow
@pytest.mark.parametrize("code", CODES)
def test_no_fault_is_reported_as_rough_and_a_healed_one_changes_nothing(
    code: str,
) -> None:
    during = [p for p in predictions(code) if BEGIN + 1 < p.end < END]
    healed = [p for p in predictions(code) if p.end > SECONDS - 0.5]
    well = [p for p in predictions("") if p.end > SECONDS - 0.5]
    if not code.startswith("air"):
        assert Touch.ROUGH not in {p.touch for p in during}
    if code.startswith("contact-clipped"):
        assert Touch.SMOOTH in {p.touch for p in during}
    elif not code.startswith("air"):
        assert {p.touch for p in during} == {Touch.NONE}
    assert healed == well


def test_without_the_air_microphone_the_one_channel_model_goes_on() -> None:
    detector, block = open_both(), sound("air-dead")
    detector.push(AudioBlock(block.samples[: 4 * RATE], RATE))
    assert (detector.mode, detector.name) == (
        FallbackMode.ONE_CHANNEL,
        open_detector("paper-mono", sample_rate=RATE).name,
    )
    alone = open_detector("paper-mono", sample_rate=RATE).push(
        AudioBlock(block.samples, RATE)
    )
    # The spare one began in the middle, so its windows lie elsewhere; the nearest ones
    # are compared.
    fallen_back = [p for p in predictions("air-dead") if BEGIN + 1.3 < p.end < END]
    nearest = [
        min(alone, key=lambda other, end=p.end: abs(other.end - end))
        for p in fallen_back
    ]
    agree = [
        p.touch is other.touch for p, other in zip(fallen_back, nearest, strict=True)
    ]
    assert np.mean(agree) > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 17, 480, 509])
def test_blocks_of_any_size_give_the_same_predictions(size: int) -> None:
    samples = sound("air-hum").samples[RATE * 5 // 2 :]
    seconds = 0.2 if size == 1 else 1.0
    pair = [open_both(), open_both()]
    for detector in pair:
        detector.push(AudioBlock(sound("air-hum").samples[: RATE * 5 // 2], RATE))
    assert pair[0].sensor_faults
    parts = [
        AudioBlock(samples[at : at + size], RATE, RATE * 5 // 2 + at)
        for at in range(0, int(seconds * RATE), size)
    ]
    whole = AudioBlock(
        np.concatenate([part.samples for part in parts]), RATE, parts[0].start
    )
    assert [prediction for part in parts for prediction in pair[0].push(part)] == pair[
        1
    ].push(whole)


def test_reset_equals_new() -> None:
    detector = open_both()
    detector.push(sound("swapped"))
    detector.reset()
    assert detector.sensor_faults == ()
    fresh = AudioBlock(sound("").samples[:RATE], RATE)
    assert detector.push(fresh) == open_both().push(fresh)


def test_the_worst_fault_decides() -> None:
    dead, clipped = (
        SensorFault(FaultKind.DEAD, AIR),
        SensorFault(FaultKind.CLIPPED, CONTACT),
    )
    assert fallback_mode([], spare=True) is FallbackMode.FULL
    assert fallback_mode([dead], spare=True) is FallbackMode.ONE_CHANNEL
    assert fallback_mode([dead], spare=False) is FallbackMode.CONTACT_ONLY
    assert (
        fallback_mode([dead, clipped, SensorFault(FaultKind.SWAPPED)], spare=True)
        is FallbackMode.SILENCE
    )
    assert all(
        fallback_mode([fault], spare=True) > FallbackMode.FULL for fault in FAULTS
    )


def test_a_threshold_is_set_for_both_models() -> None:
    detector = open_both()
    detector.threshold.dbfs = -30.0
    assert detector.threshold.dbfs == -30.0
    detector.push(sound("air-dead"))
    own = open_both()
    assert (
        detector.active.detector.threshold_dbfs
        == own.active.detector.threshold_dbfs - own.threshold.dbfs - 30.0
    )


def test_lost_sound_resets_the_fault_detector() -> None:
    detector = open_both()
    detector.push(AudioBlock(sound("contact-dead").samples[: 4 * RATE], RATE))
    assert detector.sensor_faults
    detector.push(AudioBlock(sound("").samples[:480], RATE, 10 * RATE))
    assert detector.sensor_faults == ()
