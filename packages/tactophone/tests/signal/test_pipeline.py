import subprocess
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from tactophone.core.errors import ConfigError
from tactophone.core.types import (
    AudioBlock,
    ContactRule,
    ContactThreshold,
    FloatArray,
    HapticCommand,
    Prediction,
    Touch,
)
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.profiles import (
    PROFILES,
    PaperProfile,
    Stimulus,
    open_profile,
)
from tactophone.signal.pipeline import Hand, Pipeline, open_pipeline
from tests.models import write_tiny_model
from tests.sounds import ODD_SIZES, blocks, strokes, tone

RATE = 48_000
HOP = 512 / RATE

SECOND_STROKE = 1.5
"""When the second stroke of `strokes` begins, in s."""


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(write_tiny_model(tmp_path / "tiny.onnx"))


def pipeline_of(
    model: str, *, contact: ContactRule = "bands", sample_rate: int = RATE
) -> Pipeline:
    return open_pipeline(
        model, sample_rate=sample_rate, channels=1, profile="paper", contact=contact
    )


def stimulus(touch: Touch, roughness: float) -> Prediction:
    return Prediction(
        (0.0, 1 - roughness, roughness), touch, roughness, -20.0, 0.0, 0.256
    )


def processed(
    pipeline: Pipeline, samples: FloatArray, size: int = 480, *, sample_rate: int = RATE
) -> list[tuple[Prediction, HapticCommand]]:
    steps = []
    for block in blocks(samples, size, sample_rate=sample_rate):
        step = pipeline.push(block)
        steps += list(zip(step.predictions, step.commands, strict=True))
    step = pipeline.flush(block)
    return steps + list(zip(step.predictions, step.commands, strict=True))


