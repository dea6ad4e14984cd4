"""``tactophone send``: the robot's side."""

import argparse
from functools import partial

from tactophone.cli._support import dashboard_options, flags, live_run, terminal
from tactophone.errors import ConfigError

FLAGS = {
    "--peer": "link.peer",
    "--port": "link.port",
    "--source": "capture.source",
    "--device": "capture.device",
    "--tip": "capture.tip",
    "--contact": "capture.contact",
    "--air": "capture.air",
    "--codec": "link.codec",
    "--packet-duration": "link.packet_duration",
    "--send-predictions": "link.send_predictions",
    "--model": "detector.model",
    "--calibration": "detector.calibration",
    "--identity": "link.identity",
    "--name": "process.name",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    live_run.add_arguments(parser, FLAGS)


def run(args: argparse.Namespace) -> int:
    """Send until interrupted, or until the sound ends."""
    from tactophone.cli._support.page_source import source_of
    from tactophone.runtime import Supervisor, run_robot, supervised

    settings = flags.settings_of(args)
    if args.log and not settings.link.send_predictions:
        raise ConfigError(
            "send --log needs predictions on this side: add --send-predictions, or log with receive --log"
        )
    name = settings.process.name or "send"
    source = source_of(settings, page=dashboard_options.wanted(args))
    main = partial(run_robot, open_source=source.open)
    robot = Supervisor(main, settings, name=name, report=terminal.note)
    return live_run.follow(args, supervised(robot), name, microphone=source.microphone)
