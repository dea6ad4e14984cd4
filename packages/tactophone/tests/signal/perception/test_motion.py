"""What contact is while a robot says that it starts or stops."""

from collections.abc import Sequence

import numpy as np
import pytest

from tactophone.core.types import AudioBlock, FloatArray
from tactophone.signal.perception.contact import PERSISTENT, Contact, ContactGate
from tactophone.signal.perception.noise_floor import NoiseFloor
from tactophone.signal.pipeline import Hand, open_pipeline
from tests.sounds import noise

RATE = 48_000
PACKET = 120


def sound(*loud: tuple[float, float], seconds: float = 4.0) -> FloatArray:
    """Noise at -60 dBFS, and at -30 dBFS from each moment to the next."""
    samples = noise(level_dbfs=-60, duration=seconds, channels=1)
    for begin, end in loud:
        samples[round(begin * RATE) : round(end * RATE)] *= 10 ** (30 / 20)
    return samples.astype(np.float32)


def contacts(
    samples: FloatArray, turns: Sequence[float] = (), *, bands: bool = True
) -> list[Contact]:
    """Return what the gate reports of a robot that starts at the first of these times,
    stops at the next, and so on."""
    gate = ContactGate(
        -38,
        sample_rate=RATE,
        rule="banded",
        floor=NoiseFloor(-38),
        bands=bands,
        hold=0.1,
    )
    found = []
    for start in range(0, len(samples), PACKET):
        moving = sum(turn * RATE <= start for turn in turns) % 2 == 1
        found += gate.push(
            AudioBlock(samples[start : start + PACKET], RATE, start, moving=moving)
        )
    return found


def begins(found: Sequence[Contact], after: float = 0.0) -> float:
    return next(
        (each.time for each in found if each.touching and each.time >= after), np.inf
    )


@pytest.mark.parametrize("bands", [False, True])
@pytest.mark.parametrize("turns", [(2.0,), (1.0, 2.0)])
def test_the_jerk_of_a_start_or_a_stop_is_no_contact(
    turns: tuple[float, ...], bands: bool
) -> None:
    jerk = sound((2.01, 2.11))
    assert begins(contacts(jerk, bands=bands)) < 2.02
    assert begins(contacts(jerk, turns, bands=bands)) == np.inf


@pytest.mark.parametrize("bands", [False, True])
def test_a_touch_during_a_start_counts_150_ms_later_and_then_stays(bands: bool) -> None:
    found = contacts(sound((2.1, 3.0)), (2.0,), bands=bands)
    assert begins(found) - 2.1 == pytest.approx(PERSISTENT, abs=0.01)
    assert all(each.touching for each in found if begins(found) < each.time < 3.0)


def test_a_jerk_heard_before_the_robot_says_that_it_starts_ends_at_once() -> None:
    found = contacts(sound((1.95, 2.05)), (2.0,))
    assert begins(found) < 1.96
    assert begins(found, after=2.002) == np.inf


def test_a_landing_that_stops_the_robot_is_felt_without_a_gap() -> None:
    found = contacts(sound((1.98, 3.0)), (1.0, 2.0))
    assert begins(found) < 1.99
    assert all(each.touching for each in found if 1.99 < each.time < 3.0)


def test_a_touch_that_has_lasted_goes_on_through_starts_and_stops() -> None:
    found = contacts(sound((1.0, 3.0)), (1.5, 1.8, 2.1, 2.4))
    assert all(each.touching for each in found if 1.01 < each.time < 3.0)


def test_a_robot_that_says_nothing_or_moves_steadily_delays_no_contact() -> None:
    touch = sound((2.6, 3.0))
    assert begins(contacts(touch, (2.0,))) == begins(contacts(touch)) < 2.61


def test_endless_claims_of_starts_and_stops_delay_contact_by_150_ms_at_most() -> None:
    found = contacts(sound((2.0, 4.0)), np.arange(1.0, 4.0, 0.02).tolist())
    assert begins(found) - 2.0 < PERSISTENT + 0.02
    assert all(each.touching for each in found if begins(found) < each.time < 4.0)


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [1, 2])
def test_packets_that_wait_for_the_next_keep_what_the_robot_says(fingers: int) -> None:
    touch = np.repeat(sound((2.06, 3.0)), 2 * fingers, axis=1)

    def commands(start: float) -> list[tuple[int, float, float]]:
        pipelines = [
            open_pipeline(sample_rate=RATE, channels=2, check_microphones=False)
            for _ in range(fingers)
        ]
        hand, found = Hand(pipelines), []
        for begin in range(0, len(touch), PACKET):
            block = AudioBlock(
                touch[begin : begin + PACKET], RATE, begin, moving=begin >= start * RATE
            )
            found += [
                (step.finger, each.time, each.amplitude)
                for step in hand.push(block)
                for each in step.commands
            ]
        return found

    for finger in range(fingers):
        begun = [
            next(
                time
                for place, time, amplitude in commands(start)
                if place == finger and amplitude
            )
            for start in (9.0, 2.0)
        ]
        assert begun[1] - begun[0] == pytest.approx(PERSISTENT, abs=0.01)
