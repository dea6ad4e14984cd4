"""One bad sample is one bad sample: whatever holds a state answers a second later as if
it had not been."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tactophone.app.hum import HumMeter
from tactophone.core.settings import Settings
from tactophone.core.types import PLAUSIBLE_PEAK, AudioBlock, FloatArray, joined
from tactophone.net.link.codec import Codec
from tactophone.net.link.stream import BlockEncoder
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import PASSTHROUGH
from tactophone.signal.perception.contact import ContactGate
from tactophone.signal.perception.events import EventDetector
from tactophone.signal.perception.health import FaultDetector, SignalStatistics
from tactophone.signal.perception.models import open_touch_detector
from tactophone.signal.perception.noise_floor import NoiseFloor, measure_floor
from tactophone.signal.pipeline import Hand, open_pipeline, open_pipeline_for
from tests.sounds import blocks, noise

RATE = 48_000

INVALID = (np.nan, np.inf, -np.inf, 3e29, -3e38, 8.001, -9.0)


def touched(duration: float = 4.0) -> FloatArray:
    """Silence, and a touch from 0.8 to 1.6 s and from 2.4 to 3.2 s on both
    microphones."""
    samples = noise(level_dbfs=-75, duration=duration)
    loud = noise(level_dbfs=-25, duration=duration, seed=1)
    for start in (0.8, 2.4):
        part = slice(round(start * RATE), round((start + 0.8) * RATE))
        samples[part] += loud[part] * np.array([1, 0.3], np.float32)
    return samples


def broken(samples: FloatArray, place: int, channel: int, value: float) -> FloatArray:
    samples = samples.copy()
    samples[place, channel] = value
    return samples


@pytest.mark.parametrize("value", INVALID)
def test_a_block_holds_no_sample_that_no_microphone_can_deliver(value: float) -> None:
    samples = noise(duration=0.01)
    block = AudioBlock(broken(samples, 4, 1, value), RATE)
    expected = broken(samples, 4, 1, 0.0)
    assert (block.samples == expected).all()
    assert block.invalid is not None
    assert np.argwhere(block.invalid).tolist() == [[4, 1]]


def test_the_places_of_invalid_samples_follow_their_sound() -> None:
    samples = noise(duration=0.01)
    block = AudioBlock(broken(samples, 4, 1, np.nan), RATE)
    after = AudioBlock(samples, RATE, block.end)
    (whole,) = joined([block, after])
    for part in (block.part(3, 6), block.select([1]), whole):
        assert part.invalid is not None
        assert part.invalid.shape == part.samples.shape
        assert part.invalid.sum() == 1
    contact = block.select([0]).invalid
    assert contact is not None
    assert not contact.any()


def test_sound_as_loud_as_a_microphone_may_be_is_left_as_it_is() -> None:
    samples = np.full((480, 2), PLAUSIBLE_PEAK, np.float32)
    block = AudioBlock(samples, RATE)
    assert block.samples is samples
    assert block.invalid is None


def answers_of_gate(bands: bool) -> Callable[[FloatArray], list[Any]]:
    def answers(samples: FloatArray) -> list[Any]:
        gate = ContactGate(
            -40.0,
            sample_rate=RATE,
            rule="banded",
            floor=NoiseFloor(-40.0),
            bands=bands,
            hold=0.1,
        )
        return [
            (each.time, each.touching, each.threshold_dbfs)
            for block in blocks(samples, 240)
            for each in gate.push(block)
        ]

    return answers


def of_predictions(steps: Any) -> list[Any]:
    """Return time, level, touch and probabilities of each prediction."""
    return [
        (
            prediction.end,
            prediction.level_dbfs,
            prediction.touch,
            *prediction.probabilities,
        )
        for step in steps
        for prediction in step.predictions
    ]


def answers_of_pipeline(samples: FloatArray) -> list[Any]:
    pipeline = open_pipeline(sample_rate=RATE, channels=2, events=True)
    return of_predictions(pipeline.push(block) for block in blocks(samples, 240))


def answers_of_receiver(samples: FloatArray) -> list[Any]:
    hand = Hand([open_pipeline_for(Settings(), channels=2)])
    return of_predictions(
        step for block in blocks(samples, 120) for step in hand.push(block)
    )


def answers_of_windows(samples: FloatArray) -> list[Any]:
    detector = open_touch_detector("paper", sample_rate=RATE, contact="window")
    return [
        (each.end, each.level_dbfs, *each.probabilities)
        for block in blocks(samples, 480)
        for each in detector.push(block)
    ]


def answers_of_statistics(samples: FloatArray) -> list[Any]:
    statistics = SignalStatistics(RATE)
    return [
        (each.end, *each.level_dbfs, *each.hum_dbfs, each.correlation)
        for block in blocks(samples, 480)
        for each in statistics.push(block)
    ]


def answers_of_faults(samples: FloatArray) -> list[Any]:
    detector, found = FaultDetector(RATE), []
    for block in blocks(samples, 480):
        detector.push(block)
        found.append((block.end / RATE, len(detector.faults)))
    return found


def answers_of_events(samples: FloatArray) -> list[Any]:
    detector = EventDetector(sample_rate=RATE, channels=2)
    kinds = ("contact", "tap", "knock", "stroke", "slip", "lift-off")
    return [
        (each.time, kinds.index(each.kind))
        for block in blocks(samples, 480)
        for each in detector.push(block)
    ]


def answers_of_encoder(samples: FloatArray) -> list[Any]:
    encoder = BlockEncoder(Codec("pcm16", channels=2, packet_size=240))
    return [
        (block.end / RATE, *np.frombuffer(each.content, ">i2")[:4].tolist())
        for block in blocks(samples, 240)
        for each in encoder.push(block)
    ]


def answers_of_passthrough(samples: FloatArray) -> list[Any]:
    passthrough = PASSTHROUGH["direct"](Limits())
    return [
        (
            block.end / RATE,
            float(np.abs(passthrough.push(block.samples)).max(initial=0)),
        )
        for block in blocks(samples, 480)
    ]


STAGES: dict[str, Callable[[FloatArray], list[Any]]] = {
    "contact by level": answers_of_gate(bands=False),
    "contact by bands": answers_of_gate(bands=True),
    "pipeline with events": answers_of_pipeline,
    "receiver with the microphone check": answers_of_receiver,
    "whole windows": answers_of_windows,
    "statistics": answers_of_statistics,
    "microphone faults": answers_of_faults,
    "touch events": answers_of_events,
    "packets": answers_of_encoder,
    "passthrough": answers_of_passthrough,
}
"""What each stage answers to sound: rows that begin with the time in s."""

CLOSE = {"contact by level": 0.3, "contact by bands": 0.3}
"""Decibels by which a threshold that follows the noise may still differ a second after
a sample was missing."""


@functools.cache
def clean_answers(name: str) -> list[Any]:
    return STAGES[name](touched())


@pytest.mark.slow
@pytest.mark.parametrize("name", STAGES)
@settings(max_examples=3, deadline=None, derandomize=True)
@given(
    value=st.sampled_from(INVALID),
    place=st.integers(0, round(2.5 * RATE)),
    channel=st.integers(0, 1),
)
def test_a_second_after_a_bad_sample_a_stage_answers_as_if_it_had_not_been(
    name: str, value: float, place: int, channel: int
) -> None:
    found = STAGES[name](broken(touched(), place, channel, value))
    after = place / RATE + 1.0
    later = [row for row in found if row[0] > after]
    expected = [row for row in clean_answers(name) if row[0] > after]
    assert len(later) == len(expected)
    if later:
        np.testing.assert_allclose(
            np.array(later, float),
            np.array(expected, float),
            atol=CLOSE.get(name, 0.02),
        )


@pytest.mark.parametrize("value", [np.nan, np.inf, 3e29])
def test_the_floor_of_a_recording_is_what_it_is_without_its_bad_sample(
    value: float,
) -> None:
    samples = touched()
    whole, hurt = (
        measure_floor(blocks(each, 4096), sample_rate=RATE, rule="banded")
        for each in (samples, broken(samples, RATE // 3, 0, value))
    )
    assert hurt.known
    assert hurt.floor_dbfs == pytest.approx(whole.floor_dbfs, abs=0.1)
    assert hurt.bands_dbfs == pytest.approx(whole.bands_dbfs, abs=0.1)


def test_hum_is_found_in_sound_with_a_bad_sample() -> None:
    time = np.arange(5 * RATE) / RATE
    hum = (0.05 * np.sin(2 * np.pi * 50 * time)).astype(np.float32)[:, None]
    samples = hum + noise(level_dbfs=-70, duration=5, channels=1)
    meter = HumMeter(RATE, 1)
    for block in blocks(broken(samples, RATE, 0, np.nan), 4096):
        meter.push(block.samples)
    found = meter.hum()
    assert found is not None
    assert found.mains == 50


def test_every_stroke_after_a_bad_sample_in_a_pause_is_felt() -> None:
    samples = broken(touched(), round(2.0 * RATE), 0, np.nan)
    pipeline = open_pipeline(sample_rate=RATE, channels=2)
    felt = [
        prediction.end
        for block in blocks(samples, 128)
        for prediction in pipeline.push(block).predictions
        if prediction.touch
    ]
    assert sum(2.4 < end < 3.2 for end in felt) > 70


def predictions_of_windows(samples: FloatArray) -> list[Any]:
    detector = open_touch_detector("paper", sample_rate=RATE, contact="window")
    return [
        prediction
        for block in blocks(samples, 480)
        for prediction in detector.push(block)
    ]


@pytest.mark.parametrize("place", [24_000, 30_011])
def test_every_window_that_a_sample_reaches_is_faulty_where_it_is_invalid(
    place: int,
) -> None:
    """The resampler spreads a sample over its neighbours, so that it reaches windows
    that end before it."""
    samples = noise(level_dbfs=-40, duration=1.5)
    valid = predictions_of_windows(samples)
    changed = predictions_of_windows(broken(samples, place, 0, 1.0))
    invalid = predictions_of_windows(broken(samples, place, 0, np.nan))
    reached = [
        number
        for number, (one, other) in enumerate(zip(valid, changed, strict=True))
        if one.probabilities != other.probabilities
    ]
    faulty = [number for number, each in enumerate(invalid) if each.faulty]
    assert reached
    assert set(reached) <= set(faulty)
    assert len(faulty) <= len(reached) + 2


def test_sound_after_a_long_gap_is_heard_as_if_it_began_there() -> None:
    begin = RATE + 30_000
    sound = noise(level_dbfs=-20, duration=0.6, seed=1)

    def heard(*, before: bool) -> list[Any]:
        detector = open_touch_detector("paper", sample_rate=RATE)
        if before:
            for block in blocks(noise(level_dbfs=-6), 480):
                detector.push(block)
        return [
            (round(each.end, 6), each.touch, *each.probabilities, each.level_dbfs)
            for start in range(0, len(sound), 480)
            for each in detector.push(
                AudioBlock(sound[start : start + 480], RATE, begin + start)
            )
        ]

    assert heard(before=True) == heard(before=False)
