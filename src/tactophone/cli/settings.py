"""``tactophone settings``: every setting with its default, range and meaning, as a TOML file to edit."""

import argparse
import math
from itertools import groupby
from typing import Any

from tactophone.settings import SETTINGS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare no arguments; the epilog shows how the file is used."""
    parser.epilog = "tactophone settings > robot.toml; tactophone send --config robot.toml"


def run(_: argparse.Namespace) -> int:
    """Print the file."""
    for section, entries in groupby(SETTINGS.values(), key=lambda entry: entry.name.partition(".")[0]):
        print(f"[{section}]")
        for entry in entries:
            print(f"# {entry.help}")
            print(f"{entry.name.partition('.')[2]} = {_toml(entry.default)}\n")
    return 0


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, float) and math.isnan(value):
        return "nan"
    return str(value)
