"""The command line: one program, one verb or family of verbs per file, and the only
room that prints.

A verb's module has ``EXAMPLES``, ``add_arguments(parser)`` and ``run(args) -> int``;
one with several actions sets the default ``run`` of each action's parser instead. It is
imported only when its verb is called, and imports heavy libraries inside ``run``, so
that ``--help`` answers in under 0.4 s.
"""

import argparse
import errno
import importlib
import os
import sys
from collections.abc import Sequence

import tactophone
from tactophone.cli import output
from tactophone.cli.options import Parser
from tactophone.core import extras
from tactophone.core.errors import TactophoneError, did_you_mean
from tactophone.core.version import __version__

_ABOUT = (tactophone.__doc__ or "").partition("\n\n")[0]

GROUPS: dict[str, dict[str, str]] = {
    "start": {
        "demo": "stroke a smooth and a rough stone with no hardware: picture, sound, numbers",
        "play": "the stone box in a browser: find the rough ones of five hidden stones by touch alone",
        "try": "slide a phone, or a hand beside a laptop, over something real, and feel it on a page",
        "loopback": "run robot and operator as two processes on this machine",
        "settings": "print every setting with its default, range and meaning, as a TOML file to edit",
    },
    "run": {
        "pair": "create this machine's key, and choose which other machine to trust",
        "send": "the robot's side: capture the finger's sound and send it encrypted to the operator",
        "receive": "the operator's side: receive sound, detect roughness and drive the actuator",
        "call": "ring the other end, in any network: read a code out, then run as receive or send",
        "answer": "answer a call with its code, or with a name that both ends remember",
        "status": "list the runs of this machine",
        "stop": "emergency stop: all vibration on this machine ends until an operator arms it again",
        "mute": "mute the vibration until an operator arms it again",
        "arm": "allow vibration again after a stop, a mute or a restart",
        "latency": "measure the latency from microphone to vibration with impulses, stage by stage",
    },
    "finger": {
        "devices": "list sound devices, which suit two microphones or an actuator, and why others do not",
        "setup": "fit a detector to a new finger in two minutes, or --check its microphones and contact threshold",
        "record": "record an object by the paper's protocol: seven guided takes, each checked and saved at once",
    },
    "sound": {
        "feel": "process recordings: write the vibration, its timeline and a picture",
        "replay": "replay a recorded run exactly, or with another model or profile",
        "export": "write a recorded run beside a robot's own data: LeRobot",
        "dataset": "show what a data set holds, and check it for broken, silent, clipped or wrongly labelled files",
        "simulate": "render sound with the simulated finger: the paper's data set, competition runs, the catalogue",
        "roughness": "measure Ra, Rq, Rz, RSm, Sa and more of a height profile or height map",
    },
    "model": {
        "model": "show a model file's card, or import the paper authors' models",
        "train": "train a detector on labelled recordings; resumes after an interruption",
        "finetune": "adapt a model to new objects, and show what it costs on the old ones",
        "set-threshold": "choose thresholds and hysteresis for a rate of false bumps, and write them into the model",
    },
    "lab": {
        "evaluate": "score a model; or cross-validate a recipe, with baselines, or with --vary under many settings",
        "benchmark": "compare every method on the same splits: a table, a JSON file, a page with figures",
    },
}
"""Each verb with its line in ``tactophone --help``, in groups; ``a-b`` lives in
``a_b.py``."""

VERBS: dict[str, str] = {
    verb: line for group in GROUPS.values() for verb, line in group.items()
}

EXTRAS_OF_VERB = {
    "demo": ("link", "plot", "sim"),
    "pair": ("link",),
    "play": ("dashboard", "link", "sim"),
    "loopback": ("link",),
    "try": ("dashboard", "link"),
    "send": ("link",),
    "receive": ("link",),
    "call": ("call", "link"),
    "answer": ("call", "link"),
    "latency": ("jack", "link", "sim"),
    "replay": ("link", "record"),
    "export": ("lerobot", "link", "record"),
    "simulate": ("sim",),
    "train": ("train",),
    "setup": ("train",),
    "finetune": ("train",),
    "benchmark": ("link", "sim", "train"),
}
"""What a verb always needs, so that one message names all of it, rather than one extra
per attempt."""

NEWCOMER = ("demo", "play", "try", "feel", "setup", "call")
"""The verbs that a newcomer needs, which ``tactophone --help`` explains."""

SPECIAL = ("finetune", "roughness", "export")
"""Verbs that only ``tactophone --help all`` names."""

_SHARED_MODULES = {
    "answer": "call",
    **dict.fromkeys(("status", "stop", "mute", "arm"), "status"),
    **dict.fromkeys(("send", "receive", "loopback"), "live"),
    **dict.fromkeys(("model", "set-threshold"), "model"),
    **dict.fromkeys(("devices", "settings"), "devices"),
    "try": "play",
}


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
        extras.require_extras(*EXTRAS_OF_VERB.get(verb, ()))
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
        output.print_error(
            f"{where}: {error.strerror or error}{'; free some space, or write elsewhere' * full}"
        )
        return 1
    except RuntimeError as error:
        # By name: the library of sound files takes long to import, and tells nobody
        # that the disk is full.
        if type(error).__name__ != "LibsndfileError":
            raise
        output.print_error(
            f"{error} A sound file cannot be read or written: is the disk full? Free some space"
        )
        return 1


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
    if verb and verb not in VERBS:
        parser.error(f"there is no verb {verb}{did_you_mean(verb, VERBS)}")
    verbs = parser.add_subparsers(
        prog=parser.prog, metavar="VERB", required=True, help=argparse.SUPPRESS
    )
    if verb:
        add_verb(verbs.add_parser(verb, description=VERBS[verb]), verb)
    return parser.parse_args(words)


def add_verb(parser: argparse.ArgumentParser, verb: str) -> None:
    module = importlib.import_module(
        f"tactophone.cli.{_SHARED_MODULES.get(verb, verb.replace('-', '_'))}"
    )
    parser.set_defaults(verb=verb)
    module.add_arguments(parser)
    if hasattr(module, "run"):
        parser.set_defaults(run=module.run)
    parser.epilog = "\n".join(
        ("examples:", *(f"  {example}" for example in examples_of(verb)), "")
    )


def examples_of(verb: str) -> Sequence[str]:
    """Return the command lines that a verb's help shows."""
    module = importlib.import_module(
        f"tactophone.cli.{_SHARED_MODULES.get(verb, verb.replace('-', '_'))}"
    )
    examples: Sequence[str] = (
        module.EXAMPLES[verb] if isinstance(module.EXAMPLES, dict) else module.EXAMPLES
    )
    return examples


def _listed(words: Sequence[str]) -> str:
    if "all" in words:
        lines = [
            line
            for group, verbs in GROUPS.items()
            for line in (f"{group}:", *map(_line, verbs), "")
        ]
    else:
        listed = {
            group: [verb for verb in verbs if verb not in (*NEWCOMER, *SPECIAL)]
            for group, verbs in GROUPS.items()
        }
        more = [f"  {group:14} {', '.join(verbs)}" for group, verbs in listed.items()]
        lines = [
            "begin with:",
            *map(_line, NEWCOMER),
            "",
            "more, explained by `tactophone --help all`:",
            *more,
            "",
        ]
    return "\n".join(
        [*lines, "`tactophone VERB --help` shows a verb's options and examples."]
    )


def _line(verb: str) -> str:
    return f"  {verb:14} {VERBS[verb]}"
