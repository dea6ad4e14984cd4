"""Options: the parser of every verb, numbers with a range, and the settings on the
command line."""

import argparse
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NoReturn, TypeAlias

from tactophone.app.sources import refuse_overwriting
from tactophone.core.errors import ConfigError, DatasetError, did_you_mean
from tactophone.core.hand import finger_named, with_fingers
from tactophone.core.settings import SETTINGS, Settings, change, read_settings


@dataclass(frozen=True, slots=True)
class Within:
    """The type of an option that takes a number from ``low`` to ``high``; write the
    range as ``%(type)s`` in its help.

    ``kind`` is ``int`` or ``float``; with ``over``, ``low`` itself is out of the range.
    Called with a text, it raises `ConfigError` unless that is a number in the range.

    >>> str(Within(float, 0, 1, unit="of full drive"))
    '0 to 1 of full drive'
    >>> str(Within(int, 1))
    '1 or more'
    >>> str(Within(float, 0, over=True, unit="s"))
    'over 0 s'
    >>> str(Within(int, 0, 2_000_000_000))
    '0 to 2000000000'
    """

    kind: type[int] | type[float]
    low: float
    high: float = math.inf
    over: bool = False
    unit: str = ""

    def __call__(self, text: str) -> float:
        try:
            value = self.kind(text)
        except ValueError:
            raise ConfigError(
                f"{text}: must be a {'whole ' * (self.kind is int)}number, {self}"
            ) from None
        outside = (
            not self.low <= value <= self.high
            or (self.over and value == self.low)
            or value == math.inf
        )
        if outside:
            raise ConfigError(f"{text}: must be {self}")
        return value

    def __str__(self) -> str:
        low = f"{'over ' * self.over}{self.low:g}"
        unit = f" {self.unit}" * bool(self.unit)
        if self.high < math.inf:
            return f"{low} to {self.high:.12g}{unit}"
        return f"{low}{unit}" if self.over else f"{low}{unit} or more"


SEED = Within(int, 0, 2**32 - 1)
"""A random seed, which NumPy, torch and scikit-learn all take."""

PROCESSES = Within(int, 1, 256)
"""How many processes share work: each has the libraries in memory, some 200 MB."""


def per_minute(text: str) -> float:
    """Parse a rate such as ``1/min``, over 0 to 600 a minute.

    Raises `DatasetError` if the text is not such a rate.

    >>> per_minute("0.5/min")
    0.5
    """
    number, _, unit = text.partition("/")
    if unit in ("", "min"):
        with suppress(ConfigError):
            return Within(float, 0, 600, over=True)(number)
    raise DatasetError(
        f"{text!r} is not a rate; write a number over 0 to 600 a minute, such as 1/min"
    )


class HelpFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows the default of each option that has one, and examples line by line."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        # bool first, as it is a number too; an empty text or list is no default worth
        # showing, but 0 is.
        default = action.default
        shown = default is not argparse.SUPPRESS and (
            default or isinstance(default, int | float)
        )
        words = (
            super()._get_help_string(action)
            if shown and not isinstance(default, bool)
            else action.help
        )
        return (
            words.replace("%(default)s", "%(default)g")
            if words and isinstance(default, float)
            else words
        )

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if "\n" in text:
            return "\n".join(
                _in_columns(indent + line, width) for line in text.splitlines()
            )
        return super()._fill_text(text, width, indent)


def _in_columns(line: str, width: int) -> str:
    """Wrap a line of a name and its explanation within the second column.

    Other lines stay whole: an example is copied.
    """
    name = re.match(r" *[\w-]+ {2,}(?=\S)", line)
    if name is None:
        return line
    return textwrap.fill(line, width, subsequent_indent=" " * name.end())


FIRST_OPTIONS = (
    "out",
    "plot",
    "recording",
    "data",
    "recipe",
    "split",
    "smooth",
    "rough",
    "check",
    "peer",
    "source",
    "actuator",
    "tip",
    "dashboard",
    "lan",
    "https",
    "open",
    "model",
    "record",
    "network",
    "baselines",
    "threshold",
    "duration",
)
"""Options by how soon a newcomer needs them."""

SHOWN_OPTIONS = 6
"""How many of a verb's options its short help shows, unless it has hardly more."""


