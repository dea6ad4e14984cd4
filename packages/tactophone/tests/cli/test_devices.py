import io
import json
import os
import pty
import re
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.cli.devices import QUICKEST, _answer
from tactophone.live.audio.dummy import DummyServer


@pytest.mark.realtime
@pytest.mark.usefixtures("portaudio")
def test_a_server_with_two_inputs_looks_right(
    jack_server: DummyServer, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["devices", "--json", "--set", f"process.jack_server={jack_server.name}"])
        == 0
    )
    jack, portaudio = json.loads(capsys.readouterr().out)
    assert (jack["inputs"], jack["outputs"], jack["sample_rate"]) == (2, 2, 48_000)
    assert jack["microphones"] == jack["actuator"] == ""
    assert "capture.air=system:capture_2" in jack["settings"]
    assert portaudio["system"] == "PortAudio, JACK Audio Connection Kit"
    assert portaudio["note"] == "use source jack instead"


def test_a_missing_server_says_how_to_start_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["devices", "--set", "process.jack_server=tactophone-none"]) == 0
    assert "jackd -R -d alsa" in " ".join(capsys.readouterr().out.split())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("felt_from", "code", "advice"),
    [
        ({60: -20, 217: -50}, 0, "You will feel both"),
        ({60: -10, 217: -35}, 1, "up by 11 dB"),
        ({}, 1, "check cable, port"),
    ],
)
def test_bursts_grow_until_they_are_felt_and_stay_under_the_ceiling(
    felt_from: dict[int, int],
    code: int,
    advice: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def answer(question: str) -> str:
        found = re.match(r" *(\d+) Hz, +(-?\d+) dB", question)
        return "y" if found and int(found[2]) >= felt_from.get(int(found[1]), 1) else ""

    monkeypatch.setattr("sys.stdin", io.StringIO())
    monkeypatch.setattr("builtins.input", answer)
    monkeypatch.setattr("tactophone.cli.devices.BURST", 0.1)
    path = tmp_path / "felt.wav"
    words = ["--actuator", f"file:{path}", "--set", "rendering.ceiling=0.3"]
    assert main(["devices", "feel", *words]) == code
    assert advice in capsys.readouterr().out
    assert (
        0.3 * 10 ** (-21 / 20)
        < np.abs(soundfile.read(path)[0]).max()
        <= np.float32(0.3)
    )


def test_a_paste_and_a_held_enter_key_answer_no_question(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Burst after burst was played up to the ceiling, and nobody had answered."""
    typist, terminal = pty.openpty()
    answers: list[str] = []

    def ask() -> None:
        answers.append(_answer("felt? "))

    with os.fdopen(terminal, "r") as stdin:
        monkeypatch.setattr("sys.stdin", stdin)
        os.write(typist, b"\n" * 25)
        thread = threading.Thread(target=ask, daemon=True)
        thread.start()
        for _ in range(10):
            os.write(typist, b"\n")
            time.sleep(0.03)
        assert answers == []
        time.sleep(2 * QUICKEST)
        os.write(typist, b"y\n")
        thread.join(5.0)
    os.close(typist)
    assert [answer.strip() for answer in answers] == ["y"]


def test_without_a_terminal_no_burst_is_played(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    assert main(["devices", "feel", "--actuator", f"file:{tmp_path / 'felt.wav'}"]) == 1
    assert "run it on a terminal" in capsys.readouterr().err
    assert not (tmp_path / "felt.wav").exists()
