"""What no machine, folder or number can be is refused in a line, without a
traceback."""

from pathlib import Path

import pytest

from tactophone.cli import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["pair", "show", "--identity", "~nobody-of-that-name/x"], "a whole path"),
        (["send", "--peer", 70 * "x"], "no name of a machine"),
    ],
)
def test_an_odd_value_is_one_line(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 1
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("text", ["a = " + 20_000 * "[", "a = 1" + 5_000 * "0"])
def test_settings_that_are_nested_or_counted_too_far_are_no_toml(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "odd.toml"
    path.write_text(f"[link]\n{text}\n")
    assert main(["send", "--settings", str(path)]) == 1
    assert f"{path} is not TOML" in capsys.readouterr().err