class _Help(argparse.Action):
    """``--help`` shows the options that a newcomer needs, ``--help all`` every one."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        _: object,
        values: Any,
        option: str | None = None,
    ) -> None:
        assert isinstance(parser, Parser)
        own = [
            action
            for action in parser.arguments
            if action.option_strings and action is not self
        ]
        if values != "all" and len(own) > SHOWN_OPTIONS + 2:
            ranks = {f"--{name}": rank for rank, name in enumerate(FIRST_OPTIONS)}
            own.sort(
                key=lambda action: (
                    not action.required,
                    ranks.get(action.option_strings[-1], len(ranks)),
                )
            )
            for action in own[SHOWN_OPTIONS:]:
                action.help = argparse.SUPPRESS
            more = (
                f"{len(own) - SHOWN_OPTIONS} more options: `{parser.prog} --help all`\n"
            )
            parser.epilog = "\n".join(filter(None, (more, parser.epilog)))
        parser.print_help()
        parser.exit()


class Parser(argparse.ArgumentParser):
    """Shows defaults and examples, and names in errors the option or choice nearest to
    an unknown one.

    An option is not found by its beginning: ``--finger`` must not become ``--fingers``.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__(
            formatter_class=HelpFormatter, allow_abbrev=False, add_help=False, **options
        )
        self.add_argument(
            "-h",
            "--help",
            action=_Help,
            nargs="?",
            default=argparse.SUPPRESS,
            metavar="all",
            help="show this help and exit; --help all shows every option",
        )

    @property
    def arguments(self) -> Sequence[argparse.Action]:
        """All options and arguments of this parser, in order."""
        return self._actions

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse, and refuse what is unknown at once: this parser knows which options
        are near."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            option = unknown[0].partition("=")[0]
            near = did_you_mean(
                option,
                (name for action in self.arguments for name in action.option_strings),
            )
            self.error(
                "unrecognized arguments: "
                f"{' '.join(unknown)}{near if option.startswith('-') else ''}"
            )
        return found, unknown

    def _get_value(self, action: argparse.Action, arg_string: str) -> Any:
        try:
            return super()._get_value(action, arg_string)
        except ConfigError as error:  # of a `Within`
            raise ConfigError(f"{action.option_strings[-1]} {error}") from None

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            error.message += did_you_mean(str(value), map(str, action.choices or ()))
            raise

    def error(self, message: str) -> NoReturn:
        """Print the message and how to get help, and exit with 2."""
        self.exit(
            2, f"{self.prog}: {message}\n`{self.prog} --help` shows what there is\n"
        )


def flags_of(verb: str) -> list[str]:
    """Return the names of the settings for which a verb has an option."""
    return [name for name, setting in SETTINGS.items() if verb in setting.verbs]


Container: TypeAlias = argparse._ActionsContainer
"""What takes options: a parser, or a group of its options."""


def add_flag(group: Container, name: str, default: Any = None) -> None:
    """Add the option of a setting, with its words, range and default; ``default`` is
    the verb's own."""
    setting = SETTINGS[name]
    # What follows says what the value means that stands for "not given" in a file.
    words, *unset = re.split("; (?:nan|empty): ", setting.words)
    words = replace(setting, words=words).help.replace("%", "%%")
    if isinstance(setting.default, bool):
        given = "true"
        if setting.default:  # the option of a switch that is on turns it off
            given = "false"
            words = f"do not {words}"
        group.add_argument(
            setting.flag, dest=name, action="store_const", const=given, help=words
        )
        return
    value = setting.default
    if default is not None:
        value = default
    elif unset:
        value = unset[0]
    shown = "" if value == "" else f" (default: {value})"
    if setting.unit == "s":
        kind = "S"
    elif isinstance(setting.default, int | float):
        kind = "N"
    else:
        kind = setting.flag[2:].upper()
    group.add_argument(
        setting.flag,
        dest=name,
        action="append" if name == "link.peer" else "store",
        metavar="NAME[:DEVICE]" if setting.device else kind,
        help=f"{words}{shown}",
    )


def add_settings(
    parser: argparse.ArgumentParser, verb: str, usual: Sequence[str] = ()
) -> None:
    """Add ``--settings``, ``--set`` and the options that `tactophone.core.settings`
    declares for a verb.

    ``usual`` are the verb's own defaults, as in `settings_of`.
    """
    own = dict(setting.split("=", 1) for setting in usual)
    group = parser.add_argument_group("settings (all of them: `tactophone settings`)")
    group.add_argument(
        "--settings",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="TOML file of settings; options override it, and so does a later file",
    )
    words = "any other setting, such as link.port=48471"
    group.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help=words
    )
    for name in flags_of(verb):
        add_flag(group, name, own.get(name))


