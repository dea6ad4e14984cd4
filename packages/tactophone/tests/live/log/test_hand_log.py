"""The log of a hand: readable for each finger, and computed again to the bit."""

from itertools import cycle
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.app.logged_run import add_sound, settings_of, write_sound
from tactophone.app.replay import Replay, write_replay
from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.core.settings import change
from tactophone.core.types import FloatArray
from tactophone.live.log.mcap import read_log
from tactophone.live.telemetry.records import RunStart
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.net.impairment import NetworkProfile
from tactophone.net.link.codec import Codec, open_decoder
from tactophone.net.link.packet import PayloadType
from tests.live.log.recorded_run import (
    RecordedOperator,
    decoded,
    decoded_sessions,
    joined,
    messages,
    record,
)
from tests.models import write_tiny_model
from tests.sounds import blocks, strokes

pytest.importorskip("mcap.reader")

OPUS, PCM = (
    Codec("opus", channels=4, packet_size=120),
    Codec("pcm16", channels=4, packet_size=120),
)


def sound() -> FloatArray:
    """Strokes of two fingers, the second later, with a little air."""
    first = strokes()[:, 0]
    second = np.roll(first, 12_000)
    return np.stack([first, 0.1 * first, second, 0.1 * second], axis=1)


def mute_the_index(operator: RecordedOperator, now: float) -> None:
    operator.gates[1].muted_because = "muted" if 0.7 < now < 0.8 else ""
    if now > 0.85:
        operator.endpoint.hand.pipelines[1].detector.threshold.dbfs = -30.0


