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
from tactophone.signal.perception.model_file import ModelCard, read_model
from tactophone.signal.perception.models import model_path, open_touch_detector
from tactophone.signal.pipeline import Hand, open_pipeline
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.faults import CODES, FaultSpan, FaultySource
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES

RATE = 48_000
HOP = 512
REFERENCE = Reference(
    threshold_dbfs=-25.0,
    floor_dbfs=(-28.0, -60.0),
    hum_dbfs=(-31.0, -77.0),
    contrast_db=16.0,
)
BEGIN = 2.0
END = 4.0
SECONDS = 7.0


def open_checked(model: str = "paper") -> FallbackDetector:
    fault_detector = FaultDetector(RATE, REFERENCE)
    return FallbackDetector(
        open_touch_detector(model, sample_rate=RATE), fault_detector
    )


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
    detector, block = open_checked(), sound(code)
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
    assert Touch.ROUGH not in {p.touch for p in during}
    if code.startswith("contact-clipped"):
        assert Touch.SMOOTH in {p.touch for p in during}
    elif not code.startswith("air"):
        assert {p.touch for p in during} == {Touch.NONE}
    assert healed == well


def test_without_air_a_model_that_can_predicts_as_if_of_one_channel() -> None:
    block = sound("air-dead")
    detector = open_checked("texture")
    detector.push(block.part(0, 4 * RATE))
    assert detector.mode is FallbackMode.ONE_CHANNEL
    alone = open_touch_detector("texture", sample_rate=RATE)
    alone.push(block.part(0, 4 * RATE).select([CONTACT]))
    rest = block.part(4 * RATE, 5 * RATE)
    # What the graph remembers of the first two seconds has long been forgotten.
    here, there = detector.push(rest), alone.push(rest.select([CONTACT]))
    heard = [each for each in here if each.end < END]
    assert [each.touch for each in heard] == [
        each.touch for each in there[: len(heard)]
    ]


def test_without_the_air_microphone_a_model_that_needs_it_tells_contact_alone() -> None:
    detector = open_checked("paper")
    found = detector.push(sound("air-dead").part(0, 4 * RATE))
    assert detector.mode is FallbackMode.CONTACT_ONLY
    assert "the model paper needs both microphones" in detector.consequence
    later = {each.touch for each in found if each.end > BEGIN + 1.3}
    assert later == {Touch.NONE, Touch.SMOOTH}
    assert all(
        each.unknown is (each.touch is Touch.SMOOTH)
        for each in found
        if each.end > BEGIN + 1.3
    )


def test_a_model_is_not_blamed_where_the_contact_microphone_is_faulty_too() -> None:
    detector = open_checked("paper")
    detector.mode = FallbackMode.CONTACT_ONLY
    without_air = SensorFault(FaultKind.DEAD, AIR)
    detector.sensor_faults = (without_air,)
    assert "needs both microphones" in detector.consequence
    detector.sensor_faults = (without_air, SensorFault(FaultKind.CLIPPED, CONTACT))
    assert detector.consequence == "only contact is rendered"


@pytest.mark.slow
@pytest.mark.parametrize("size", [1, 17, 480, 509])
def test_blocks_of_any_size_give_the_same_predictions(size: int) -> None:
    # A check comes with the end of a window, up to a hop after its cell is full.
    known = RATE * 5 // 2 + HOP
    samples = sound("air-hum").samples[known:]
    seconds = 0.2 if size == 1 else 1.0
    pair = [open_checked(), open_checked()]
    for detector in pair:
        detector.push(AudioBlock(sound("air-hum").samples[:known], RATE))
    assert pair[0].sensor_faults
    parts = [
        AudioBlock(samples[at : at + size], RATE, known + at)
        for at in range(0, int(seconds * RATE), size)
    ]
    whole = AudioBlock(
        np.concatenate([part.samples for part in parts]), RATE, parts[0].start
    )
    assert [prediction for part in parts for prediction in pair[0].push(part)] == pair[
        1
    ].push(whole)


def test_reset_equals_new() -> None:
    detector = open_checked()
    detector.push(sound("swapped"))
    detector.reset()
    assert detector.sensor_faults == ()
    fresh = AudioBlock(sound("").samples[:RATE], RATE)
    assert detector.push(fresh) == open_checked().push(fresh)


def card_of(model: str) -> ModelCard:
    return read_model(model_path(model)).card


def test_the_worst_fault_decides() -> None:
    dead = SensorFault(FaultKind.DEAD, AIR)
    clipped = SensorFault(FaultKind.CLIPPED, CONTACT)
    swapped = SensorFault(FaultKind.SWAPPED)
    both = card_of("texture")
    assert fallback_mode([], both) is FallbackMode.FULL
    assert fallback_mode([dead], both) is FallbackMode.ONE_CHANNEL
    assert fallback_mode([dead, clipped], both) is FallbackMode.CONTACT_ONLY
    assert fallback_mode([dead, clipped, swapped], both) is FallbackMode.SILENCE
    assert all(fallback_mode([fault], both) > FallbackMode.FULL for fault in FAULTS)