def add_actions(
    parser: argparse.ArgumentParser,
) -> Callable[..., argparse.ArgumentParser]:
    """Let a verb have actions; returns what adds one, by its name, its words and the
    function that runs it."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)

    def add(
        name: str, words: str, run: Callable[[argparse.Namespace], int]
    ) -> argparse.ArgumentParser:
        action = actions.add_parser(name, help=words, description=words)
        action.set_defaults(run=run)
        return action

    return add


def add_fingers(parser: argparse.ArgumentParser) -> None:
    words = (
        "a hand: its number of fingers, 1 to 10, or a TOML file with a table for each "
        "(docs/guide/hand.md); both ends need as many (default: one finger, and no "
        "file)"
    )
    parser.add_argument("--fingers", metavar="N|FILE", help=words)


def add_finger(parser: argparse.ArgumentParser) -> None:
    add_fingers(parser)
    parser.add_argument(
        "--finger", metavar="NAME", help="the finger of --fingers to use, such as index"
    )


def add_figure(parser: argparse.ArgumentParser, place: str = "") -> None:
    parser.add_argument(
        "--plot",
        action="store_true",
        help=f"draw a figure of sound, prediction and vibration{place}",
    )


def add_json(
    parser: argparse.ArgumentParser, words: str = "print JSON, for a program"
) -> None:
    parser.add_argument("--json", action="store_true", help=words)


def settings_of(args: argparse.Namespace, usual: Sequence[str] = ()) -> Settings:
    """Return the settings in force: defaults < ``--settings`` < options < ``--set``;
    ``--fingers`` adds to each finger.

    ``usual`` are defaults of the verb, such as ``"output.actuator=none"``; they come
    before the options.
    """
    settings = _settings_of(args, usual)
    # One option is a switch in some verbs, and a folder in others.
    named = (getattr(args, name, None) for name in ("out", "plot"))
    refuse_overwriting(settings, [each for each in named if isinstance(each, Path)])
    return settings


def _settings_of(args: argparse.Namespace, usual: Sequence[str]) -> Settings:
    settings = Settings()
    for path in getattr(args, "settings", ()):
        settings = read_settings(path, settings)
    settings = change(settings, usual)
    for name, value in vars(args).items():
        if name in SETTINGS and value is not None:
            settings = change(
                settings, _assignments(name, value), where=SETTINGS[name].flag
            )
    settings = change(settings, getattr(args, "set", ()))
    if fingers := getattr(args, "fingers", None):
        settings = with_fingers(settings, fingers)
    # Only a verb that works with one finger has the option --finger beside --fingers.
    if (
        hasattr(args, "fingers")
        and hasattr(args, "finger")
        and (args.finger or fingers)
    ):
        return finger_named(settings, args.finger)
    return settings


def assigned(texts: Iterable[str], option: str = "--set") -> dict[str, str]:
    """Return the values of ``NAME=VALUE`` by name, with underscores; raises
    `ConfigError` without ``=``."""
    values = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals:
            raise ConfigError(f"{option} {text}: wanted NAME=VALUE, such as epochs=5")
        values[name.replace("-", "_")] = value
    return values


def _assignments(name: str, value: Any) -> Iterable[str]:
    """Return the assignments of an option: two for ``--source file:take.wav``, one for
    ``--peer a --peer b``."""
    text = value if isinstance(value, str) else ",".join(value)
    setting = SETTINGS[name]
    if not setting.device:
        return [f"{name}={text}"]
    kind, colon, device = text.partition(":")
    if not colon:
        return [f"{name}={text}"]
    if kind == "jack" and name == "capture.source":
        raise ConfigError(
            f"{setting.flag} {text}: JACK has ports: --set capture.contact=PORT --set "
            "capture.air=PORT"
        )
    return [
        f"{name}={kind}",
        f"{'output.port' if kind == 'jack' else setting.device}={device}",
    ]


def add_recorded_channels(parser: argparse.ArgumentParser) -> None:
    """Add ``--channels`` of a recording with more channels than a finger has."""
    parser.add_argument(
        "--channels",
        type=recorded_channels,
        default=(),
        metavar="N[,N]",
        help="the contact microphone's channel in the file, and the air microphone's, "
        "from 1 on, such as 3,4 (default: 1,2; needed for files of more than two)",
    )


def microphones(text: str) -> int | tuple[int, ...]:
    """Parse how many microphones to use, or which two channels of a file they are.

    >>> microphones("1"), microphones("3,4")
    (1, (2, 3))
    """
    if text in ("1", "2"):
        return int(text)
    if "," in text:
        return recorded_channels(text)
    raise argparse.ArgumentTypeError(
        f"{text}: write 1 or 2 for how many microphones to use, or two channels such "
        "as 3,4"
    )


def recorded_channels(text: str) -> tuple[int, ...]:
    """Parse the channels of a recording, counted from 1, into places counted from 0.

    >>> recorded_channels("3,4")
    (2, 3)
    """
    try:
        numbers = [int(number) for number in text.split(",")]
    except ValueError:
        numbers = []
    if (
        not 1 <= len(numbers) <= 2
        or min(numbers) < 1
        or len(set(numbers)) < len(numbers)
    ):
        raise argparse.ArgumentTypeError(
            f"{text!r}: write one channel or two, from 1 on, such as 3,4"
        )
    return tuple(number - 1 for number in numbers)
