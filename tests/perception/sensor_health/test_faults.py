import functools

import numpy as np
import pytest

from tactophone.perception.sensor_health.faults import FAULTS, FaultWatch, Reference, explain
from tactophone.simulation import TAKES, SimulatedFinger, find, single, take_moves
from tactophone.simulation.physics.sensor_faults import CODES, FaultSpan, FaultySource
from tactophone.types import AudioBlock

RATE = 48_000
CALIBRATED = Reference(threshold_dbfs=-25.0, floor_dbfs=(-28.0, -60.0), hum_dbfs=(-31.0, -77.0), contrast_db=16.0)


@functools.cache
def stroked(name: str, seconds: float = 8.0) -> AudioBlock:
    scene = single(find(name))
    moves = take_moves(TAKES[1], scene.placed[0], duration=seconds, rng=np.random.default_rng(1))
    return SimulatedFinger(scene, moves, seed=1, place=scene.placed[0].centre).render(int(seconds * RATE))


def named(code: str, block: AudioBlock, reference: Reference | None) -> list[tuple[float, list[str]]]:
    """Faults named over time, at each change."""
    source = FaultySource(SimulatedFinger(single(find("3"))), [FaultSpan(code, 3.0, 5.0)] if code else [])
    watch, told, before = FaultWatch(RATE, reference), [], ()
    for start in range(0, block.size, 2400):
        samples = block.samples[start : start + 2400]
        watch.push(source.break_block(AudioBlock(samples, RATE, start)))
        if watch.faults != before:
            before = watch.faults
            told.append((start / RATE, [fault.code for fault in before]))
    return told


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("reference", [None, CALIBRATED], ids=["uncalibrated", "calibrated"])
def test_each_fault_alone_is_named_within_a_second_and_heals(code: str, reference: Reference | None) -> None:
    told = named(code, stroked("lava stone"), reference)
    (begun, during), (ended, after) = told
    assert during == [code]
    assert 3.0 < begun <= 4.0
    assert after == []
    # Without a calibration, only a strong touch shows that the air microphone hears again.
    assert 5.0 < ended <= (8.0 if code == "air-covered" else 7.0)


@pytest.mark.parametrize("name", ["lava stone", "polished marble", "whiteboard"])
def test_a_good_set_up_has_no_faults(name: str) -> None:
    assert named("", stroked(name), None) == named("", stroked(name), CALIBRATED) == []


def test_a_covered_microphone_is_known_in_a_quiet_room_once_calibrated() -> None:
    told = named("air-covered", stroked("polished marble"), CALIBRATED)
    assert told[0][1] == ["air-covered"]


def test_what_cannot_be_seen_neither_raises_nor_heals() -> None:
    watch = FaultWatch(RATE, CALIBRATED)
    hum = 0.3 * np.sin(2 * np.pi * 50 * np.arange(RATE) / RATE)
    quiet = np.random.default_rng(0).normal(0, 0.01, (RATE, 2))
    watch.push(block(quiet + hum[:, None] * [1, 0]))
    assert [fault.code for fault in watch.faults] == ["contact-hum"]
    # Noise about the mains' harmonics, three times as strong as what would be called hum.
    steps = np.random.default_rng(1).normal(0, 1, (2, 1440))
    loud = np.stack([np.interp(np.arange(3 * RATE) / 100, np.arange(1440), walk) for walk in steps], axis=1)
    watch.push(block(0.3 * loud / loud.std()))
    assert [fault.code for fault in watch.faults] == ["contact-hum"]
    watch.push(block(np.concatenate([quiet, quiet])))
    assert watch.faults == ()


def test_reset_equals_new() -> None:
    watch = FaultWatch(RATE, CALIBRATED)
    watch.push(block(np.zeros((RATE, 2))))
    assert watch.faults
    watch.reset()
    assert watch.faults == ()


def test_one_channel_is_watched_for_what_one_can_have() -> None:
    watch = FaultWatch(RATE, CALIBRATED)
    watch.push(block(np.zeros((RATE, 1))))
    assert [fault.code for fault in watch.faults] == ["contact-dead"]


def test_digital_silence_is_no_fault_where_nobody_knows_how_silence_sounds() -> None:
    watch = FaultWatch(RATE)
    watch.push(block(np.zeros((RATE, 2))))
    assert watch.faults == ()


def test_every_fault_says_what_to_do_and_can_be_made() -> None:
    assert {fault.code for fault in FAULTS} == set(CODES)
    assert explain(FAULTS[:1]).startswith("contact microphone dead: ")


def block(samples: np.ndarray) -> AudioBlock:
    return AudioBlock(samples.astype(np.float32), RATE)