@pytest.mark.parametrize(
    ("model", "channel", "channels", "expected"),
    [
        ("paper", AIR, 2, FallbackMode.CONTACT_ONLY),
        ("paper-mono", AIR, 2, FallbackMode.FULL),
        ("paper-mono", CONTACT, 2, FallbackMode.SILENCE),
        # A hard tip's model hears the air microphone alone, or the only one there is.
        ("stylus", AIR, 2, FallbackMode.SILENCE),
        ("stylus", CONTACT, 2, FallbackMode.FULL),
        ("stylus", CONTACT, 1, FallbackMode.SILENCE),
    ],
)
def test_a_dead_microphone_matters_as_far_as_the_model_hears_it(
    model: str, channel: int, channels: int, expected: FallbackMode
) -> None:
    dead = SensorFault(FaultKind.DEAD, channel)
    assert fallback_mode([dead], card_of(model), channels=channels) is expected


@pytest.mark.parametrize("code", ["contact-dead", "contact-hum", "swapped"])
@pytest.mark.parametrize("lost", [1, RATE // 10, RATE, -2 * RATE])
def test_no_loss_lets_a_broken_microphone_be_felt(code: str, lost: int) -> None:
    detector = open_checked()
    block = sound(code)
    known = round((BEGIN + 1.1) * RATE)
    detector.push(block.part(0, known))
    faults = detector.sensor_faults
    assert detector.mode is FallbackMode.SILENCE
    broken = block.samples[known : round(END * RATE)]
    after = detector.push(AudioBlock(broken, RATE, known + lost))
    assert after
    assert {prediction.touch for prediction in after} == {Touch.NONE}
    assert detector.sensor_faults == faults


def test_a_fault_is_found_and_healed_though_a_sample_is_lost_again_and_again() -> None:
    detector = open_checked()
    found = []
    for number, at in enumerate(range(0, round(SECONDS * RATE), 4800)):
        samples = sound("contact-dead").samples[at : at + 4800]
        detector.push(AudioBlock(samples, RATE, at + number))
        found.append(bool(detector.sensor_faults))
    # Within a second of its beginning and of its end, at ten blocks a second.
    assert found[30:40] == [True] * 10
    assert found[-10:] == [False] * 10


def test_a_repaired_microphone_is_used_again_after_a_break() -> None:
    detector = open_checked()
    detector.push(sound("contact-dead").part(0, 4 * RATE))
    assert detector.sensor_faults
    detector.push(AudioBlock(sound("").samples[: 2 * RATE], RATE, 10 * RATE))
    assert detector.sensor_faults == ()


@pytest.mark.parametrize("turn", [0, 3])
def test_each_sample_is_checked_once_however_long_a_run_lasts(turn: int) -> None:
    detector = open_checked()
    detector.take_turn(turn)
    checker = detector.fault_detector
    looked_at = []
    push = checker.push

    def counted(block: AudioBlock) -> bool:
        looked_at.append(block.size)
        return push(block)

    checker.push = counted  # type: ignore[method-assign]
    pushed = 3 * RATE
    detector.push(AudioBlock(np.zeros((pushed, 2), np.float32), RATE))
    # All but what comes before this finger's turn and what the next check is for.
    waiting = checker.cell_size + (turn + 1) * HOP
    assert pushed - waiting < sum(looked_at) <= pushed


def checks_of(hand: Hand, *, packet: int = 120, seconds: float = 1.5) -> list[set[int]]:
    """Return which fingers were checked with each packet."""
    rng = np.random.default_rng(0)
    checked: list[set[int]] = []
    fallbacks = [pipeline.detector for pipeline in hand.pipelines]

    def watch(finger: int, detector: FaultDetector) -> None:
        push = detector.push

        def pushed(block: AudioBlock) -> bool:
            checked[-1].add(finger)
            return push(block)

        detector.push = pushed  # type: ignore[method-assign]

    for finger, detector in enumerate(fallbacks):
        assert isinstance(detector, FallbackDetector)
        watch(finger, detector.fault_detector)
    for start in range(0, round(seconds * RATE), packet):
        noise = rng.normal(0, 0.001, (packet, 2 * hand.fingers)).astype(np.float32)
        checked.append(set())
        steps = list(hand.push(AudioBlock(noise, RATE, start)))
        predicted = any(step.predictions for step in steps)
        assert predicted or not checked[-1], "a check breaks the wait of a packet"
    return checked


@pytest.mark.parametrize("fingers", [1, 2, 10])
def test_the_checks_of_all_fingers_take_turns_and_come_with_a_window(
    fingers: int,
) -> None:
    hand = Hand([open_pipeline(sample_rate=RATE, channels=2) for _ in range(fingers)])
    checked = [found for found in checks_of(hand) if found]
    assert {finger for found in checked for finger in found} == set(range(fingers))
    assert max(map(len, checked)) == 1
