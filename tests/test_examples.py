"""Runs each example as a program, as its first line says."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.telemetry import Telemetry

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(name: str, *words: str | Path) -> str:
    """Run an example; return what it prints."""
    command = [sys.executable, str(EXAMPLES / name), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Half a second of silence, then half a second of noise, on two channels."""
    rng = np.random.default_rng(0)
    samples = rng.normal(scale=0.1, size=(48_000, 2)).clip(-1, 1)
    samples[:24_000] *= 1e-4
    path = tmp_path / "finger.wav"
    soundfile.write(path, samples, 48_000)
    return path


def test_there_are_five_and_each_is_under_40_lines() -> None:
    lengths = {path.name: len(path.read_text().splitlines()) for path in EXAMPLES.glob("*.py")}
    assert len(lengths) == 5
    assert max(lengths.values()) < 40, lengths


def test_a_recording_is_classified(recording: Path) -> None:
    lines = run("classify_wav.py", recording).splitlines()
    assert "none" in lines[0]
    assert len(lines) >= 2


def test_the_oscillator_obeys_its_limits_and_fades_without_commands(tmp_path: Path) -> None:
    run("drive_oscillator.py", tmp_path / "vibration.wav")
    vibration, rate = soundfile.read(tmp_path / "vibration.wav", dtype="float32")
    assert 0.25 < np.abs(vibration[: rate // 2]).max() <= np.float32(0.3)
    assert np.all(vibration[-rate // 4 :] == 0)


def test_telemetry_is_printed(tmp_path: Path) -> None:
    with Telemetry(f"test-{tmp_path.name}") as telemetry:
        assert "packets received" in run("subscribe_to_telemetry.py", telemetry.name, "0.1")


def test_a_custom_profile_makes_commands(recording: Path) -> None:
    lines = run("custom_profile.py", recording).splitlines()
    assert all("80 Hz" in line for line in lines)
    assert lines[0].endswith("0.00")


def test_a_custom_source_is_classified() -> None:
    names = run("custom_source.py")
    assert "NONE" in names
    assert "SMOOTH" in names or "ROUGH" in names
