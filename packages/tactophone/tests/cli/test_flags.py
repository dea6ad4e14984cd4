import argparse
from pathlib import Path

import pytest

from tactophone.cli import options
from tactophone.core.errors import ConfigError
from tactophone.core.settings import FingerSettings


def parse(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    options.add_settings(parser, "receive")
    options.add_flag(parser, "link.send_predictions")
    return parser.parse_args(words)


def test_flags_go_before_the_file_and_set_before_all(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(
        '[rendering]\nceiling = 0.1\n[link]\ncodec = "pcm16"\n'
    )
    settings = options.settings_of(
        parse(
            "--settings",
            str(tmp_path / "a.toml"),
            "--ceiling",
            "0.2",
            "--send-predictions",
        )
    )
    assert (
        settings.rendering.ceiling,
        settings.link.send_predictions,
        settings.link.codec,
    ) == (0.2, True, "pcm16")
    assert (
        options.settings_of(
            parse("--ceiling", "0.2", "--set", "rendering.ceiling=0.3")
        ).rendering.ceiling
        == 0.3
    )


def test_a_flag_out_of_range_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigError, match="0 to 1 of full drive"):
        options.settings_of(parse("--ceiling", "2"))
    with pytest.raises(SystemExit):
        parse("--help")
    text = " ".join(capsys.readouterr().out.split())
    assert "scaled down as a whole, 0 to 1 of full drive (default: 0.5)" in text


def test_a_verb_of_one_finger_takes_its_settings_from_the_hand(tmp_path: Path) -> None:
    path = tmp_path / "hand.toml"
    path.write_text('[thumb]\n[index]\nprofile = "lra"\n')
    parser = argparse.ArgumentParser()
    options.add_settings(parser, "receive")
    options.add_finger(parser)
    settings = options.settings_of(
        parser.parse_args(["--fingers", str(path), "--finger", "index"])
    )
    assert (settings.capture.contact, settings.rendering.profile, settings.fingers) == (
        "system:capture_3",
        "lra",
        (FingerSettings(),),
    )
    with pytest.raises(ConfigError, match="names thumb, index"):
        options.settings_of(parser.parse_args(["--fingers", str(path)]))


def test_a_verbs_own_default_is_shown_and_gives_way_to_flags_and_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    usual = ["link.codec=pcm16"]
    parser = argparse.ArgumentParser()
    options.add_settings(parser, "send", usual)
    (tmp_path / "a.toml").write_text('[link]\ncodec = "opus"\n')
    assert (
        options.settings_of(
            parser.parse_args(["--settings", str(tmp_path / "a.toml")]), usual
        ).link.codec
        == "pcm16"
    )
    assert (
        options.settings_of(parser.parse_args(["--codec", "opus"]), usual).link.codec
        == "opus"
    )
    assert (
        options.settings_of(
            parser.parse_args(["--set", "link.codec=opus"]), usual
        ).link.codec
        == "opus"
    )
    parser.print_help()
    assert "opus, pcm16 (default: pcm16)" in " ".join(capsys.readouterr().out.split())
