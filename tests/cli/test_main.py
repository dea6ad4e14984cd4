import pytest

from tactophone.cli import main


def test_version_and_help_exit_with_zero(capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as stop:
            main([flag])
        assert stop.value.code == 0
    printed = capsys.readouterr().out
    assert "tactophone" in printed
    assert "open_pipeline" not in printed  # the example of the package is for Python


def test_an_unknown_verb_is_a_usage_error() -> None:
    with pytest.raises(SystemExit) as stop:
        main(["telephone"])
    assert stop.value.code == 2
