"""The bench test of a finished finger, on simulated fingers with each fault that a
builder can make."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.types import LIVE_SAMPLE_RATE

sys.path.insert(0, str(Path(__file__).parents[2] / "hardware"))
import bench
from bench import PAD, STEPS, STIFFNESS, WEIGHT, measure_bench
from bench_sounds import BuiltFinger, bench_sounds

FAULTS = {
    "air-under-disc": (BuiltFinger(air=True), "air is under the disc"),
    "stiff-bed": (BuiltFinger(stiffness=25.5e3), "too hard or too thin"),  # Shore 10 A
    "soft-bed": (BuiltFinger(stiffness=5e3), "holds bubbles"),
    "low-impedance": (BuiltFinger(corner=1600), "instrument"),
    "motors": (BuiltFinger(motors_db=20), "hard joins pad and phalanx"),
}


@pytest.mark.parametrize("seed", range(5))
def test_a_finger_as_it_is_drawn_passes(seed: int) -> None:
    found = measure_bench(
        bench_sounds(BuiltFinger(), weight=WEIGHT, seed=seed), LIVE_SAMPLE_RATE
    )
    assert found.findings == ()
    assert found.stiffness == pytest.approx(STIFFNESS, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("code", FAULTS)
def test_each_fault_is_named_and_no_other_fatal_one(code: str, seed: int) -> None:
    built, words = FAULTS[code]
    found = measure_bench(
        bench_sounds(built, weight=WEIGHT, seed=seed), LIVE_SAMPLE_RATE
    )
    assert [finding.code for finding in found.findings if finding.fatal] == [code]
    assert words in str(found.findings[0])
    assert not found.passed


def test_silence_in_place_of_blows_says_what_was_not_heard() -> None:
    sounds = {
        name: np.full((LIVE_SAMPLE_RATE, 2), 1e-4, np.float32) for name, *_ in STEPS
    }
    found = measure_bench(sounds, LIVE_SAMPLE_RATE)
    assert [finding.code for finding in found.findings] == [
        "no-ball",
        "no-tap",
        "no-weight",
    ]


def test_the_expected_bed_is_the_drawn_one() -> None:
    from dimensions import Finger

    assert Finger().bed_stiffness * 0.12e6 == pytest.approx(STIFFNESS, rel=0.02)
    assert (
        pytest.approx(1.8e-3, abs=0.5e-3) == PAD
    )  # 0.8 + 0.5 g of plastic, and a disc of 0.5 g


@pytest.mark.slow
def test_it_passes_a_simulated_finger_and_refuses_a_recording_of_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert bench.main(["--source", "finger", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["passed"]
    noise = np.random.default_rng(0).normal(0, 1e-3, (40 * 48_000, 2))
    soundfile.write(tmp_path / "noise.wav", noise, 48_000)
    assert bench.main(["--source", f"file:{tmp_path}/noise.wav"]) == 1
    assert "ball: fewer than 2 blows were heard" in " ".join(
        capsys.readouterr().out.split()
    )
