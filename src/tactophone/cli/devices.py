"""``tactophone devices``: which sound devices there are, which look right, and why not."""

import argparse
from dataclasses import asdict

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.devices import Found, survey


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "--jack-server", default="", metavar="NAME", help="JACK server to look at; default: the usual one"
    )
    parser.add_argument("--json", action="store_true", help="print a list that a program can read")


def run(args: argparse.Namespace) -> int:
    """Print the list."""
    found = survey(jack_server=args.jack_server)
    if args.json:
        terminal.print_json([asdict(device) for device in found])
        return 0
    for device in found:
        terminal.out().print(_card(device))
    fit = [device for device in found if not device.microphones or not device.actuator]
    if not fit:
        terminal.log().print(
            "Nothing here fits yet. `tactophone loopback --source finger --actuator none` needs no device."
        )
    return 0


def _card(device: Found) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(justify="right", style="dim", min_width=11)
    table.add_column(overflow="fold")
    rate = f", {device.inputs} in, {device.outputs} out, {device.sample_rate} Hz" if device.sample_rate else ""
    name = f": {device.name}" if device.name else ""
    table.add_row("device", f"[bold]{device.system}[/]{name}{rate}")
    if device.microphones == device.actuator and device.microphones:
        table.add_row("not fit", device.microphones)
    else:
        table.add_row("microphones", device.microphones or "[green]yes[/]")
        table.add_row("actuator", device.actuator or "[green]yes[/]")
    if device.note:
        table.add_row("note", device.note)
    if device.settings:
        table.add_row("use with", " ".join(f"--set {setting}" for setting in device.settings))
    table.add_row("", "")
    return table