@pytest.mark.slow
@pytest.mark.parametrize("contact", ["bands", "level", "window"])
@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_bits(
    model: str, size: int, contact: ContactRule
) -> None:
    pipeline = pipeline_of(model, contact=contact)
    samples = strokes()
    samples[RATE * 7 // 4] = np.nan
    whole = processed(pipeline, samples, len(samples))
    pipeline.reset()
    assert processed(pipeline, samples, size) == whole


def test_any_block_size_gives_the_same_bits_at_rates_with_no_common_step(
    model: str,
) -> None:
    pipeline = pipeline_of(model, sample_rate=22_050)
    samples = strokes(duration=2)[:40_000]
    whole = processed(pipeline, samples, len(samples), sample_rate=22_050)
    pipeline.reset()
    assert processed(pipeline, samples, 17, sample_rate=22_050) == whole


def test_a_touch_is_rendered_within_milliseconds_and_then_classified(
    model: str,
) -> None:
    steps = processed(pipeline_of(model), strokes())
    rendered = [
        (prediction, command) for prediction, command in steps if command.amplitude > 0
    ]
    first_belief, first = rendered[0]
    assert 0 < first.time - 0.5 < 0.003
    assert first_belief.touch is Touch.SMOOTH
    rough = next(
        command for prediction, command in rendered if prediction.touch is Touch.ROUGH
    )
    assert rough.time < 0.6


def test_a_touch_that_ended_is_no_longer_rendered(model: str) -> None:
    last_rough = max(
        command.time
        for prediction, command in processed(pipeline_of(model), strokes())
        if prediction.roughness > 0.5 and command.time < SECOND_STROKE
    )
    # The bands hear the end of a touch for as long as their windows last, 64 ms.
    assert 1.0 < last_rough < 1.075
    by_window = processed(pipeline_of(model, contact="window"), strokes())
    assert (
        max(
            command.time
            for prediction, command in by_window
            if prediction.roughness > 0.5
        )
        > 1.2
    )


def test_without_the_gate_it_is_the_detector_alone(model: str) -> None:
    pipeline = pipeline_of(model, contact="window")
    predictions = [prediction for prediction, _ in processed(pipeline, strokes())]
    pipeline.reset()
    detector = pipeline.detector.main.window_detector
    assert (
        predictions
        == [found for block in blocks(strokes(), 512) for found in detector.push(block)]
        + detector.flush()
    )


def test_commands_are_never_further_apart_than_32_ms(model: str) -> None:
    times = [command.time for _, command in processed(pipeline_of(model), strokes())]
    assert times == sorted(times)
    assert np.diff([0.0, *times]).max() <= 0.032


def test_invalid_sound_is_silence_within_a_hop_and_counted(model: str) -> None:
    pipeline = pipeline_of(model)
    samples = tone(400, duration=2)
    samples[RATE] = np.nan
    quiet = [
        command.time
        for _, command in processed(pipeline, samples)
        if command.amplitude == 0 and command.time > 0.01
    ]
    hop = 512 / RATE
    assert 0 < quiet[0] - 1.0 < hop
    assert pipeline.detector.faults["sound"] > 0


def test_limits_bound_every_command(model: str) -> None:
    pipeline = pipeline_of(model)
    pipeline.limits = Limits(ceiling=0.1, lowest=100, highest=110)
    steps = processed(pipeline, strokes())
    commands = [command for _, command in steps]
    # The ceiling scales the whole profile: only full roughness reaches it, where the
    # ceiling once clipped the rest too.
    assert max(command.amplitude for command in commands) <= 0.1
    for prediction, command in steps:
        full = (
            0.0
            if prediction.touch is Touch.NONE
            else 10 ** (-25 / 20 * (1 - prediction.roughness))
        )
        assert command.amplitude == pytest.approx(0.1 * full)
    assert all(100 <= command.frequency <= 110 for command in commands)


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("ceiling", [1.0, 0.5, 0.1])
def test_a_ceiling_keeps_the_contrast_between_smooth_and_rough(
    model: str, name: str, ceiling: float
) -> None:
    profile = open_profile(name)
    pipeline = open_pipeline(
        model,
        sample_rate=RATE,
        channels=1,
        profile=name,
        limits=Limits(ceiling=ceiling),
    )
    smooth, rough = stimulus(Touch.SMOOTH, 0.0), stimulus(Touch.ROUGH, 1.0)
    full = profile.command(rough).amplitude / profile.command(smooth).amplitude
    limited = (
        pipeline.command_for(rough).amplitude / pipeline.command_for(smooth).amplitude
    )
    assert limited == pytest.approx(full)
    assert pipeline.command_for(rough).amplitude == pytest.approx(
        min(ceiling, profile.command(rough).amplitude)
    )


def test_the_papers_contrast_is_25_db_at_the_default_ceiling(model: str) -> None:
    pipeline = pipeline_of(model)
    rough, smooth = (
        pipeline.command_for(stimulus(touch, roughness)).amplitude
        for touch, roughness in ((Touch.ROUGH, 1.0), (Touch.SMOOTH, 0.0))
    )
    assert rough == 0.5
    assert 20 * np.log10(rough / smooth) == pytest.approx(25)


def test_a_profile_that_is_changed_in_a_run_is_scaled_by_its_own_peak(
    model: str,
) -> None:
    pipeline = pipeline_of(model)
    pipeline.profile = PaperProfile(
        rough=Stimulus(60.0, -12.0), smooth=Stimulus(120.0, -30.0)
    )
    assert pipeline.command_for(stimulus(Touch.ROUGH, 1.0)).amplitude == pytest.approx(
        10 ** (-12 / 20)
    )


def test_a_threshold_set_in_a_run_holds_for_window_and_gate(model: str) -> None:
    pipeline = pipeline_of(model)
    pipeline.detector.threshold.dbfs = 0.0
    assert not any(command.amplitude for _, command in processed(pipeline, strokes()))


@pytest.mark.parametrize(("lost", "kept"), [(4_800, True), (480_000, False)])
def test_times_follow_the_stream_over_lost_sound(
    model: str, lost: int, kept: bool
) -> None:
    pipeline = pipeline_of(model)
    first, *rest = blocks(tone(400, duration=1), RATE // 2)
    pipeline.push(first)
    after = [replace(block, start=block.start + lost) for block in rest]
    steps = [
        prediction for block in after for prediction in pipeline.push(block).predictions
    ]
    assert steps[-1].end == pytest.approx(1 + lost / RATE, abs=HOP + 0.003)
    assert (steps[0].touch is Touch.ROUGH) == kept


def test_a_stream_that_does_not_begin_at_zero_keeps_its_time(model: str) -> None:
    pipeline = pipeline_of(model)
    step = pipeline.push(AudioBlock(tone(400, duration=1), RATE, start=10 * RATE))
    assert step.command is not None
    assert step.command.time == pytest.approx(11, abs=HOP + 0.001)


def test_an_unknown_profile_is_refused(model: str) -> None:
    with pytest.raises(ConfigError):
        open_pipeline(model, sample_rate=RATE, channels=1, profile="velvet")


def test_feel_imports_the_core_dependencies_alone() -> None:
    extras = (
        "torch",
        "scipy",
        "matplotlib",
        "numba",
        "onnx",
        "OpenSSL",
        "pylibsrtp",
        "opuslib_next",
        "jack",
    )
    imported = (
        f"import sys, tactophone.cli.feel; print([name for name in {extras} if "
        "name in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", imported], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


class Loudness:
    """A detector as a user may write it: all that the contract lists, and nothing
    more."""

    name = "loudness"
    latency = 0.0
    bandwidth = 8_000.0

    def __init__(self) -> None:
        self.faults: Counter[str] = Counter()
        self.threshold = ContactThreshold(-30.0)

    def push(self, block: AudioBlock) -> list[Prediction]:
        level_dbfs = 10 * float(np.log10(np.square(block.samples).mean() + 1e-12))
        touch = Touch.ROUGH if level_dbfs > self.threshold.dbfs else Touch.NONE
        return [
            Prediction(
                (0.0, 0.0, 1.0),
                touch,
                1.0,
                level_dbfs,
                block.time,
                block.end / block.sample_rate,
            )
        ]

    def flush(self) -> list[Prediction]:
        return []

    def reset(self) -> None:
        """Nothing is kept."""


def test_a_detector_of_a_users_own_needs_no_more_than_its_contract_lists() -> None:
    fingers = [Pipeline(Loudness(), PaperProfile()) for _ in range(2)]
    fingers[1].detector.threshold.dbfs = 0.0
    loud = AudioBlock(np.full((480, 4), 0.5, np.float32), 48_000)
    touches = [step.predictions[0].touch for step in Hand(fingers).push(loud)]
    assert touches == [Touch.ROUGH, Touch.NONE]
    assert fingers[0].flush(loud).predictions == ()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["texture", "stylus"])
@pytest.mark.parametrize("fingers", [1, 3])
def test_a_hand_whose_sound_waits_predicts_what_each_finger_does_alone(
    name: str, fingers: int
) -> None:
    def opened() -> Pipeline:
        return open_pipeline(name, sample_rate=RATE, channels=2)

    stroke = strokes(duration=2) * np.float32([1, 0.3])
    # Not the same sound at both microphones, which is a fault: each finger looks for
    # faults at its own turn, and would find it at another time than alone.
    stroke[:, 1] = np.roll(stroke[:, 1], 37)
    sound = np.hstack(
        [np.roll(stroke, 4800 * finger, axis=0) for finger in range(fingers)]
    )
    hand, alone = (
        Hand([opened() for _ in range(fingers)]),
        [opened() for _ in range(fingers)],
    )
    found: list[list[Prediction]] = [[] for _ in range(fingers)]
    expected: list[list[Prediction]] = [[] for _ in range(fingers)]
    for number, start in enumerate(range(0, len(sound), 120)):
        moving = number % 7 > 3  # also where sound waits
        block = AudioBlock(sound[start : start + 120], RATE, start, moving=moving)
        for step in hand.push(block):
            found[step.finger] += step.predictions
        for finger, pipeline in enumerate(alone):
            part = np.ascontiguousarray(block.samples[:, 2 * finger : 2 * finger + 2])
            expected[finger] += pipeline.push(
                AudioBlock(part, RATE, start, moving=moving)
            ).predictions
    for one, other in zip(found, expected, strict=True):
        assert len(one) > 100
        assert [(each.touch, each.end) for each in one] == [
            (each.touch, each.end) for each in other[: len(one)]
        ]
