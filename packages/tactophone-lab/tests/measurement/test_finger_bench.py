"""The bench test of a finished finger, on simulated fingers with each fault that a
builder can make."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone_lab.measurement.finger_bench import (
    STEPS,
    STIFFNESS,
    WEIGHT,
    measure_bench,
)
from tactophone_lab.simulation.built_finger import BuiltFinger, bench_sounds

FAULTS = {
    "air-under-disc": (BuiltFinger(air=True), "air is under the disc"),
    "stiff-bed": (BuiltFinger(stiffness=25.5e3), "too hard or too thin"),  # Shore 10 A
    "soft-bed": (BuiltFinger(stiffness=5e3), "holds bubbles"),
    "low-impedance": (BuiltFinger(corner=1600), "instrument"),
    "motors": (BuiltFinger(motors_db=20), "hard joins pad and phalanx"),
    "loose-glue": (BuiltFinger(loose=True), "glue it again"),
    "upside-down": (BuiltFinger(upside_down=True), "its pad up"),
    "board": (BuiltFinger(board_db=36), "an amplifier of its own"),
}

OTHERS = {
    "motors 12 dB louder": (BuiltFinger(motors_db=12), WEIGHT, "motors"),
    "a wrong resistor, 40 kOhm": (BuiltFinger(corner=400), WEIGHT, "low-impedance"),
    "a wrong resistor, 160 kOhm": (BuiltFinger(corner=100), WEIGHT, "low-impedance"),
    "a weight of 80 g": (BuiltFinger(), 0.08, "weight"),
    "a weight of 120 g": (BuiltFinger(), 0.12, "weight"),
    "a port under tape": (BuiltFinger(board_db=-25), WEIGHT, "board"),
}
"""Faults that an earlier test passed, with the weight that hangs and the row that
fails."""


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


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("name", OTHERS)
def test_each_of_these_fails_one_row_by_name(name: str, seed: int) -> None:
    built, weight, code = OTHERS[name]
    found = measure_bench(
        bench_sounds(built, weight=weight, seed=seed), LIVE_SAMPLE_RATE
    )
    assert [finding.code for finding in found.findings if finding.fatal] == [code]


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [8.5e3, 15e3])
def test_the_weight_is_found_whatever_the_bed(stiffness: float) -> None:
    built = BuiltFinger(stiffness=stiffness)
    right, wrong = (
        measure_bench(bench_sounds(built, weight=weight), LIVE_SAMPLE_RATE)
        for weight in (WEIGHT, 0.08)
    )
    assert right.passed
    assert [finding.code for finding in wrong.findings] == ["weight"]


def test_a_weight_that_was_weighed_may_be_another() -> None:
    sounds = bench_sounds(BuiltFinger(pad=1.6e-3), weight=0.08)
    assert measure_bench(sounds, LIVE_SAMPLE_RATE, weight=0.08, pad=1.6e-3).passed


def test_silence_in_place_of_blows_says_what_was_not_heard() -> None:
    sounds = {
        step.name: np.full((LIVE_SAMPLE_RATE, 2), 1e-4, np.float32) for step in STEPS
    }
    found = measure_bench(sounds, LIVE_SAMPLE_RATE)
    assert [finding.code for finding in found.findings] == [
        "no-ball",
        "no-tap",
        "no-weight",
    ]


@pytest.mark.slow
def test_it_passes_a_simulated_finger_and_refuses_a_recording_of_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["bench", "--source", "finger", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["passed"]
    noise = np.random.default_rng(0).normal(0, 1e-3, (40 * 48_000, 2))
    soundfile.write(tmp_path / "noise.wav", noise, 48_000)
    assert main(["bench", "--source", f"file:{tmp_path}/noise.wav"]) == 1
    assert "ball: fewer than 2 blows were heard" in " ".join(
        capsys.readouterr().out.split()
    )
