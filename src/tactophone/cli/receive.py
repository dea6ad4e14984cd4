"""``tactophone receive``: the operator's side."""

import argparse

from tactophone.cli._support import console, dashboard_options, flags, log_option, record_option, run_summary, terminal

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
    flags.add_settings(parser, FLAGS)
    flags.add_fingers(parser)
    dashboard_options.add_arguments(parser)
    log_option.add_arguments(parser)
    record_option.add_arguments(parser)
    run_summary.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Receive until interrupted."""
    from tactophone.runtime import Supervisor, run_operator

    settings = flags.settings_of(args)
    name = settings.process.name or "receive"
    with (
        Supervisor(run_operator, settings, name=name, report=terminal.note) as operator,
        record_option.recorded(args, name),
        log_option.logged(args.log, name),
        dashboard_options.shown(args, name),
    ):
        outcome = console.follow([operator], name, duration=args.duration)
    return run_summary.print_outcome(args, outcome)
