from pathlib import Path

import pytest

from tactophone.cli import main

from ..models import write_tiny_model
from ..runtime.live_system import LiveSystem, eventually


@pytest.mark.realtime
def test_stop_mute_and_arm_reach_a_running_process(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))
    with line.both():
        assert eventually(lambda: line.amplitude() > 0.3)
        assert main(["mute", line.names[1]]) == 0
        assert eventually(lambda: line.amplitude() == 0.0)
        assert main(["arm", line.names[1]]) == 0
        assert eventually(lambda: line.amplitude() > 0.3)
        assert capsys.readouterr().out.splitlines()[-1] == f"{line.names[1]}: armed"


def test_with_no_process_the_error_says_what_to_start(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stop", "telephone"]) == 1
    assert "tactophone receive" in capsys.readouterr().err
