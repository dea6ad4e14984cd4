import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.app import playback
from tactophone.cli import main, page
from tactophone.live.log.mcap import read_log
from tactophone.live.telemetry.records import RunStart
from tactophone.net.link.codec import Codec
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model
from tests.signal.perception.test_calibration_file import CALIBRATION
from tests.sounds import tone

pytest.importorskip("mcap")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replay")
    return record(folder / "run.mcap", write_tiny_model(folder / "tiny.onnx"))


def test_it_says_that_all_is_equal(
    log: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(log)]) == 0
    assert "equal to the bit" in capsys.readouterr().out


@pytest.mark.parametrize("profile", ["graded", "paper", "erm"])
def test_a_log_is_replayed_to_the_bit_by_the_profile_that_it_was_recorded_with(
    profile: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = write_tiny_model(tmp_path / "tiny.onnx")
    recorded = record(tmp_path / "run.mcap", model, f"rendering.profile={profile}")
    assert main(["replay", str(recorded), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["different"] == 0
    other = "paper" if profile != "paper" else "graded"
    assert main(["replay", str(recorded), "--profile", other, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["different"] > 0


def test_a_log_that_is_sent_away_holds_no_password_of_a_relay(tmp_path: Path) -> None:
    model = write_tiny_model(tmp_path / "tiny.onnx")
    relay = "call.turn=lab:s3cret@relay.example"
    recorded = record(tmp_path / "run.mcap", model, relay)
    entries = list(read_log(recorded))
    assert isinstance(entries[0], RunStart)
    assert "s3cret" not in repr(entries)
    assert main(["replay", str(recorded)]) == 0


def test_what_would_have_been_rendered_is_written(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--profile", "perceptual", "--out", str(tmp_path), "--plot", "--json"]
    assert main(["replay", str(log), *options]) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert outcome["different"] > 0
    assert all(Path(path).is_file() for path in outcome["files"].values())
    assert {"vibration", "timeline", "figure"} == set(outcome["files"])


def test_a_profile_of_the_sound_itself_is_written_as_it_was_felt(
    tmp_path: Path,
) -> None:
    model = write_tiny_model(tmp_path / "tiny.onnx")
    recorded = record(tmp_path / "run.mcap", model, "rendering.profile=direct")
    assert main(["replay", str(recorded), "--out", str(tmp_path)]) == 0
    wave, rate = soundfile.read(tmp_path / "run.haptic.wav")
    # The strokes of `strokes`, and not the sine by which they are gated.
    for begin, frequency in ((0.6, 400), (1.6, 100)):
        stroke = wave[round(begin * rate) :][: round(0.3 * rate)]
        spectrum = np.abs(np.fft.rfft(stroke))
        assert spectrum.argmax() / 0.3 == pytest.approx(frequency, abs=4)
    assert np.abs(wave[: round(0.4 * rate)]).max() == 0


def test_a_changed_log_is_noticed(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # Another model under the same name is what a changed log looks like.
    assert main(["replay", str(log), "--model", "paper-mono", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["different"] > 50


def test_a_ros_bag_holds_sound_predictions_and_commands(
    log: Path, tmp_path: Path
) -> None:
    pytest.importorskip("cyclonedds")
    reader_of = pytest.importorskip("rosbags.rosbag2").Reader
    assert main(["replay", str(log), "--to-rosbag", str(tmp_path / "bag")]) == 0
    with reader_of(tmp_path / "bag") as reader:
        counts = {
            connection.topic: connection.msgcount for connection in reader.connections
        }
        assert all(
            connection.digest.startswith("RIHS01_") for connection in reader.connections
        )
        messages = list(reader.messages())
        times = [time for _, time, _ in messages]
        from tactophone.faces.bridges.ros_topics import open_type_store

        store = open_type_store()
        for connection, time, data in messages:
            # Nodes with use_sim_time then follow the bag's clock.
            if connection.topic.endswith("/touch"):
                stamp = store.deserialize_cdr(data, connection.msgtype).header.stamp
                assert abs(stamp.sec * 10**9 + stamp.nanosec - time) < 1000
    base = "/tactophone/index"
    assert counts[f"{base}/prediction"] == counts[f"{base}/vibration"] > 150
    # All two seconds of sound, in however many messages.
    sound = [
        store.deserialize_cdr(data, connection.msgtype).audio.data
        for connection, _, data in messages
        if connection.topic == f"{base}/audio"
    ]
    frame = 2 * 2  # bytes of a sample of both channels
    assert sum(map(len, sound)) / frame / 48_000 == pytest.approx(2.0, abs=0.02)
    assert counts[f"{base}/audio_info"] == 1
    assert (max(times) - min(times)) / 1e9 == pytest.approx(2.0, abs=0.05)
    assert main(["replay", str(log), "--to-rosbag", str(tmp_path / "bag")]) == 1


@pytest.mark.parametrize(
    "words", [["--profile", "none-such"], ["--plot"], ["--ceiling", "2"]]
)
def test_wrong_options_are_one_line(
    log: Path, words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(log), *words]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_the_sound_of_a_log_is_processed_and_imported(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["feel", str(log), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "run.haptic.wav").is_file()
    assert (
        main(
            [
                "dataset",
                "import",
                str(log),
                str(tmp_path / "set"),
                "--surface",
                "slate",
                "--label",
                "rough",
            ]
        )
        == 0
    )
    assert "1 recording in " in capsys.readouterr().out
    assert (
        "run.flac,slate,rough,contact"
        in (tmp_path / "set" / "metadata.csv").read_text()
    )
    assert (
        main(
            ["dataset", "import", str(log), str(tmp_path / "other"), "--label", "soft"]
        )
        == 1
    )


def test_the_sound_of_a_log_takes_the_place_of_no_recording(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = tmp_path / "run.wav"
    soundfile.write(recording, tone(400), 48_000)
    before = recording.read_bytes()
    for name in ("run.mcap", "other/run.mcap"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(log.read_bytes())
    logs = [tmp_path / "run.mcap", tmp_path / "other" / "run.mcap"]
    words = ["feel", *map(str, logs), str(recording), "--out", str(tmp_path), "--json"]
    assert main(words) == 0
    felt = json.loads(capsys.readouterr().out)
    assert recording.read_bytes() == before
    assert [each["recording"] for each in felt] == [*map(str, logs), str(recording)]
    assert [each["duration"] for each in felt] == pytest.approx([2, 2, 1], abs=0.1)
    assert {path.name for path in tmp_path.glob("*.wav")} == {
        "run.wav",
        "run.haptic.wav",
        "run-2.haptic.wav",
        "run-3.haptic.wav",
    }
    assert not [path for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_the_page_plays_with_the_calibration_of_the_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calibration = tmp_path / "finger.toml"
    CALIBRATION.write(calibration)
    model = write_tiny_model(tmp_path / "tiny.onnx")
    codec = Codec("pcm16", channels=2, packet_size=120)
    chosen = [f"detector.calibration={calibration}", "detector.contact=level"]
    log = record(tmp_path / "run.mcap", model, *chosen, codec=codec)
    calibration.unlink()
    shown: list[playback.PlayableRecording] = []
    monkeypatch.setattr(
        page, "play_on_page", lambda settings, takes, name: shown.extend(takes)
    )
    assert main(["replay", str(log), "--dashboard"]) == 0
    assert [
        pipeline.detector.threshold.dbfs
        for take in shown
        for pipeline in take.pipelines
    ] == [CALIBRATION.threshold_dbfs]
