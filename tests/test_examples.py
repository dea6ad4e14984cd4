"""Runs each example as a program, as its first line says."""

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.live.telemetry.writer import Telemetry
from tactophone.signal.perception.models import model_path

EXAMPLES = Path(__file__).parent.parent / "examples"


def run(name: str, *words: str | Path) -> str:
    """Run an example; return what it prints."""
    command = [sys.executable, str(EXAMPLES / name), *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
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


def test_a_recording_is_classified(recording: Path) -> None:
    lines = run("classify_wav.py", recording).splitlines()
    assert "none" in lines[0]
    assert len(lines) >= 2


@pytest.mark.long
def test_a_network_on_pictures_of_the_sound_is_scored_on_surfaces_that_it_never_met(
    tmp_path: Path,
) -> None:
    lines = ["file_name,surface,label"]
    rng = np.random.default_rng(0)
    for number, label in enumerate(("smooth", "rough") * 2):
        samples = rng.normal(scale=0.1, size=32_000)
        if label == "smooth":
            samples = np.convolve(samples, np.ones(16) / 4, "same")
        samples[:12_000] *= 1e-3
        soundfile.write(tmp_path / f"{number}.wav", samples.clip(-1, 1), 16_000)
        lines.append(f"{number}.wav,{label} {number},{label}")
    (tmp_path / "metadata.csv").write_text("\n".join(lines) + "\n")
    assert float(run("tyre_cnn.py", tmp_path, "2-fold").split()[0]) > 0.9


def test_a_model_runs_without_this_package(recording: Path) -> None:
    rows = [
        line.split()
        for line in run("run_anywhere.py", model_path("stylus"), recording).splitlines()
    ]
    assert [rows[0][5], len(rows)] == ["none", 97]
    assert {row[5] for row in rows[60:]} <= {"smooth", "rough"}


def test_the_oscillator_obeys_its_limits_and_fades_without_commands(
    tmp_path: Path,
) -> None:
    run("drive_oscillator.py", tmp_path / "vibration.wav")
    vibration, rate = soundfile.read(tmp_path / "vibration.wav", dtype="float32")
    assert 0.25 < np.abs(vibration[: rate // 2]).max() <= np.float32(0.3)
    assert np.all(vibration[-rate // 4 :] == 0)


def test_telemetry_is_printed(tmp_path: Path) -> None:
    with Telemetry(f"test-{tmp_path.name}") as telemetry:
        assert "packets received" in run(
            "subscribe_to_telemetry.py", telemetry.name, "0.1"
        )


def test_a_custom_profile_makes_commands(recording: Path) -> None:
    lines = run("custom_profile.py", recording).splitlines()
    assert all("80 Hz" in line for line in lines)
    assert lines[0].endswith("0.00")


@pytest.mark.slow
def test_a_detector_of_scikit_learn_tells_what_it_was_taught(tmp_path: Path) -> None:
    pytest.importorskip("sklearn")
    rng = np.random.default_rng(0)
    noise = rng.normal(scale=0.1, size=(48_000, 1))
    sounds = {
        "none": 1e-4 * noise,
        "smooth": np.cumsum(noise, axis=0) / 100,
        "rough": noise,
    }
    for name, sound in sounds.items():
        soundfile.write(tmp_path / f"{name}.wav", sound.clip(-1, 1), 48_000)
    paths = [tmp_path / f"{name}.wav" for name in sounds]
    assert run("own_detector.py", *paths, paths[2]).count("rough") > 45
    assert run("own_detector.py", *paths, paths[1]).count("smooth") > 45


@pytest.mark.slow
def test_an_actuator_of_your_own_gets_the_vibration() -> None:
    assert "###############" in run("own_actuator.py")


@pytest.mark.slow
def test_live_sound_calls_back(recording: Path) -> None:
    printed = run("live_callback.py", f"file:{recording}", "2")
    assert "none" in printed
    assert len(printed.splitlines()) > 20


@pytest.mark.slow
def test_a_recording_becomes_a_data_frame(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("pandas")
    monkeypatch.chdir(tmp_path)
    assert "window_end" in run("wav_to_data_frame.py", recording)
    assert (tmp_path / "finger.csv").is_file()


def test_a_custom_source_is_classified() -> None:
    names = run("custom_source.py")
    assert "NONE" in names
    assert "SMOOTH" in names or "ROUGH" in names


@contextmanager
def repeated(work: Callable[[], object]) -> Iterator[None]:
    """Repeat a piece of work in the background, a hundred times a second."""
    ended = threading.Event()

    def run_on() -> None:
        while not ended.wait(0.01):
            work()

    thread = threading.Thread(target=run_on, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def test_the_rough_spans_of_a_log_are_printed(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    from tests.live.log.recorded_run import record
    from tests.models import write_tiny_model

    log = record(tmp_path / "run.mcap", write_tiny_model(tmp_path / "tiny.onnx"))
    assert "rough from 0.5" in run("read_log.py", log)


@pytest.mark.slow
def test_osc_messages_are_printed(tmp_path: Path) -> None:
    pytest.importorskip("pythonosc")
    from tactophone.faces.bridges.osc import OscBridge
    from tests.faces.bridges.test_osc import STEP
    from tests.live.runtime.live_system import free_port

    port = free_port()
    with (
        Telemetry(f"test-{tmp_path.name}") as telemetry,
        OscBridge(telemetry.name, f"127.0.0.1:{port}") as bridge,
        repeated(
            lambda: (telemetry.publish(STEP, now=time.monotonic()), bridge.read())
        ),
    ):
        printed = run("receive_osc.py", str(port), "1")
    assert "/tactophone/index/vibration 0.50 60.00" in printed


def test_a_viewer_of_foxgloves_protocol_prints_predictions(tmp_path: Path) -> None:
    pytest.importorskip("aiohttp")
    from tactophone.faces.bridges.foxglove import FoxgloveBridge
    from tests.faces.bridges.test_osc import STEP

    name = f"test-{tmp_path.name}"
    with (
        Telemetry(name) as telemetry,
        FoxgloveBridge(name, "127.0.0.1:0", token="secret") as bridge,
        repeated(
            lambda: (telemetry.publish(STEP, now=time.monotonic()), bridge.read())
        ),
    ):
        printed = run("watch_foxglove.py", f"ws://127.0.0.1:{bridge.port}/secret/", "3")
    assert printed.count("rough  0.5") == 3


@pytest.mark.realtime
def test_the_vibration_on_ros_is_printed(tmp_path: Path) -> None:
    pytest.importorskip("cyclonedds")
    from tactophone.faces.bridges.ros import RosBridge
    from tests.faces.bridges.test_osc import STEP

    name = f"test-{tmp_path.name}"
    with (
        Telemetry(name) as telemetry,
        RosBridge(name, domain=0) as bridge,
        repeated(
            lambda: (telemetry.publish(STEP, now=time.monotonic()), bridge.read())
        ),
    ):
        printed = run("follow_ros.py", "5")
    assert "amplitude 0.50, 60 Hz" in printed
