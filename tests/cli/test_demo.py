import json
from pathlib import Path

import pytest
import soundfile

from tactophone.cli import main
from tests.dataset.folders import write_sound

pytestmark = pytest.mark.realtime


def test_the_demo_crosses_a_bad_network_and_writes_picture_sound_and_scores(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--out", str(tmp_path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert Path(report["picture"]).stat().st_size > 20_000
    sound, vibration = soundfile.info(report["microphones"]), soundfile.info(report["vibration"])
    assert (sound.channels, vibration.channels) == (2, 1)
    assert vibration.duration == pytest.approx(sound.duration, abs=1.0)
    assert report["counters"]["handshakes"] >= 1
    assert report["counters"]["packets_lost"] > 0
    assert report["touch_to_vibration"] < 0.05


def test_a_recording_may_replace_the_finger(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sound = write_sound(tmp_path / "stroke.wav")
    assert main(["demo", "--out", str(tmp_path / "out"), "--recording", str(sound), "--json"]) == 0
    assert Path(json.loads(capsys.readouterr().out)["picture"]).exists()
