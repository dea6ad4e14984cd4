import json
from pathlib import Path

import pytest
import soundfile

from tactophone.cli import main
from tests.dataset.folders import write_sound

pytestmark = pytest.mark.realtime


def test_the_demo_crosses_a_bad_line_and_leaves_picture_sound_and_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--out", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert Path(told["picture"]).stat().st_size > 20_000
    heard, felt = soundfile.info(told["microphones"]), soundfile.info(told["vibration"])
    assert (heard.channels, felt.channels) == (2, 1)
    assert felt.duration == pytest.approx(heard.duration, abs=1.0)
    assert told["counters"]["handshakes"] >= 1
    assert told["counters"]["packets_lost"] > 0
    assert told["touch_to_felt"] < 0.05


def test_a_recording_may_stand_for_the_finger(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sound = write_sound(tmp_path / "stroke.wav")
    assert main(["demo", "--out", str(tmp_path / "out"), "--recording", str(sound), "--json"]) == 0
    assert Path(json.loads(capsys.readouterr().out)["picture"]).exists()
