"""The command line: one program, and the only room that prints."""

import argparse
import errno
import os
import sys
from collections.abc import Sequence

import tactophone
from tactophone.cli import output
from tactophone.cli.options import Parser
from tactophone.cli.verbs import GROUPS, LABORATORY, Verb, all_verbs
from tactophone.core import extras
from tactophone.core.errors import ConfigError, TactophoneError, did_you_mean
from tactophone.core.version import __version__

_ABOUT = " ".join((tactophone.__doc__ or "").partition("\n\n")[0].split())


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; return its exit code: 0, 1 (one line on stderr), 2 (usage) or 130
    (interrupted)."""
    words = list(sys.argv[1:] if argv is None else argv)
    verb = (
        ""
        if words[:1] in (["-h"], ["--help"])
        else next((word for word in words if not word.startswith("-")), "")
    )
    args = argparse.Namespace()
    try:
        args = _parse(words or ["--help"], verb)
        extras.require_extras(*_needed(args))
        code = int(args.run(args))
        if sys.stdout is not None:  # it is closed with `>&-`
            sys.stdout.flush()  # here, so that a full disk is reported
        return code
    except TactophoneError as error:
        output.print_error(str(error))
        return 1
    except ModuleNotFoundError as error:
        output.print_error(extras.explain(error))
        return 1
    except KeyboardInterrupt:
        output.print_error("interrupted")
        return 130
    except BrokenPipeError:
        # The reader of our output has closed it (`tactophone ... | head`), which is no
        # error.
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        full = error.errno == errno.ENOSPC
        given = map(vars(args).get, ("out", "plot", "to_rosbag", "identity"))
        where = (
            error.filename
            or (full and next(filter(None, given), None))
            or "cannot read or write"
        )
        advice = "; free some space, or write elsewhere" if full else ""
        output.print_error(f"{where}: {error.strerror or error}{advice}")
        return 1
    except RuntimeError as error:
        if "home directory" in str(error):  # of pathlib, for ~ and ~NAME
            output.print_error("there is no such home folder: give a whole path")
            return 1
        # By name: the library of sound files takes long to import, and tells nobody
        # that the disk is full.
        if type(error).__name__ != "LibsndfileError":
            raise
        output.print_error(
            f"{error} A sound file cannot be read or written: is the disk full? Free "
            "some space"
        )
        return 1


def _needed(args: argparse.Namespace) -> list[str]:
    """Return the extras of a verb and its options, so that nothing is computed first
    that could then not be shown."""
    options = ("plot", "ray")  # each named like its extra
    of_options = [name for name in options if getattr(args, name, None)]
    return [*all_verbs()[args.verb].extras, *of_options]


def _discard_output() -> None:
    """Redirect stdout to nothing: what is still buffered would raise the same error
    again at exit."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parse(words: list[str], verb: str) -> argparse.Namespace:
    parser = Parser(
        prog="tactophone",
        description=_ABOUT,
        epilog=_listed(words),
        usage="%(prog)s [--help [all]] [--version] VERB ...",
    )
    parser.add_argument(
        "--version", action="version", version=f"tactophone {__version__}"
    )
    _refuse_leading_option(parser, words, verb)
    if verb in LABORATORY and verb not in all_verbs():
        raise ConfigError(
            f"{verb} is a verb of tactophone-lab, which is not installed: "
            f"{extras.INSTALL_LABORATORY}"
        )
    if verb and verb not in all_verbs():
        names = (*all_verbs(), *LABORATORY)
        parser.error(f"there is no verb {verb}{did_you_mean(verb, names)}")
    verbs = parser.add_subparsers(
        prog=parser.prog, metavar="VERB", required=True, help=argparse.SUPPRESS
    )
    if verb:
        chosen = all_verbs()[verb]
        add_verb(verbs.add_parser(verb, description=chosen.line), chosen)
    return parser.parse_args(words)


def _refuse_leading_option(parser: Parser, words: list[str], verb: str) -> None:
    """Refuse an option before the verb, unless it is the program's own."""
    own = ("-h", "--help", "--version")
    option = words[0].partition("=")[0]
    if not option.startswith("-") or option in own:
        return
    if near := did_you_mean(option, own):
        parser.error(f"unrecognized arguments: {option}{near}")
    place = verb if verb in all_verbs() else "VERB"
    parser.error(
        f"options stand behind the verb: `tactophone {place} {option}`, not before it"
    )


def add_verb(parser: argparse.ArgumentParser, verb: Verb) -> None:
    """Add a verb's arguments to its parser, and its examples to the help."""
    module = verb.load()
    parser.set_defaults(verb=verb.name)
    module.add_arguments(parser)
    if hasattr(module, "run"):
        parser.set_defaults(run=module.run)
    parser.epilog = "\n".join(
        ("examples:", *(f"  {example}" for example in verb.examples), "")
    )


def _listed(words: Sequence[str]) -> str:
    """Return the verbs as ``--help`` lists them: some explained, or ``all``."""
    verbs = all_verbs().values()
    lines: list[str] = []
    if "all" in words:
        for group in GROUPS:
            own = [verb for verb in verbs if verb.group == group]
            if own:
                lines += [f"{group}:", *map(_line, own), ""]
    else:
        explained = [verb for verb in verbs if verb.newcomer]
        lines += ["begin with:", *map(_line, explained), ""]
        lines += ["more, explained by `tactophone --help all`:"]
        for group in GROUPS:
            names = [
                verb.name
                for verb in verbs
                if verb.group == group and not (verb.newcomer or verb.special)
            ]
            if names:
                lines.append(f"  {group:14} {', '.join(names)}")
        lines.append("")
    lines.append("`tactophone VERB --help` shows a verb's options and examples.")
    return "\n".join(lines)


def _line(verb: Verb) -> str:
    return f"  {verb.name:14} {verb.line}"
