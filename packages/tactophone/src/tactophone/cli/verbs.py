"""The verbs of the command line: one file each, and those that other packages add.

A verb's module has ``EXAMPLES``, ``add_arguments(parser)`` and ``run(args) -> int``. A
verb with several actions sets the default ``run`` of each action's parser instead. The
module is imported only when its verb is called, and imports heavy libraries inside
``run``, so that ``--help`` answers in under 0.4 s.
"""

import functools
import importlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType

from tactophone.core import plugins


@dataclass(frozen=True, slots=True)
class Verb:
    """A verb of the command line."""

    name: str
    module: str
    """Name of the module that holds its arguments and runs it."""
    group: str
    """One of `GROUPS`."""
    line: str
    """What it does, for ``tactophone --help``."""
    extras: tuple[str, ...] = ()
    """What it always needs, so that one message names all of it, rather than one extra
    per attempt."""
    newcomer: bool = False
    """Whether ``tactophone --help`` explains it."""
    special: bool = False
    """Whether only ``tactophone --help all`` names it."""

    def load(self) -> ModuleType:
        """Import the verb's module."""
        return importlib.import_module(self.module)

    @property
    def examples(self) -> Sequence[str]:
        """The command lines that its help shows."""
        found: Sequence[str] | Mapping[str, Sequence[str]] = self.load().EXAMPLES
        return found[self.name] if isinstance(found, Mapping) else found


GROUPS = ("start", "run", "finger", "sound", "model", "lab")
"""Headings of ``tactophone --help all``, in order."""

OWN = (
    Verb(
        "try",
        "tactophone.cli.try_page",
        "start",
        "slide a phone, or a hand beside a laptop, over something real, and feel it "
        "on a page",
        ("dashboard", "link"),
        newcomer=True,
    ),
    Verb(
        "listen",
        "tactophone.cli.listen",
        "start",
        "open a page that hears your desk by this browser's microphone, with the "
        "detector in the page",
        ("dashboard",),
    ),
    Verb(
        "loopback",
        "tactophone.cli.live",
        "start",
        "run robot and operator as two processes on this machine",
        ("link",),
    ),
    Verb(
        "settings",
        "tactophone.cli.devices",
        "start",
        "print every setting with its default, range and meaning, as a TOML file to "
        "edit",
    ),
    Verb(
        "pair",
        "tactophone.cli.pair",
        "run",
        "create this machine's key, and choose which other machine to trust",
        ("link",),
    ),
    Verb(
        "send",
        "tactophone.cli.live",
        "run",
        "the robot's side: capture the finger's sound and send it encrypted to the "
        "operator",
        ("link",),
    ),
    Verb(
        "receive",
        "tactophone.cli.live",
        "run",
        "the operator's side: receive sound, detect roughness and drive the actuator",
        ("link",),
    ),
    Verb(
        "call",
        "tactophone.cli.call",
        "run",
        "ring the other end, in any network: read a code out, then run as receive or "
        "send",
        ("call", "link"),
        newcomer=True,
    ),
    Verb(
        "answer",
        "tactophone.cli.call",
        "run",
        "answer a call with its code, or with a name that both ends remember",
        ("call", "link"),
    ),
    Verb("status", "tactophone.cli.status", "run", "list the runs of this machine"),
    Verb(
        "stop",
        "tactophone.cli.status",
        "run",
        "emergency stop: all vibration on this machine ends until an operator arms it "
        "again",
    ),
    Verb(
        "mute",
        "tactophone.cli.status",
        "run",
        "mute the vibration until an operator arms it again",
    ),
    Verb(
        "arm",
        "tactophone.cli.status",
        "run",
        "allow vibration again after a stop, a mute or a restart",
    ),
    Verb(
        "devices",
        "tactophone.cli.devices",
        "finger",
        "list sound devices, which suit two microphones or an actuator, and why "
        "others do not",
    ),
    Verb(
        "check",
        "tactophone.cli.check",
        "finger",
        "check the microphones, and measure their noise and the contact threshold",
    ),
    Verb(
        "report",
        "tactophone.cli.report",
        "finger",
        "write one file about a problem: versions, devices, settings, notes; to read "
        "and then to send",
    ),
    Verb(
        "feel",
        "tactophone.cli.feel",
        "sound",
        "process recordings: write the vibration, its timeline and a picture",
        newcomer=True,
    ),
    Verb(
        "replay",
        "tactophone.cli.replay",
        "sound",
        "replay a recorded run exactly, or with another model or profile",
        ("link", "record"),
    ),
    Verb(
        "model",
        "tactophone.cli.model",
        "model",
        "show a model file's card: input, decision rule, training data, scores",
    ),
)
"""The verbs of this package, in the order of the help."""

LABORATORY = (
    "bench",
    "benchmark",
    "dataset",
    "demo",
    "evaluate",
    "fetch",
    "finetune",
    "import-model",
    "latency",
    "play",
    "record",
    "roughness",
    "set-threshold",
    "setup",
    "simulate",
    "train",
)
"""Verbs that the package ``tactophone-lab`` adds; without it, each says so."""


@functools.cache
def all_verbs() -> Mapping[str, Verb]:
    """Return every verb by its name: this package's, then those that others add."""
    added = [
        verb
        for name in plugins.registered(plugins.VERBS)
        for verb in plugins.load(plugins.VERBS, name)
    ]
    return {verb.name: verb for verb in (*added, *OWN)}
