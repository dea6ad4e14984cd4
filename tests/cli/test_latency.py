import json

import pytest

from tactophone.cli import main


@pytest.mark.realtime
def test_figures_come_for_every_stage(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["latency", "--dummy", "--packet", "0.0025", "--clicks", "10", "--clicks-only", "--json"]
    assert main([*words, "--name", "test-latency-cli"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["period"] == 128
    assert told["clicks"] == 10
    assert set(told["milliseconds"]) >= {"capture", "judge", "device", "sum", "end to end"}
