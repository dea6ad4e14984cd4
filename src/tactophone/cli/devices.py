"""``tactophone devices``: the sound devices of this machine, which suit, why others do not, and `measure`."""

import argparse
from dataclasses import asdict

from rich.table import Table

from tactophone.cli._support import flags, measure_actuator, terminal
from tactophone.devices import SurveyedDevice, survey
from tactophone.settings import change


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "step",
        nargs="?",
        choices=("measure",),
        help="measure: play a sweep on the actuator, record it with the contact microphone, write actuator.toml",
    )
    parser.add_argument(
        "--jack-server", default="", metavar="NAME", help="JACK server to list; default: the default server"
    )
    parser.add_argument("--json", action="store_true", help="print a list that a program can read")
    measure_actuator.add_arguments(parser)
    flags.add_settings(parser, measure_actuator.FLAGS)
    flags.add_finger(parser)


def run(args: argparse.Namespace) -> int:
    """Print the list, or measure the actuator."""
    if args.step == "measure":
        server = [f"process.jack_server={args.jack_server}"] if args.jack_server else []
        return measure_actuator.measure(args, change(flags.settings_of(args), server))
    found = survey(jack_server=args.jack_server)
    if args.json:
        terminal.print_json([asdict(device) for device in found])
        return 0
    for device in found:
        terminal.out().print(_card(device))
    if all(device.microphones and device.actuator for device in found):
        terminal.log().print(
            "No device here is suitable. `tactophone loopback --source finger --actuator none` needs no device."
        )
    return 0


def _card(device: SurveyedDevice) -> Table:
    table = Table.grid(padding=(0, 2))
    table.add_column(justify="right", style="dim", min_width=12)
    table.add_column(overflow="fold")
    rate = f", {device.inputs} in, {device.outputs} out, {device.sample_rate} Hz" if device.sample_rate else ""
    name = f": {device.name}" if device.name else ""
    table.add_row("device", f"[bold]{device.system}[/]{name}{rate}")
    if device.microphones == device.actuator and device.microphones:
        table.add_row("not suitable", device.microphones)
    else:
        table.add_row("microphones", device.microphones or "[green]yes[/]")
        table.add_row("actuator", device.actuator or "[green]yes[/]")
    if device.note:
        table.add_row("note", device.note)
    if device.settings:
        table.add_row("use with", " ".join(f"--set {setting}" for setting in device.settings))
    table.add_row("", "")
    return table
