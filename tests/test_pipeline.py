import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactophone.errors import ConfigError
from tactophone.haptics import Limits
from tactophone.pipeline import Pipeline, open_pipeline
from tactophone.types import AudioBlock, FloatArray, HapticCommand, Prediction, Touch
from tests.models import write_tiny_model
from tests.sounds import UGLY_SIZES, blocks, strokes, tone

RATE = 48_000
HOP = 512 / RATE


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(write_tiny_model(tmp_path / "tiny.onnx"))


def walk_of(model: str, *, fast_contact: bool = True, sample_rate: int = RATE) -> Pipeline:
    return open_pipeline(model, sample_rate=sample_rate, channels=1, fast_contact=fast_contact)


def walked(
    walk: Pipeline, samples: FloatArray, size: int = 480, *, sample_rate: int = RATE
) -> list[tuple[Prediction, HapticCommand]]:
    steps = []
    for block in blocks(samples, size, sample_rate=sample_rate):
        tick = walk.push(block)
        steps += list(zip(tick.predictions, tick.commands, strict=True))
    tick = walk.flush(block)
    return steps + list(zip(tick.predictions, tick.commands, strict=True))


@pytest.mark.parametrize("fast_contact", [True, False])
@pytest.mark.parametrize("size", UGLY_SIZES)
def test_any_block_size_gives_the_same_bits(model: str, size: int, fast_contact: bool) -> None:
    walk = walk_of(model, fast_contact=fast_contact)
    samples = strokes()
    samples[RATE * 7 // 4] = np.nan
    whole = walked(walk, samples, len(samples))
    walk.reset()
    assert walked(walk, samples, size) == whole


def test_any_block_size_gives_the_same_bits_at_rates_with_no_common_step(model: str) -> None:
    walk = walk_of(model, sample_rate=22_050)
    samples = strokes(duration=2)[:40_000]
    whole = walked(walk, samples, len(samples), sample_rate=22_050)
    walk.reset()
    assert walked(walk, samples, 17, sample_rate=22_050) == whole


def test_a_touch_is_felt_within_milliseconds_and_then_told_apart(model: str) -> None:
    steps = walked(walk_of(model), strokes())
    felt = [(belief, command) for belief, command in steps if command.amplitude > 0]
    first_belief, first = felt[0]
    assert 0 < first.time - 0.5 < 0.003
    assert first_belief.touch is Touch.SMOOTH
    rough = next(command for belief, command in felt if belief.touch is Touch.ROUGH)
    assert rough.time < 0.6


def test_a_touch_that_ended_is_felt_no_longer(model: str) -> None:
    last_rough = max(command.time for belief, command in walked(walk_of(model), strokes()) if belief.roughness > 0.5)
    assert 1.0 < last_rough < 1.04
    by_window = walked(walk_of(model, fast_contact=False), strokes())
    assert max(command.time for belief, command in by_window if belief.roughness > 0.5) > 1.2


def test_without_the_gate_it_is_the_detector_alone(model: str) -> None:
    walk = walk_of(model, fast_contact=False)
    beliefs = [belief for belief, _ in walked(walk, strokes())]
    walk.reset()
    detector = walk.judge.detector
    assert beliefs == [one for block in blocks(strokes(), 512) for one in detector.push(block)] + detector.flush()


def test_commands_never_stay_away_for_longer_than_a_beat(model: str) -> None:
    times = [command.time for _, command in walked(walk_of(model), strokes())]
    assert times == sorted(times)
    assert np.diff([0.0, *times]).max() <= 0.032


def test_garbage_is_silence_at_once_and_counted(model: str) -> None:
    walk = walk_of(model)
    samples = tone(400, duration=2)
    samples[RATE] = np.nan
    quiet = [command.time for _, command in walked(walk, samples) if command.amplitude == 0 and command.time > 0.01]
    assert 0 < quiet[0] - 1.0 < 0.003
    assert walk.faults["sound"] > 0


def test_limits_bound_every_command(model: str) -> None:
    walk = walk_of(model)
    walk.limits = Limits(ceiling=0.1, lowest=100, highest=110)
    commands = [command for _, command in walked(walk, strokes())]
    assert max(command.amplitude for command in commands) == 0.1
    assert all(100 <= command.frequency <= 110 for command in commands)


def test_a_threshold_set_in_a_run_holds_for_window_and_gate(model: str) -> None:
    walk = walk_of(model)
    walk.judge.threshold_dbfs = 0.0
    assert not any(command.amplitude for _, command in walked(walk, strokes()))


@pytest.mark.parametrize(("lost", "kept"), [(4_800, True), (480_000, False)])
def test_times_follow_the_stream_over_lost_sound(model: str, lost: int, kept: bool) -> None:
    walk = walk_of(model)
    first, *rest = blocks(tone(400, duration=1), RATE // 2)
    walk.push(first)
    after = [replace(block, start=block.start + lost) for block in rest]
    steps = [belief for block in after for belief in walk.push(block).predictions]
    assert steps[-1].end == pytest.approx(1 + lost / RATE, abs=HOP + 0.003)
    assert (steps[0].touch is Touch.ROUGH) == kept


def test_a_stream_that_does_not_begin_at_zero_keeps_its_time(model: str) -> None:
    walk = walk_of(model)
    tick = walk.push(AudioBlock(tone(400, duration=1), RATE, start=10 * RATE))
    assert tick.command is not None
    assert tick.command.time == pytest.approx(11, abs=HOP + 0.001)


def test_an_unknown_profile_is_refused(model: str) -> None:
    with pytest.raises(ConfigError):
        open_pipeline(model, sample_rate=RATE, channels=1, profile="velvet")


def test_feeling_a_file_needs_the_lean_core_alone() -> None:
    extras = ("torch", "scipy", "matplotlib", "numba", "onnx", "OpenSSL", "pylibsrtp", "opuslib_next", "jack")
    imported = f"import sys, tactophone.cli.feel; print([name for name in {extras} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", imported], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
