"""The command line: one program, one verb per file, and the only room that prints.

A verb's module has ``add_arguments(parser)`` and ``run(args) -> int``; one with several actions sets the default
``run`` of each action's parser instead. It is imported only when its verb is called, and imports heavy libraries
inside ``run``, so that ``--help`` answers in under 0.4 s.
"""

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

import tactophone
from tactophone.cli._support import extras, terminal
from tactophone.errors import TactophoneError

VERBS: dict[str, str] = {
    "demo": "stroke a smooth and a rough stone with no hardware: picture, sound, numbers",
    "pair": "create this machine's key, and choose which other machine to trust",
    "play": "the stone box in a browser: find the rough ones of five hidden stones by touch alone",
    "try": "slide a phone, or a hand beside a laptop, over something real, and feel it on a page",
    "loopback": "run robot and operator as two processes on this machine: a first try",
    "send": "the robot's side: capture the finger's sound and send it encrypted to the operator",
    "receive": "the operator's side: receive sound, detect roughness and drive the actuator",
    "feel": "process recordings: write the vibration, its timeline and a picture",
    "replay": "compute a recorded run again, to the bit; or as another model or profile would have rendered it",
    "model": "show a model file's card, or import the paper authors' models",
    "latency": "measure the latency from microphone to vibration with impulses, stage by stage",
    "stop": "emergency stop: all vibration on this machine ends until an operator arms it again",
    "mute": "mute the vibration until an operator arms it again",
    "arm": "allow vibration again after a stop, a mute or a restart",
    "devices": "list sound devices, which suit two microphones or an actuator, and why others do not",
    "settings": "print every setting with its default, range and meaning, as a TOML file to edit",
    "setup": "fit a detector to a new finger in two minutes: silence, two smooth and two rough objects of your own",
    "calibrate": "measure the noise floor and the contact threshold, report microphone faults",
    "record": "record an object by the paper's protocol: seven guided takes, each checked and saved at once",
    "simulate": "render sound with the simulated finger: the paper's data set, competition runs, the catalogue",
    "train": "train a detector on labelled recordings; resumes after an interruption",
    "finetune": "improve a model on new objects without losing accuracy on the old; measured before and after",
    "set-threshold": "choose thresholds and hysteresis for a rate of false bumps, and write them into the model file",
    "evaluate": "score a model, or cross-validate a recipe, with intervals over surfaces and baselines",
    "sweep": "cross-validate a recipe under every combination of settings, on cores or a Ray cluster",
    "benchmark": "compare every method on the same splits: a table, a JSON file, a page with figures",
    "roughness": "measure Ra, Rq, Rz, RSm, Sa and more of a height profile or height map",
    "dataset": "show what a data set holds, and check it for broken, silent, clipped or wrongly labelled files",
}
"""Each verb with its line in ``tactophone --help``; ``a-b`` lives in ``a_b.py``."""

_SHARED_MODULES = {**dict.fromkeys(("stop", "mute", "arm"), "stop_mute_arm"), "try": "try_it"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one verb; return its exit code: 0, 1 (one line on stderr), 2 (usage) or 130 (interrupted)."""
    words = list(sys.argv[1:] if argv is None else argv)
    verb = next((word for word in words if not word.startswith("-")), "")
    try:
        args = _parse(words, verb)
        extras.require(verb)
        code = int(args.run(args))
        if sys.stdout is not None:  # it is closed with `>&-`
            sys.stdout.flush()  # here, so that a full disk is reported
        return code
    except TactophoneError as error:
        terminal.print_error(str(error))
        return 1
    except ModuleNotFoundError as error:
        terminal.print_error(extras.explain(error))
        return 1
    except KeyboardInterrupt:
        terminal.print_error("interrupted")
        return 130
    except BrokenPipeError:
        # The reader of our output has closed it (`tactophone ... | head`), which is no error.
        _discard_output()
        return 0
    except OSError as error:
        _discard_output()
        terminal.print_error(f"{error.filename or 'cannot read or write'}: {error.strerror or error}")
        return 1


def _discard_output() -> None:
    """Redirect stdout to nothing: what is still buffered would raise the same error again at exit."""
    if sys.stdout is not None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parse(words: list[str], verb: str) -> argparse.Namespace:
    parser = terminal.Parser(prog="tactophone", description=(tactophone.__doc__ or "").partition("\n\n")[0])
    parser.add_argument("--version", action="version", version=f"tactophone {tactophone.__version__}")
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)
    for name, line in VERBS.items():
        subparser = verbs.add_parser(name, help=line, description=line)
        if name == verb:
            module = importlib.import_module(f"tactophone.cli.{_SHARED_MODULES.get(name, name.replace('-', '_'))}")
            module.add_arguments(subparser)
            subparser.set_defaults(run=getattr(module, "run", None), verb=name)
    return parser.parse_args(words)
