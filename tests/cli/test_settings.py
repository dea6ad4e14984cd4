from pathlib import Path

import pytest

from tactophone import config
from tactophone.cli import main


def test_the_printed_file_is_read_back_as_the_defaults(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["settings"]) == 0
    path = tmp_path / "all.toml"
    path.write_text(capsys.readouterr().out)
    assert repr(config.read(path)) == repr(config.Settings())
    assert path.read_text().count(" = ") == len(list(config.entries()))
