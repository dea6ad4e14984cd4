import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.recordings.read import ground_truth
from tactophone.core.types import Touch
from tactophone.live.telemetry.timeline import read_timeline
from tests.folders import write_sound

pytestmark = pytest.mark.realtime

README = Path(__file__).parents[4] / "README.md"


def test_the_demo_crosses_a_bad_network_and_writes_picture_sound_and_scores(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--out", str(tmp_path), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert Path(report["picture"]).stat().st_size > 20_000
    sound, vibration = (
        soundfile.info(report["microphones"]),
        soundfile.info(report["vibration"]),
    )
    assert (sound.channels, vibration.channels) == (2, 1)
    assert vibration.duration == pytest.approx(sound.duration, abs=1.0)
    assert report["counters"]["handshakes"] >= 1
    assert report["counters"]["packets_lost"] > 0
    assert report["touch_to_vibration"] < 0.05
    _feel_agrees(report, tmp_path, capsys)
    _readme_agrees(report)


def _readme_agrees(demo: dict[str, Any]) -> None:
    """README shows what a demonstration prints: within what a bad network takes from
    another one."""
    shown = re.findall(r"on the (\w+) stone: +(\d+) %", README.read_text())
    assert [stone for stone, _ in shown] == ["smooth", "rough"]
    for stone, percent in shown:
        assert 100 * demo[f"{stone}_right"] == pytest.approx(int(percent), abs=10)


def _feel_agrees(
    demo: dict[str, Any], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recording of the demonstration, felt, is what was felt in it: two strokes,
    and nothing after them."""
    assert (
        main(["feel", demo["microphones"], "--events", "--json", "--out", str(folder)])
        == 0
    )
    felt = json.loads(capsys.readouterr().out)[0]
    live, offline = (
        read_timeline(Path(path))
        for path in (demo["timeline"], felt["files"]["timeline"])
    )
    assert felt["contact"] == pytest.approx(
        (live["touch"] != Touch.NONE).mean(), abs=0.03
    )
    assert felt["events"] == {"contact": 2, "tap": 2, "stroke": 2, "lift-off": 2}
    truth = ground_truth(Path(demo["microphones"]), duration=felt["duration"])
    after = np.ones(len(offline["time"]), bool)
    for segment in truth:
        if segment.contact:
            after &= (offline["time"] < segment.start) | (
                offline["time"] > segment.end + 0.3
            )
    assert not offline["amplitude"][after].any()


def test_the_demo_prints_two_sentences_and_its_picture_and_the_counts_if_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words, lines in (([], 3), (["--verbose"], 15)):
        assert main(["demo", "--out", str(tmp_path), *words]) == 0
        printed = [
            line
            for line in capsys.readouterr().out.splitlines()
            if "of vibration are missing" not in line
        ]
        assert [line.split(":")[0] for line in printed[-3:]][-1] == "picture"
        assert sum("stone:" in line for line in printed) == 2
        assert len(printed) == lines if lines == 3 else len(printed) >= lines


def test_a_recording_may_replace_the_finger(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = write_sound(tmp_path / "stroke.wav")
    assert (
        main(
            [
                "demo",
                "--out",
                str(tmp_path / "out"),
                "--recording",
                str(sound),
                "--json",
            ]
        )
        == 0
    )
    assert Path(json.loads(capsys.readouterr().out)["picture"]).exists()


def test_a_recording_that_begins_in_contact_is_touch_as_it_is_in_feel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    samples = np.random.default_rng(0).normal(scale=0.1, size=(4 * 48_000, 2))
    # Strokes, four in two seconds; a sound that is as steady as noise would be noise.
    phase = 2 * np.pi * np.arange(2 * 48_000) / 48_000
    samples[: 2 * 48_000] *= (np.abs(np.sin(phase)) ** 0.5 + 0.02)[:, None]
    samples[2 * 48_000 :] *= 1e-3
    soundfile.write(tmp_path / "touch.wav", samples.clip(-1, 1) + 0.05, 48_000)
    command = [
        "demo",
        "--out",
        str(tmp_path),
        "--recording",
        str(tmp_path / "touch.wav"),
        "--json",
    ]
    assert main(command) == 0
    live = read_timeline(Path(json.loads(capsys.readouterr().out)["timeline"]))
    assert (
        main(["feel", str(tmp_path / "touch.wav"), "--json", "--out", str(tmp_path)])
        == 0
    )
    (felt,) = json.loads(capsys.readouterr().out)
    inside = (live["time"] > 0.5) & (live["time"] < 1.8)
    assert (live["touch"][inside] != Touch.NONE).mean() > 0.95
    assert (live["touch"][live["time"] > 2.6] == Touch.NONE).all()
    assert felt["contact"] == pytest.approx(0.5, abs=0.1)
