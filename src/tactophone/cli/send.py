"""``tactophone send``: the robot's side."""

import argparse
from functools import partial

from tactophone.cli._support import console as face
from tactophone.cli._support import dashboard_options as page
from tactophone.cli._support import flags, sources
from tactophone.cli._support import run_summary as outcome
from tactophone.runtime import Supervisor, run_robot

FLAGS = {
    "--peer": "link.peer",
    "--port": "link.port",
    "--source": "capture.source",
    "--device": "capture.device",
    "--contact": "capture.contact",
    "--air": "capture.air",
    "--codec": "link.codec",
    "--packet": "link.packet_duration",
    "--judge": "link.judge",
    "--model": "judge.model",
    "--calibration": "judge.calibration",
    "--identity": "link.identity",
    "--name": "process.name",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    flags.add_settings(parser, FLAGS)
    page.add_arguments(parser)
    outcome.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Send until interrupted, or until the sound ends."""
    settings = flags.settings_of(args)
    name = settings.process.name or "send"
    main = partial(run_robot, open_source=sources.open_source)
    with Supervisor(main, settings, name=name) as robot, page.shown(args, name):
        ended = face.follow([robot], name, duration=args.duration)
    return outcome.print_outcome(args, ended)
