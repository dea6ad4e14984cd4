import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone_lab.recording.protocol import Key, Protocol, Stage
from tactophone_lab.simulation.takes import TAKES

RATE = 1000


def protocol(**options: object) -> Protocol:
    return Protocol(
        TAKES, **{"sample_rate": RATE, "duration": 2.0, "countdown": 0.5, **options}
    )


def feed(machine: Protocol, seconds: float, size: int = 100) -> int:
    """Push sound; return how many samples were recorded."""
    return sum(
        machine.push(
            AudioBlock(
                np.zeros((min(size, round(seconds * RATE) - start), 2), np.float32),
                RATE,
            )
        ).size
        for start in range(0, round(seconds * RATE), size)
    )


def test_the_paper_has_seven_takes() -> None:
    assert [take.name for take in TAKES] == [
        "long_light",
        "long_medium",
        "long_loud",
        "short_light",
        "short_medium",
        "short_loud",
        "wiggle",
    ]
    assert all(take.instruction for take in TAKES)


@pytest.mark.parametrize("size", [1, 17, 480, 5000])
def test_a_take_is_counted_down_recorded_to_the_sample_and_reviewed(size: int) -> None:
    machine = protocol()
    assert feed(machine, 1.0, size) == 0
    machine.press(Key.GO)
    assert machine.stage is Stage.COUNTDOWN
    assert feed(machine, 3.0, size) == 2 * RATE or size == 5000
    assert machine.stage is Stage.REVIEW
    machine.press(Key.GO)
    assert (machine.stage, machine.take.name, machine.number) == (
        Stage.READY,
        "long_medium",
        2,
    )


def test_all_takes_lead_to_the_end() -> None:
    machine = protocol()
    for _ in TAKES:
        machine.press(Key.GO)
        assert feed(machine, 2.6) == 2 * RATE
        machine.press(Key.GO)
    assert machine.stage is Stage.DONE
    machine.press(Key.GO)
    assert machine.stage is Stage.DONE


def test_pausing_keeps_what_there_is_and_notes_where() -> None:
    machine = protocol()
    machine.press(Key.GO)
    taken = feed(machine, 1.5)
    machine.press(Key.GO)
    assert machine.stage is Stage.PAUSED
    assert feed(machine, 5.0) == 0
    machine.press(Key.GO)
    assert taken + feed(machine, 5.0) == 2 * RATE
    assert machine.pauses == (1.0,)


@pytest.mark.parametrize("seconds", [1.0, 4.0])
def test_a_retake_begins_the_same_take_anew(seconds: float) -> None:
    machine = protocol()
    machine.press(Key.GO)
    feed(machine, seconds)
    machine.press(Key.RETAKE)
    assert (machine.stage, machine.take.name) == (Stage.READY, "long_light")
    machine.press(Key.GO)
    assert feed(machine, 4.0) == 2 * RATE


def test_keys_that_make_no_sense_do_nothing() -> None:
    machine = protocol()
    machine.press(Key.RETAKE)
    assert machine.stage is Stage.READY
    machine.press(Key.GO)
    machine.press(Key.GO)
    assert machine.stage is Stage.COUNTDOWN


def test_finished_takes_are_skipped() -> None:
    assert protocol(done=("long_light", "wiggle")).take.name == "long_medium"
    everything = protocol(done=[take.name for take in TAKES])
    assert everything.stage is Stage.DONE


def test_remaining_time_is_reported() -> None:
    machine = protocol()
    machine.press(Key.GO)
    assert machine.remaining == 0.5
    feed(machine, 1.0)
    assert machine.remaining == pytest.approx(1.5)
