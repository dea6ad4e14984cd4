import pytest

from tactophone.cli import main


def test_version_and_help_exit_with_zero(capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as stop:
            main([flag])
        assert stop.value.code == 0
    assert "tactophone" in capsys.readouterr().out


def test_an_unknown_verb_is_a_usage_error() -> None:
    with pytest.raises(SystemExit) as stop:
        main(["telephone"])
    assert stop.value.code == 2
