import json

import pytest

from tactophone.cli import main
from tactophone.devices.dummy import DummyServer


@pytest.mark.realtime
@pytest.mark.usefixtures("portaudio")
def test_a_server_with_two_inputs_looks_right(jack_server: DummyServer, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["devices", "--json", "--set", f"process.jack_server={jack_server.name}"]) == 0
    jack, portaudio = json.loads(capsys.readouterr().out)
    assert (jack["inputs"], jack["outputs"], jack["sample_rate"]) == (2, 2, 48_000)
    assert jack["microphones"] == jack["actuator"] == ""
    assert "capture.air=system:capture_2" in jack["settings"]
    assert portaudio["system"] == "PortAudio, JACK Audio Connection Kit"
    assert portaudio["note"] == "use source jack instead"


def test_a_missing_server_says_how_to_start_one(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["devices", "--set", "process.jack_server=tactophone-none"]) == 0
    assert "jackd -R -d alsa" in " ".join(capsys.readouterr().out.split())
