"""``tactophone report``: one file about a problem, to read and then to send."""

import argparse
from pathlib import Path

from tactophone.cli import options, output
from tactophone.core.errors import ConfigError
from tactophone.core.processes import atomic_write, is_same_file, make_private

EXAMPLES = (
    "tactophone report",
    "tactophone report --recording finger.wav --log run.mcap --out problem.md",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--recording",
        type=Path,
        metavar="FILE",
        help="a recording that is decided wrongly: adds its length and the notes on "
        "it, "
        "not its sound",
    )
    add(
        "--log",
        type=Path,
        metavar="FILE",
        help="an MCAP file that --record wrote: adds what it holds, not its sound",
    )
    add(
        "--out",
        type=Path,
        default=Path("tactophone-report.md"),
        metavar="FILE",
        help="file to write (default: %(default)s)",
    )
    options.add_recorded_channels(parser)
    options.add_settings(parser, "report")


def run(args: argparse.Namespace) -> int:
    from tactophone.app.report import report_lines

    settings = options.settings_of(args)
    for name in ("log", "recording"):
        read = getattr(args, name)
        if read and is_same_file(args.out, read):
            raise ConfigError(f"--out {args.out}: the {name} itself; name another file")
    lines = report_lines(
        settings, log=args.log, recording=args.recording, channels=args.channels
    )
    with atomic_write(args.out) as unfinished:
        make_private(unfinished)
        unfinished.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(args.out)
    output.note("read it before you send it: it holds no key and no sound")
    return 0
