import argparse
from pathlib import Path

import pytest

from tactophone.cli._support import flags
from tactophone.errors import ConfigError

FLAGS = {"--ceiling": "feel.ceiling", "--muted": "feel.muted", "--codec": "link.codec"}


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    flags.add_settings(parser, FLAGS)
    return parser.parse_args(words)


def test_flags_go_before_the_file_and_set_before_all(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('[feel]\nceiling = 0.1\n[link]\ncodec = "pcm16"\n')
    settings = flags.settings_of(parse("--config", str(tmp_path / "a.toml"), "--ceiling", "0.2", "--muted"))
    assert (settings.feel.ceiling, settings.feel.muted, settings.link.codec) == (0.2, True, "pcm16")
    assert flags.settings_of(parse("--ceiling", "0.2", "--set", "feel.ceiling=0.3")).feel.ceiling == 0.3


def test_a_flag_out_of_range_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigError, match="0 to 1 of full drive"):
        flags.settings_of(parse("--ceiling", "2"))
    with pytest.raises(SystemExit):
        parse("--help")
    helped = " ".join(capsys.readouterr().out.split())
    assert "no input and no page can pass this, 0 to 1 of full drive (default: 0.5)" in helped
