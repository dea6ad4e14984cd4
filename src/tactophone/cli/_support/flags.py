"""Settings on the command line: ``--config``, ``--set``, and short flags for those that are set most often."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from tactophone.hand import finger_named, with_fingers
from tactophone.settings import SETTINGS, Settings, change, read_settings

REPEATED = ("link.peer",)
"""Settings whose flag may be given more than once; the values are joined by commas."""


def add_settings(parser: argparse.ArgumentParser, flags: Mapping[str, str], usual: Sequence[str] = ()) -> None:
    """Declare ``--config``, ``--set`` and flags such as ``{"--peer": "link.peer"}``, with help, range and default.

    ``usual`` are the verb's own defaults, as in `settings_of`.
    """
    own = dict(setting.split("=", 1) for setting in usual)
    group = parser.add_argument_group("settings (all of them: `tactophone settings`)")
    group.add_argument(
        "--config",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="TOML file of settings; flags override it, and so does a later file",
    )
    for option, name in flags.items():
        entry = SETTINGS[name]
        words = entry.help.replace("%", "%%")
        if isinstance(entry.default, bool):
            group.add_argument(option, dest=name, action="store_const", const="true", help=words)
            continue
        value = own.get(name, entry.default)
        default = "" if value == "" else f" (default: {value})"
        action = "append" if name in REPEATED else "store"
        group.add_argument(option, dest=name, action=action, metavar="VALUE", help=f"{words}{default}")
    group.add_argument(
        "--set", action="append", default=[], metavar="NAME=VALUE", help="any other setting, such as link.port=48471"
    )


def add_fingers(parser: argparse.ArgumentParser) -> None:
    """Declare ``--fingers``."""
    parser.add_argument(
        "--fingers",
        metavar="N|FILE",
        help="a hand: its number of fingers, 1 to 10, or a TOML file with a table for each "
        "(docs/guide/hand.md); both ends need as many (default: one finger, and no file)",
    )


def add_finger(parser: argparse.ArgumentParser) -> None:
    """Declare ``--fingers`` and ``--finger``, for verbs that work with one finger of a hand."""
    add_fingers(parser)
    parser.add_argument(
        "--finger", dest="of_hand", metavar="NAME", help="the finger of --fingers to use, such as index"
    )


def settings_of(args: argparse.Namespace, usual: Sequence[str] = ()) -> Settings:
    """Return the settings in force: defaults < ``--config`` < flags < ``--set``; ``--fingers`` adds to each finger.

    ``usual`` are defaults of the verb, such as ``"output.actuator=none"``; they come before the flags.
    """
    settings = Settings()
    for path in args.config:
        settings = read_settings(path, settings)
    settings = change(settings, list(usual))
    for name, value in vars(args).items():
        if name == "capture.source" and value is not None and value.startswith("ros:"):
            # `ros:/topic` is short for the source `ros` and the device `/topic`.
            settings = change(settings, ["capture.source=ros", f"capture.device={value[4:]}"])
        elif "." in name and value is not None:
            text = ",".join(value) if name in REPEATED else value
            settings = change(settings, [f"{name}={text}"])
    settings = change(settings, args.set)
    fingers, chosen = getattr(args, "fingers", None), getattr(args, "of_hand", None)
    settings = with_fingers(settings, fingers) if fingers else settings
    return finger_named(settings, chosen or "") if chosen or (fingers and hasattr(args, "of_hand")) else settings
