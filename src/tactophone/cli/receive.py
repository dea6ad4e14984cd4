"""``tactophone receive``: the operator's side."""

import argparse

from tactophone.cli._support import console as face
from tactophone.cli._support import dashboard_options as page
from tactophone.cli._support import flags
from tactophone.cli._support import run_summary as outcome
from tactophone.runtime import Supervisor, run_operator

FLAGS = {
    "--port": "link.port",
    "--actuator": "output.actuator",
    "--device": "output.device",
    "--actuator-port": "output.port",
    "--model": "judge.model",
    "--calibration": "judge.calibration",
    "--threshold": "judge.threshold_dbfs",
    "--profile": "feel.profile",
    "--ceiling": "feel.ceiling",
    "--muted": "feel.muted",
    "--identity": "link.identity",
    "--name": "process.name",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    flags.add_settings(parser, FLAGS)
    page.add_arguments(parser)
    outcome.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Receive until interrupted."""
    settings = flags.settings_of(args)
    name = settings.process.name or "receive"
    with Supervisor(run_operator, settings, name=name) as operator, page.shown(args, name):
        ended = face.follow([operator], name, duration=args.duration)
    return outcome.print_outcome(args, ended)
