import json

import pytest

from tactophone.cli import main


@pytest.mark.realtime
def test_figures_come_for_every_stage(capsys: pytest.CaptureFixture[str]) -> None:
    words = [
        "latency",
        "--dummy",
        "--packet-duration",
        "0.0025",
        "--impulses",
        "10",
        "--no-decisions",
        "--json",
    ]
    assert main([*words, "--name", "test-latency-cli"]) == 0
    figures = json.loads(capsys.readouterr().out)
    assert figures["period"] == 128
    assert figures["impulses"] == 10
    assert set(figures["milliseconds"]) >= {
        "capture",
        "detect",
        "device",
        "sum",
        "end to end",
    }
