from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.core.settings import SETTINGS, Settings, read_settings


def test_the_printed_file_is_read_back_as_the_defaults(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["settings"]) == 0
    path = tmp_path / "all.toml"
    path.write_text(capsys.readouterr().out)
    assert repr(read_settings(path)) == repr(Settings())
    assert path.read_text().count(" = ") == len(list(SETTINGS.values()))