@pytest.fixture(scope="module")
def hand(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a file of two fingers; the index has a profile of its own."""
    path = tmp_path_factory.mktemp("hand") / "hand.toml"
    path.write_text('[thumb]\n[index]\nprofile = "perceptual"\n')
    return path


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory, hand: Path) -> Path:
    folder = tmp_path_factory.mktemp("log")
    return recorded(folder, OPUS, hand)


def recorded(folder: Path, codec: Codec, hand: Path, *, remote: bool = False) -> Path:
    lost = cycle([False] * 7 + [True] * 2 + [False] * 3 + [True])
    return record(
        folder / "run.mcap",
        write_tiny_model(folder / "tiny.onnx"),
        codec=codec,
        lost=lost,
        remote=remote,
        network=NetworkProfile(delay=0.01, jitter=0.004),
        sound=blocks(sound(), 120),
        meanwhile=mute_the_index,
        fingers=str(hand),
    )


@pytest.mark.slow
def test_each_finger_is_replayed_to_the_bit(log: Path) -> None:
    replay = Replay(read_log(log))
    steps = list(replay.steps())
    assert replay.comparison.equal > 300
    assert (replay.comparison.different, replay.comparison.uncertain) == (0, 0)
    for finger in (0, 1):
        vibrating = [
            step
            for step in steps
            if step.finger == finger and step.command and step.command.amplitude
        ]
        assert len(vibrating) > 20


@pytest.mark.slow
@pytest.mark.parametrize(("codec", "remote"), [(PCM, False), (OPUS, True)])
def test_pcm_and_predictions_of_a_hand_are_replayed_to_the_bit(
    tmp_path: Path, hand: Path, codec: Codec, remote: bool
) -> None:
    replay = Replay(read_log(recorded(tmp_path, codec, hand, remote=remote)))
    list(replay.steps())
    assert replay.comparison.equal > 200
    assert replay.comparison.different == 0


@pytest.mark.slow
def test_what_is_chosen_for_a_replay_holds_for_every_finger(log: Path) -> None:
    assert main(["replay", str(log), "--profile", "paper", "--json"]) == 0
    replay = Replay(
        read_log(log), lambda settings: change(settings, ["rendering.ceiling=0.1"])
    )
    commands = [command for step in replay.steps() for command in step.commands]
    assert max(command.amplitude for command in commands) == pytest.approx(0.1)
    assert replay.comparison.different > 20


@pytest.mark.slow
def test_a_replay_writes_files_and_a_figure_for_each_finger(
    log: Path, tmp_path: Path
) -> None:
    rendered = write_replay(Replay(read_log(log)), tmp_path, "run", plot=True)
    assert [finger.name for finger in rendered] == ["thumb", "index"]
    for finger in rendered:
        assert {path.name for path in finger.files.values()} == {
            f"run-{finger.name}{ending}"
            for ending in (".haptic.wav", ".timeline.csv", ".replay.png")
        }
        assert finger.summary.duration == pytest.approx(2.0, abs=0.02)
    profiles = [
        set(
            read_timeline(finger.files["timeline"])["frequency"][
                read_timeline(finger.files["timeline"])["contact"] > 0
            ]
        )
        for finger in rendered
    ]
    assert profiles[0] != profiles[1]


@pytest.mark.slow
@pytest.mark.parametrize("codec", [OPUS, PCM])
def test_the_sound_of_each_finger_can_be_played_and_is_that_which_was_decoded(
    tmp_path: Path, hand: Path, codec: Codec
) -> None:
    path = recorded(tmp_path, codec, hand)
    with_sound = add_sound(path, tmp_path / "sound.mcap")
    for finger in ("thumb", "index"):
        assert len(messages(path, f"/tactophone/{finger}/prediction")) > 5
        if codec is OPUS:
            decoder = open_decoder(PayloadType.OPUS)
            contact = decoded(with_sound, f"/tactophone/{finger}/sound/contact")
            parts = [decoder.decode(packet.data) for packet in contact]
            # What was lost or came late is not in it.
            assert 50_000 < sum(map(len, parts)) < 96_000
            assert 0.2 < max(abs(part).max() for part in parts) < 1
        else:
            sound = decoded(with_sound, f"/tactophone/{finger}/sound")
            assert sound[0].number_of_channels == 2
            assert 50_000 < sum(len(part.data) for part in sound) / 4 < 96_000
    (whole,) = decoded_sessions(read_log(path))
    (index,) = write_sound(path, tmp_path, finger="index")
    assert index.path.name == "run-index.wav"
    found, _ = soundfile.read(index.path, always_2d=True)
    assert (found == joined(whole)[:, 2:4]).all()
    with pytest.raises(
        DatasetError, match="no finger 'ring' in this log; there are thumb, index"
    ):
        write_sound(path, tmp_path, finger="ring")


@pytest.mark.slow
def test_feel_takes_one_finger_and_the_data_set_takes_of_each(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["feel", str(log), "--finger", "index", "--out", str(tmp_path / "felt")])
        == 0
    )
    assert {path.name for path in (tmp_path / "felt").glob("*.haptic.wav")} == {
        "run-index.haptic.wav"
    }
    arguments = ["--surface", "slate", "--label", "rough"]
    assert (
        main(["dataset", "import", str(log), str(tmp_path / "takes"), *arguments]) == 0
    )
    assert "2 recordings" in capsys.readouterr().out
    manifest = (tmp_path / "takes" / "metadata.csv").read_text()
    assert "1-thumb" in manifest
    assert "1-index" in manifest
    assert (
        main(["feel", str(tmp_path / "felt" / "run-index.wav"), "--finger", "index"])
        == 1
    )


def test_settings_of_each_finger_are_in_the_log(log: Path) -> None:
    start = next(entry for entry in read_log(log) if isinstance(entry, RunStart))
    settings = settings_of(start)
    assert [finger.name for finger in settings.fingers] == ["thumb", "index"]
    assert ("rendering.profile", "perceptual") in settings.fingers[1].settings


def test_a_bag_holds_the_topics_of_each_finger(log: Path, tmp_path: Path) -> None:
    pytest.importorskip("cyclonedds")
    rosbags = pytest.importorskip("rosbags.rosbag2")
    assert main(["replay", str(log), "--to-rosbag", str(tmp_path / "bag")]) == 0
    with rosbags.Reader(tmp_path / "bag") as bag:
        topics = {
            connection.topic: connection.msgcount for connection in bag.connections
        }
    for finger in ("thumb", "index"):
        assert topics[f"/tactophone/{finger}/prediction"] > 150
        # One message holds the sound of a window.
        assert topics[f"/tactophone/{finger}/audio"] > 150
