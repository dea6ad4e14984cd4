"""``tactophone try``: slide a phone, or a hand, over something real, and feel it on a page; no hardware is needed."""

import argparse

from tactophone.cli._support import console, dashboard_options, flags, log_option, run_summary
from tactophone.cli._support.page_source import for_one_microphone, source_of
from tactophone.cli.loopback import both_sides
from tactophone.settings import change

FLAGS = {
    "--device": "capture.device",
    "--model": "detector.model",
    "--contact-threshold": "detector.threshold_dbfs",
    "--profile": "rendering.profile",
    "--ceiling": "rendering.ceiling",
    "--actuator": "output.actuator",
    "--name": "process.name",
}

SOURCES = {
    "browser": "the microphone of a page, on this machine or on a phone",
    "microphone": "this machine's own, by PortAudio",
    "finger": "the simulated finger",
}

USUAL = ["link.codec=pcm16", "link.packet_duration=0.0025", "output.actuator=none"]
"""Both sides run on this machine, so nothing is gained by a codec; nothing drives an actuator unless it is named."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    words = "; ".join(f"{name}: {what}" for name, what in SOURCES.items())
    parser.add_argument("--source", choices=tuple(SOURCES), default="browser", help=f"what listens: {words}")
    dashboard_options.add_address(parser.add_argument_group("page"))
    flags.add_settings(parser, FLAGS, USUAL)
    log_option.add_arguments(parser)
    run_summary.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Serve the page and run both sides until interrupted."""
    from tactophone.pages import watch

    settings = for_one_microphone(flags.settings_of(args, [*USUAL, f"capture.source={args.source}"]))
    if settings.output.actuator == "none":  # a stalled process then harms nobody
        settings = change(settings, ["process.watchdog=false"])
    name = settings.process.name or "try"
    source = source_of(settings)
    with watch(name, microphone=source.microphone, **dashboard_options.place(args)) as page:
        dashboard_options.announce(page, "try")
        with (
            both_sides(settings, "clean", name=name, seed=0, open_source=source.open) as sides,
            log_option.logged(args.log, name),
        ):
            outcome = console.follow(sides, name, duration=args.duration)
    return run_summary.print_outcome(args, outcome)
