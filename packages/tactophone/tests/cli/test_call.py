"""What the two persons of a call read; who is called and how is tested in
packages/tactophone/tests/net/call."""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast
from unittest.mock import Mock

import pytest

from tactophone.cli import call, main
from tactophone.core.errors import ConfigError
from tactophone.net.call.process import Found
from tactophone.net.link.identity import Peers

KEY = ":".join(["AB"] * 32)
FOUND = Found(
    "lab-pc",
    KEY,
    "robot",
    [],
    "203.0.113.7",
    relayed=False,
    after=0.4,
    round_trip=0.023,
    again=False,
)


class Person:
    """Stands for the process of the call and for the live side: notes what is asked of
    them."""

    def __init__(self) -> None:
        self.answered: list[bool] = []
        self.begun: list[str] = []

    def answer(self, accepted: bool) -> None:
        self.answered.append(accepted)

    def begin(self, role: str) -> None:
        self.begun.append(role)


@pytest.mark.parametrize(
    ("trusted", "words"),
    [
        ({KEY: "workshop"}, "you trust its key, as workshop"),
        (
            {":".join(["CD"] * 32): "workshop"},
            "its key is new to this machine: AB:AB:AB:AB...",
        ),
        ({}, "its key is new to this machine: AB:AB:AB:AB..."),
    ],
)
def test_who_answers_reads_whether_the_caller_s_key_is_known(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    trusted: dict[str, str],
    words: str,
) -> None:
    Peers(trusted).save(tmp_path)
    person, args = (
        cast(Any, Person()),
        argparse.Namespace(code="3-escapade-peachy", yes=True),
    )
    steps = iter(
        [
            ("code", args.code),
            ("asked", ["lab-pc", "operator", "0.1.0", KEY]),
            ("found", FOUND),
        ]
    )
    assert (
        call.find_other_end(person, cast(Any, steps), args, person, tmp_path) is FOUND
    )
    shown = capsys.readouterr().err
    assert f"lab-pc calls, the operator, with tactophone 0.1.0; {words}" in " ".join(
        shown.split()
    )
    assert (
        "connected directly to 203.0.113.7 in 0.4 s, encrypted, 23 ms there and back; "
        "you are the robot" in shown
    )
    assert (person.answered, person.begun) == ([True], ["robot"])


@pytest.mark.parametrize(
    ("role", "words"),
    [
        (
            "operator",
            [
                "the robot is still starting; lab-pc says when it is ready",
                "the robot is opening its microphones",
            ],
        ),
        (
            "robot",
            [
                "the operator is still starting; lab-pc says when it is ready",
                "the operator is opening its output",
            ],
        ),
    ],
)
def test_each_end_reads_how_far_the_other_one_is(
    capsys: pytest.CaptureFixture[str], role: Any, words: list[str]
) -> None:
    def steps() -> Iterator[tuple[Any, Any]]:
        yield from (("state", each) for each in ("starting", "opening", "ready"))

    found = Found(
        "lab-pc",
        KEY,
        role,
        [],
        "203.0.113.7",
        relayed=False,
        after=0.4,
        round_trip=0.02,
        again=False,
    )
    call.report_changes(steps(), found, [])
    lines = capsys.readouterr().err.splitlines()
    assert [line.strip() for line in lines] == [
        *words,
        f"{words[0].partition(' is ')[0]} is ready",
    ]


@pytest.mark.parametrize(
    "said",
    [
        ["3-escapade-peachy"],
        ["3-Escapade-Peachy"],
        ["3 escapade peachy"],
        ["3", "escapade", "Peachy"],
        ["3, escapade, peachy"],
    ],
)
def test_a_code_is_understood_as_it_is_spoken(said: list[str]) -> None:
    assert call.code_as_shown(said) == "3-escapade-peachy"


@pytest.mark.parametrize("said", [["3-escapade"], ["3"], ["3-a-b-c"], ["3-escapade-7"]])
def test_what_begins_as_a_code_and_is_none_is_told_at_once(said: list[str]) -> None:
    with pytest.raises(
        ConfigError, match="is no code: a code is a number and two words"
    ):
        call.code_as_shown(said)


@pytest.mark.parametrize(
    ("typed", "words"),
    [("3 escapade", "'3 escapade' is no code"), (EOFError(), "there is no code")],
)
def test_a_code_is_asked_for_as_other_users_read_what_stands_after_a_verb(
    typed: str | BaseException,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    asked = Mock(side_effect=[typed])
    monkeypatch.setattr("builtins.input", asked)
    assert main(["answer", "--yes"]) == 1
    assert words in capsys.readouterr().err
    asked.assert_called_once_with("code: ")


def test_without_a_standard_input_nobody_can_accept_a_call(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """As after ``tactophone answer CODE <&-``."""
    monkeypatch.setattr("sys.stdin", None)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["answer", "7-crossover-clockwork"]) == 1
    said = capsys.readouterr().err
    assert "add --yes to accept" in said
    assert "Traceback" not in said


@pytest.mark.parametrize(
    ("answer", "accepts"),
    [("Y", True), ("", False), (EOFError(), False), (KeyboardInterrupt(), False)],
)
def test_ctrl_c_and_the_end_of_the_input_decline_a_call(
    answer: str | BaseException, accepts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-D was a traceback, and after either the caller went on waiting."""

    def ask(_: str) -> str:
        if isinstance(answer, BaseException):
            raise answer
        return answer

    monkeypatch.setattr("builtins.input", ask)
    assert call._accepts() is accepts
