"""``tactophone receive``: the operator's side."""

import argparse

from tactophone.cli._support import flags, live_run, terminal

FLAGS = {
    "--port": "link.port",
    "--actuator": "output.actuator",
    "--device": "output.device",
    "--actuator-port": "output.port",
    "--actuator-channel": "output.channel",
    "--tip": "capture.tip",
    "--model": "detector.model",
    "--calibration": "detector.calibration",
    "--contact-threshold": "detector.threshold_dbfs",
    "--profile": "rendering.profile",
    "--ceiling": "rendering.ceiling",
    "--muted": "rendering.muted",
    "--identity": "link.identity",
    "--name": "process.name",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    live_run.add_arguments(parser, FLAGS)


def run(args: argparse.Namespace) -> int:
    """Receive until interrupted."""
    from tactophone.runtime import Supervisor, run_operator, supervised

    settings = flags.settings_of(args)
    name = settings.process.name or "receive"
    operator = Supervisor(run_operator, settings, name=name, report=terminal.note)
    return live_run.follow(args, supervised(operator), name)
