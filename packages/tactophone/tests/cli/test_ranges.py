import argparse
from collections.abc import Iterator

import pytest

from tactophone.cli import add_verb, main
from tactophone.cli.options import Parser, Within
from tactophone.cli.verbs import all_verbs
from tactophone.core.errors import ConfigError


def options(parser: Parser) -> Iterator[argparse.Action]:
    """Yield all options of a verb, and of its actions, whose parsers are choices."""
    for argument in parser.arguments:
        if isinstance(argument.choices, dict):
            for action in argument.choices.values():
                yield from options(action)
        else:
            yield argument


@pytest.mark.parametrize("verb", all_verbs())
def test_every_number_states_and_checks_its_range(verb: str) -> None:
    parser = Parser(prog=verb)
    add_verb(parser, all_verbs()[verb])
    for option in options(parser):
        assert option.choices or option.type not in (int, float), (
            f"{option.option_strings}: give the range, a `Within`"
        )
        assert not isinstance(option.type, Within) or "%(type)s" in str(option.help), (
            option.option_strings
        )


@pytest.mark.parametrize("text", ["-1", "0", "1.5", "nan", "inf", "many"])
def test_a_number_out_of_its_range_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match="over 0 to 1 s"):
        Within(float, 0, 1, over=True, unit="s")(text)


@pytest.mark.parametrize("text", ["1.0", "-1", "inf", "nan"])
def test_a_whole_number_is_whole(text: str) -> None:
    with pytest.raises(ConfigError, match="0 or more"):
        Within(int, 0)(text)


def test_the_error_names_the_option_in_one_line(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["finetune", "paper", "new", "--general", "old", "--seed", "-1"]) == 1
    assert capsys.readouterr().err == (
        "tactophone: --seed -1: must be 0 to 4294967295\n"
    )
