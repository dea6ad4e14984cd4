"""Sound that something switched off in its pauses: what is unsure is quiet, and a
recording is taken for what a live run takes it for."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone.cli import main
from tactophone.core.types import FloatArray, Touch
from tactophone.signal.perception.noise_floor import measure_floor
from tactophone.signal.pipeline import open_pipeline
from tests.sounds import blocks, noise

RATE = 48_000
SECONDS = 6


def gated(closed: float = 0.0) -> FloatArray:
    """Return touches of 0.5 s whose level varies, with 0.2 s of noise around them, and
    so small a part of the sound where a noise gate has closed; by default silence."""
    samples = noise(level_dbfs=-55, duration=SECONDS)
    loud = noise(level_dbfs=-20, duration=SECONDS, seed=1)
    time = np.arange(len(samples)) / RATE % 1.5
    strength = np.clip(np.sin(np.pi * (time - 0.25) / 0.5), 0, 1) ** 2
    touching = (time > 0.25) & (time < 0.75)
    pressed = np.where(touching, strength, 0)[:, None] * np.array([1, 0.3])
    opened = (time > 0.15) & (time < 0.95)
    # The gate opens and closes within 20 ms, so that no noise beside a touch is steady.
    fade = np.clip(np.minimum(time - 0.15, 0.95 - time) / 0.1, 0, 1) * opened
    gain = np.maximum(fade, closed)
    return ((samples + loud * pressed) * gain[:, None]).astype(np.float32)


def test_a_gate_that_closes_in_pauses_is_noticed() -> None:
    floor = measure_floor(blocks(gated(), 4096), sample_rate=RATE, rule="banded")
    assert not floor.known
    assert floor.gated


def test_a_gate_that_leaves_a_little_of_the_noise_is_noticed_too() -> None:
    samples = gated(closed=0.01)
    floor = measure_floor(blocks(samples, 4096), sample_rate=RATE, rule="banded")
    assert floor.known
    assert floor.gated


def test_a_stroke_from_end_to_end_is_no_gated_sound() -> None:
    strength = 0.2 + np.abs(np.sin(np.arange(4 * RATE) / RATE * 5))
    samples = (noise(level_dbfs=-20, duration=4) * strength[:, None]).astype(np.float32)
    floor = measure_floor(blocks(samples, 4096), sample_rate=RATE, rule="banded")
    assert not floor.known
    assert not floor.gated


def test_feel_says_how_contact_is_found_in_sound_that_is_turned_down(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(tmp_path / "a.wav", gated(), RATE, subtype="FLOAT")
    command = ["feel", str(tmp_path / "a.wav"), "--out", str(tmp_path)]
    assert main(command) == 0
    printed = capsys.readouterr().out
    assert "turned down in its pauses" in printed
    assert "all of it is taken as touch" not in printed


@pytest.mark.slow
@pytest.mark.parametrize("closed", [0.0, 0.01])
def test_a_gated_recording_is_taken_for_what_a_live_run_takes_it_for(
    tmp_path: Path, closed: float
) -> None:
    samples = gated(closed)
    soundfile.write(tmp_path / "a.wav", samples, RATE, subtype="FLOAT")
    recorded = [
        prediction.touch
        for step in tactophone.open_recording(tmp_path / "a.wav").steps()
        for prediction in step.predictions
    ]
    pipeline = open_pipeline(sample_rate=RATE, channels=2)
    live = [
        prediction.touch
        for block in blocks(samples, 4096)
        for prediction in pipeline.push(block).predictions
    ]
    shares = [
        np.mean([touch is not Touch.NONE for touch in found])
        for found in (recorded, live)
    ]
    assert shares[0] == pytest.approx(shares[1], abs=0.02)
    assert 0.2 < shares[0] < 0.7
