import json
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tests.models import write_tiny_model

pytestmark = pytest.mark.realtime


@pytest.fixture
def arguments(tmp_path: Path) -> list[str]:
    """Process two seconds of a rough tone, recorded at another rate than the link's, in
    a file."""
    tone = 0.5 * np.sin(2 * np.pi * 400 / 44_100 * np.arange(2 * 44_100))
    soundfile.write(
        tmp_path / "stroke.wav", np.stack([tone, 0.1 * tone], axis=1), 44_100
    )
    model = write_tiny_model(tmp_path / "tiny.onnx", gain=1e3)
    source = [
        "--source",
        f"file:{tmp_path / 'stroke.wav'}",
        "--set",
        "capture.loop=false",
    ]
    output = ["--actuator", f"file:{tmp_path / 'vibration.wav'}", "--ceiling", "0.25"]
    return [
        "loopback",
        *source,
        *output,
        "--model",
        str(model),
        "--name",
        f"test-{tmp_path.name}",
        "--json",
    ]


@pytest.mark.parametrize("network", ["clean", "wifi"])
def test_a_recording_crosses_the_network_and_is_rendered(
    arguments: list[str],
    network: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main([*arguments, "--network", network]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["counters"]["packets_received"] > 300
    assert figures["restarts"] == 0
    vibration, rate = soundfile.read(tmp_path / "vibration.wav")
    assert rate == 48_000
    assert 0.2 < np.abs(vibration).max() <= 0.25


@pytest.mark.parametrize(
    ("number", "code"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)]
)
def test_a_signal_ends_a_run_in_order_with_its_figures(
    arguments: list[str], number: int, code: int
) -> None:
    command = [
        sys.executable,
        "-m",
        "tactophone",
        *arguments,
        "--set",
        "capture.loop=true",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr
        next(line for line in process.stderr if line.startswith("connected"))
        process.send_signal(number)
        output, _ = process.communicate(timeout=20)
    assert process.returncode == code
    assert json.loads(output)["restarts"] == 0


@pytest.mark.parametrize("duration", ["nan", "-3", "inf", "long"])
def test_a_duration_that_is_none_is_refused(
    arguments: list[str], duration: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, f"--duration={duration}"]) == 1
    assert f"--duration {duration}: must be " in capsys.readouterr().err


def test_an_unknown_port_or_file_is_one_line(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--source", "file:nowhere.wav"]) == 1
    assert "nowhere.wav" in capsys.readouterr().err
    assert main([*arguments, "--ceiling", "7"]) == 1
    assert "0 to 1 of full drive" in capsys.readouterr().err
