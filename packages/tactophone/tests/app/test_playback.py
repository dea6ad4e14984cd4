"""Playing back a recording on the page."""

import json
import signal
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path
from uuid import uuid4

import numpy as np
import pytest
import soundfile

from tactophone.app import playback
from tactophone.app.recordings import open_recording
from tactophone.cli import main
from tactophone.core.recordings.values import Segment
from tactophone.core.types import Touch
from tactophone.live.audio.files import FileSource
from tactophone.live.runtime.output_gate import EMERGENCY_STOP
from tactophone.live.telemetry.layout import Action
from tactophone.live.telemetry.memory import folder
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry
from tactophone.signal.pipeline import open_pipeline
from tests.live.runtime.live_system import eventually
from tests.sounds import tone

pytestmark = pytest.mark.realtime

NAME = f"test-playback-{uuid4().hex[:8]}"
"""Of the run: another in each process, as tests may run side by side."""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "stroke.wav"
    sound = np.random.default_rng(0).uniform(-0.5, 0.5, (13_230, 2))
    soundfile.write(path, sound, 44_100, "PCM_24")
    return path


def test_it_shows_sound_prediction_vibration_and_label_in_real_time(
    recording: Path,
) -> None:
    source = FileSource(recording)
    pipeline = open_pipeline(sample_rate=source.sample_rate, channels=2)
    take = playback.PlayableRecording(
        recording.name, [recording], [pipeline], (Segment(0.1, 0.2, "rough"),)
    )
    with Telemetry(NAME) as telemetry:
        playback.play(take, telemetry)
        seen = Watcher(NAME).snapshot()
    assert (seen.sound_end, seen.vibration_end) == (13_230, 14_400)
    assert (seen.state.role, seen.state.source, seen.state.sample_rate) == (
        "replay",
        "stroke.wav",
        44_100,
    )
    truth = dict.fromkeys(seen.steps["truth"].tolist())
    assert list(truth) == [-1, Touch.ROUGH]
    assert np.abs(seen.vibration).max() > 0


def test_a_profile_of_the_sound_itself_vibrates_as_the_sound(tmp_path: Path) -> None:
    path = tmp_path / "tone.wav"
    soundfile.write(path, tone(200, duration=0.3), 48_000, "PCM_24")
    recording = open_recording(path, profile="direct", threshold_dbfs=-60.0)
    take = playback.PlayableRecording(path.name, [path], [recording.pipeline])
    with Telemetry(NAME) as telemetry:
        playback.play(take, telemetry)
        seen = Watcher(NAME).snapshot()
    assert seen.finger.profile == "direct"
    assert seen.vibration_end == 14_400
    spectrum = np.abs(np.fft.rfft(seen.vibration[-4_800:]))
    assert spectrum.argmax() * 10 == 200  # Hz


def test_a_hand_is_played_finger_beside_finger_under_the_name_of_its_log(
    recording: Path,
) -> None:
    pipelines = [open_pipeline(sample_rate=44_100, channels=2) for _ in range(2)]
    names = ["thumb", "index"]
    take = playback.PlayableRecording(
        "run.mcap", [recording, recording], pipelines, fingers=names
    )
    with Telemetry(NAME, fingers=2) as telemetry:
        playback.play(take, telemetry)
        seen = [Watcher(NAME).snapshot(finger=finger) for finger in (0, 1)]
    assert [(each.sound_end, each.vibration_end) for each in seen] == [
        (13_230, 14_400)
    ] * 2
    assert seen[0].state.source == "run.mcap"
    assert [finger.name for finger in seen[0].state.fingers] == names


def test_a_page_pauses_and_moves_the_position(recording: Path) -> None:
    pipeline = open_pipeline(sample_rate=44_100, channels=2)
    take = playback.PlayableRecording(recording.name, [recording], [pipeline])
    with Telemetry(NAME) as telemetry:
        watcher = Watcher(NAME)
        sought: list[float | None] = []
        playing = threading.Thread(
            target=lambda: sought.append(playback.play(take, telemetry, 0.1))
        )
        watcher.ask("pause", 1.0)
        playing.start()
        eventually(lambda: watcher.snapshot().state.paused)
        assert watcher.snapshot().state.duration == pytest.approx(0.3)
        watcher.ask("seek", 0.25)
        playing.join(5)
        assert sought == [0.25]
        assert playback.play(take, telemetry, 0.25) is None


def test_a_page_feels_a_recording_until_somebody_stops_it_and_a_stop_holds(
    recording: Path,
) -> None:
    pipeline = open_pipeline(sample_rate=44_100, channels=2)
    take = playback.PlayableRecording(recording.name, [recording], [pipeline])
    with Telemetry(NAME) as telemetry:
        watcher = Watcher(NAME)
        playback.play(take, telemetry)
        assert watcher.snapshot().finger.armed
        watcher.ask("stop")
        playback.play(take, telemetry)
        watcher.ask("mute")
        playback.play(take, telemetry)
        playback.play(take, telemetry)  # a further pass
        finger = watcher.snapshot().finger
        assert (finger.armed, finger.muted_because) == (False, EMERGENCY_STOP)
        watcher.ask("arm")
        playback.play(take, telemetry)
        assert watcher.snapshot().finger.armed


@pytest.mark.parametrize(
    "asked", [("seek", "stop"), ("stop", "seek"), ("stop", "arm"), ("arm", "stop")]
)
def test_a_stop_of_a_recording_holds_whatever_is_asked_with_it(
    recording: Path, asked: tuple[Action, Action]
) -> None:
    """A page that moved the position undid the stops that came with it."""
    pipeline = open_pipeline(sample_rate=44_100, channels=2)
    take = playback.PlayableRecording(recording.name, [recording], [pipeline])
    with Telemetry(NAME) as telemetry:
        watcher = Watcher(NAME)
        playback.play(take, telemetry)
        for action in asked:
            watcher.ask(action, 0.1 * (action == "seek"))
        position = playback.play(take, telemetry)
        assert position == (0.1 if "seek" in asked else None)
        playback.play(take, telemetry, position or 0.0)
        assert watcher.snapshot().finger.muted_because == EMERGENCY_STOP


@pytest.mark.parametrize(
    ("ending", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 0)]
)
def test_feel_serves_a_page_until_ended_and_leaves_no_shared_memory(
    recording: Path, ending: signal.Signals, code: int
) -> None:
    """What pages feel is stopped by the command meanwhile, as any run is."""
    name = f"test-{uuid4().hex[:8]}"
    command = [
        sys.executable,
        "-m",
        "tactophone",
        "feel",
        str(recording),
        "--out",
        str(recording.parent),
    ]
    with subprocess.Popen(
        [*command, "--name", name, "--json", "--dashboard"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr
        address = next(
            line for line in process.stderr if line.startswith("page: ")
        ).split()[1]
        with urllib.request.urlopen(address) as page:
            assert b"Tactophone" in page.read()
        plays = eventually(lambda: Watcher(name).state().role == "replay")
        stopped = main(["stop", name])
        finger = Watcher(name).state().fingers[0]
        process.send_signal(ending)
        output, _ = process.communicate(timeout=10)
    assert (plays, stopped, finger.muted_because) == (True, 0, EMERGENCY_STOP)
    assert process.returncode == code
    assert json.loads(output)[0]["recording"] == str(recording)
    assert not [path for path in folder().iterdir() if name in path.name]
