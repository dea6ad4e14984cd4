"""What all verbs have in common: examples that hold, and hints for what is mistyped."""

import shlex

import pytest

from tactophone.cli import _parse, main, options
from tactophone.cli.verbs import GROUPS, LABORATORY, OWN, all_verbs
from tactophone.core.errors import ConfigError

QUICK = [
    "tactophone devices --json",
    "tactophone settings > robot.toml",
    "tactophone status --json",
    "tactophone model show texture",
    "tactophone simulate objects",
]
"""Examples that need no device, no file and less than two seconds."""


def test_every_verb_stands_in_a_group_that_the_help_lists() -> None:
    assert {verb.group for verb in all_verbs().values()} == set(GROUPS)


def test_the_telephone_knows_which_verbs_the_laboratory_adds() -> None:
    assert set(all_verbs()) - {verb.name for verb in OWN} >= set(LABORATORY)


@pytest.mark.parametrize("verb", all_verbs())
def test_the_examples_of_a_verb_are_understood(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert all_verbs()[verb].examples
    for example in all_verbs()[verb].examples:
        program, *words = shlex.split(example.partition(">")[0])
        assert program == "tactophone"
        assert _parse(words, words[0]).verb == words[0]
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    assert all_verbs()[verb].examples[0] in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("example", QUICK)
def test_quick_examples_run(example: str) -> None:
    words = shlex.split(example.partition(">")[0])[1:]
    assert example in all_verbs()[words[0]].examples
    assert main(words) == 0


def test_the_program_alone_prints_a_short_help(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit, match="0"):
        main([])
    printed = capsys.readouterr().out
    assert "\n  demo " in printed


@pytest.mark.parametrize("words", [["--help"], ["--help", "all"]])
def test_the_list_of_verbs_keeps_its_columns_in_a_narrow_terminal(
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    with pytest.raises(SystemExit, match="0"):
        main(words)
    *lines, last = capsys.readouterr().out.splitlines()
    assert [line for line in lines if len(line) > 60] == []
    assert last.startswith("`tactophone VERB --help`")


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["fele"], "there is no verb fele; did you mean feel?"),
        (["feel", "a.wav", "--plt"], "did you mean --plot?"),
        (["--vesrion"], "did you mean --version?"),
        (["--set", "a=b", "demo"], "`tactophone VERB --set`, not before it"),
        (["--dashboard", "play"], "`tactophone play --dashboard`, not before it"),
        (["loopback", "--finger", "index"], "did you mean --fingers?"),
        (
            ["simulate", "dataset", "out", "--seconds", "3", "--scenario"],
            "did you mean --scenarios?",
        ),
    ],
)
def test_what_is_mistyped_gets_a_hint(
    words: list[str], hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    assert hint in capsys.readouterr().err


def test_a_setting_and_its_device_are_one_option() -> None:
    words = ["--source", "file:take:2.wav", "--actuator", "jack:system:playback_3"]
    settings = options.settings_of(_parse(["loopback", *words], "loopback"))
    assert (settings.capture.source, settings.capture.device) == ("file", "take:2.wav")
    assert (settings.output.actuator, settings.output.port) == (
        "jack",
        "system:playback_3",
    )
    with pytest.raises(ConfigError, match=r"capture\.contact=PORT"):
        options.settings_of(
            _parse(["send", "--source", "jack:system:capture_3"], "send")
        )
