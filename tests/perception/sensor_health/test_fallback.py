import functools
from collections.abc import Sequence

import numpy as np
import pytest

from tactophone.perception import open_detector
from tactophone.perception.sensor_health.fallback import FallbackDetector, FallbackMode, fallback_for
from tactophone.perception.sensor_health.faults import FAULTS, FaultWatch, Kind, Reference, SensorFault
from tactophone.simulation import TAKES, SimulatedFinger, find, single, take_moves
from tactophone.simulation.physics.sensor_faults import CODES, FaultSpan, FaultySource
from tactophone.types import AIR, CONTACT, AudioBlock, Prediction, Touch

RATE = 48_000
REFERENCE = Reference(threshold_dbfs=-25.0, floor_dbfs=(-28.0, -60.0), hum_dbfs=(-31.0, -77.0), contrast_db=16.0)
BEGIN, END, SECONDS = 2.0, 4.0, 7.0


def judge() -> FallbackDetector:
    watch = FaultWatch(RATE, REFERENCE)
    full, spare = (open_detector(name, sample_rate=RATE) for name in ("paper", "paper-mono"))
    return FallbackDetector(full, spare, watch)


@functools.cache
def sound(code: str) -> AudioBlock:
    scene = single(find("lava stone"))
    moves = take_moves(TAKES[1], scene.placed[0], duration=SECONDS, rng=np.random.default_rng(1))
    finger = SimulatedFinger(scene, moves, seed=1, place=scene.placed[0].centre)
    spans = [FaultSpan(code, BEGIN, END)] if code else []
    return FaultySource(finger, spans).break_block(finger.render(round(SECONDS * RATE)))


@functools.cache
def beliefs(code: str, size: int = 4800) -> Sequence[Prediction]:
    guarded, block = judge(), sound(code)
    parts = (AudioBlock(block.samples[at : at + size], RATE, at) for at in range(0, block.size, size))
    return [belief for part in parts for belief in guarded.push(part)]


@pytest.mark.parametrize("code", CODES)
def test_no_fault_is_felt_as_rough_and_a_healed_one_changes_nothing(code: str) -> None:
    during = [one for one in beliefs(code) if BEGIN + 1 < one.end < END]
    healed = [one for one in beliefs(code) if one.end > SECONDS - 0.5]
    well = [one for one in beliefs("") if one.end > SECONDS - 0.5]
    if not code.startswith("air"):
        assert Touch.ROUGH not in {one.touch for one in during}
    if code.startswith("contact-clipped"):
        assert Touch.SMOOTH in {one.touch for one in during}
    elif not code.startswith("air"):
        assert {one.touch for one in during} == {Touch.NONE}
    assert healed == well


def test_without_the_air_microphone_the_one_channel_model_judges_on() -> None:
    guarded, block = judge(), sound("air-dead")
    guarded.push(AudioBlock(block.samples[: 4 * RATE], RATE))
    assert (guarded.answer, guarded.detector.name) == (
        FallbackMode.ONE_CHANNEL,
        open_detector("paper-mono", sample_rate=RATE).detector.name,
    )
    alone = open_detector("paper-mono", sample_rate=RATE).push(AudioBlock(block.samples, RATE))
    # The spare one began in the middle, so its windows lie elsewhere; the nearest ones are compared.
    fallen_back = [one for one in beliefs("air-dead") if BEGIN + 1.3 < one.end < END]
    nearest = [min(alone, key=lambda other, end=one.end: abs(other.end - end)) for one in fallen_back]
    agree = [one.touch is other.touch for one, other in zip(fallen_back, nearest, strict=True)]
    assert np.mean(agree) > 0.9


@pytest.mark.parametrize("size", [1, 17, 480, 509])
def test_blocks_of_any_size_give_the_same_beliefs(size: int) -> None:
    samples = sound("air-hum").samples[RATE * 5 // 2 :]
    seconds = 0.2 if size == 1 else 1.0
    heard = [judge(), judge()]
    for guarded in heard:
        guarded.push(AudioBlock(sound("air-hum").samples[: RATE * 5 // 2], RATE))
    assert heard[0].sensor_faults
    parts = [
        AudioBlock(samples[at : at + size], RATE, RATE * 5 // 2 + at) for at in range(0, int(seconds * RATE), size)
    ]
    whole = AudioBlock(np.concatenate([part.samples for part in parts]), RATE, parts[0].start)
    assert [belief for part in parts for belief in heard[0].push(part)] == heard[1].push(whole)


def test_reset_equals_new() -> None:
    guarded = judge()
    guarded.push(sound("swapped"))
    guarded.reset()
    assert guarded.sensor_faults == ()
    fresh = AudioBlock(sound("").samples[:RATE], RATE)
    assert guarded.push(fresh) == judge().push(fresh)


def test_the_worst_fault_decides() -> None:
    dead, clipped = SensorFault(Kind.DEAD, AIR), SensorFault(Kind.CLIPPED, CONTACT)
    assert fallback_for([], spare=True) is FallbackMode.JUDGE
    assert fallback_for([dead], spare=True) is FallbackMode.ONE_CHANNEL
    assert fallback_for([dead], spare=False) is FallbackMode.CONTACT_ONLY
    assert fallback_for([dead, clipped, SensorFault(Kind.SWAPPED)], spare=True) is FallbackMode.SILENCE
    assert all(fallback_for([fault], spare=True) > FallbackMode.JUDGE for fault in FAULTS)


def test_a_threshold_is_set_for_both_models() -> None:
    guarded = judge()
    guarded.threshold_dbfs = -30.0
    assert guarded.threshold_dbfs == -30.0
    guarded.push(sound("air-dead"))
    assert guarded.detector.threshold_dbfs == judge().detector.threshold_dbfs - judge().threshold_dbfs - 30.0


def test_lost_sound_begins_the_watch_anew() -> None:
    guarded = judge()
    guarded.push(AudioBlock(sound("contact-dead").samples[: 4 * RATE], RATE))
    assert guarded.sensor_faults
    guarded.push(AudioBlock(sound("").samples[:480], RATE, 10 * RATE))
    assert guarded.sensor_faults == ()
