"""One program, plain verbs, one file each: the only room that prints.

A verb's module has ``add_arguments(parser)`` and ``run(args) -> int``. It is imported only when its verb is
called, so that a verb's heavy libraries cost the others nothing.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

import tactophone
from tactophone.cli._support import terminal
from tactophone.errors import TactophoneError

VERBS: dict[str, str] = {
    "demo": "feel a smooth and a rough stone with no hardware: picture, sound, numbers",
    "pair": "make this machine's key, and tell it which other machine to trust",
    "play": "the stone box, in a browser: find the rough ones of five stones by touch alone",
    "loopback": "run robot and operator as two processes on this machine: a first try",
    "send": "the robot's side: hear the finger, and send it sealed to the operator",
    "receive": "the operator's side: receive, judge and feel",
    "feel": "feel recordings: write the vibration, its timeline and a picture beside each other",
    "model": "show what a model file says of itself",
    "latency": "measure with clicks how long from microphone to vibration, stage by stage",
    "stop": "emergency stop: nothing on this machine vibrates until somebody arms",
    "mute": "mute: nothing vibrates until somebody arms",
    "arm": "let vibration be felt again, after a stop, a mute or a restart",
    "devices": "list sound devices, which look right for two microphones and for an actuator, and why not",
    "settings": "print every setting with its default, range and meaning, as a TOML file to begin with",
    "calibrate": "find the noise floor and the contact threshold, name what is wrong with the microphones",
    "record": "record an object as the paper did: seven guided takes, judged at once, nothing ever lost",
    "simulate": "make sound with the simulated finger: the paper's data set, competition runs, the catalogue",
    "train": "train a detector on labelled recordings, as the paper or its authors did; goes on after a kill",
    "finetune": "make a model better on new objects, recorded once, without losing elsewhere; measured before and after",
    "set-threshold": "choose thresholds and hysteresis for a rate of false bumps, and write them into the model file",
    "evaluate": "score a model, or cross-validate a recipe, with intervals over surfaces and baselines",
    "sweep": "cross-validate a recipe under every combination of settings, on cores or a Ray cluster",
    "benchmark": "compare every method on the same splits: a table, a JSON file, a page with figures",
    "dataset": "show what a data set holds, and check it for broken, silent, clipped or wrongly told files",
}
"""Each verb with its line in ``tactophone --help``; ``a-b`` lives in ``a_b.py``."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; return its exit code: 0, 1 (one line on stderr), 2 (usage) or 130 (interrupted)."""
    args = _parse(list(sys.argv[1:] if argv is None else argv))
    try:
        return int(args.run(args))
    except TactophoneError as error:
        terminal.complain(str(error))
        return 1
    except KeyboardInterrupt:
        terminal.complain("interrupted")
        return 130
    except BrokenPipeError:
        # Whoever read our output has left (`tactophone ... | head`); that is their right. What is still buffered
        # would raise again at exit, so stdout is pointed at nothing.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _parse(argv: list[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="tactophone", description=tactophone.__doc__, formatter_class=terminal.HelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"tactophone {tactophone.__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    wanted = next((word for word in argv if not word.startswith("-")), None)
    for name, line in VERBS.items():
        verb = verbs.add_parser(name, help=line, description=line, formatter_class=terminal.HelpFormatter)
        if name == wanted:
            module = importlib.import_module(f"tactophone.cli.{name.replace('-', '_')}")
            module.add_arguments(verb)
            verb.set_defaults(run=module.run)
    return parser.parse_args(argv)
