"""``--to``: the commands of a recording or a run as haptic files."""

import argparse
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the option."""
    parser.add_argument(
        "--to", action="append", default=[], choices=(".haptic", ".ahap", ".hjif"), metavar="FORMAT",
        help="write the commands as a haptic file too: .haptic (Meta), .ahap (Apple) or .hjif (MPEG); may be repeated",
    )  # fmt: skip


def write(args: argparse.Namespace, stem: Path, timeline: Path, *, duration: float) -> dict[str, Path]:
    """Write the commands of a timeline, of a length in s, in each format asked for; returns the files by format."""
    if not args.to:
        return {}
    from tactophone.bridges.haptic_files import write_haptic_file
    from tactophone.telemetry import read_timeline
    from tactophone.types import HapticCommand

    columns = read_timeline(timeline)
    commands = [
        HapticCommand(float(amplitude), float(frequency), float(time))
        for amplitude, frequency, time in zip(columns["amplitude"], columns["frequency"], columns["time"], strict=True)
    ]
    return {
        ending: write_haptic_file(stem.with_name(f"{stem.name}{ending}"), commands, duration=duration)
        for ending in args.to
    }
