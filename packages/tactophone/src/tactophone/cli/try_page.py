"""``tactophone try``: feel something on a page, with no hardware but this machine or a
phone."""

import argparse

from tactophone.app import runs, sources
from tactophone.cli import console, live, options, output, page
from tactophone.core.settings import change

EXAMPLES = (
    "tactophone try",
    "tactophone try --lan",
    "tactophone try --source microphone --threshold -40 --record try.csv",
)

NEAR = ["link.codec=pcm16", "link.packet_duration=0.0025"]
"""Unless options say otherwise: both sides run on this machine, where a codec and long
packets only delay the sound."""

TRY_SOURCES = {
    "browser": "the microphone of a page, on this machine or on a phone",
    "microphone": "this machine's own, by PortAudio",
    "finger": "the simulated finger",
}
"""What `try` listens to."""

USUAL_OF_TRY = [*NEAR, "output.actuator=none"]
"""Nothing drives an actuator unless it is named."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    words = "; ".join(f"{name}: {what}" for name, what in TRY_SOURCES.items())
    add(
        "--source",
        choices=tuple(TRY_SOURCES),
        default="browser",
        help=f"what listens: {words}",
    )
    live.add_record(parser)
    live.add_end(parser)
    options.add_settings(parser, "try", USUAL_OF_TRY)


def run(args: argparse.Namespace) -> int:
    from tactophone.faces.web.server import watch

    usual = [*USUAL_OF_TRY, f"capture.source={args.source}"]
    if options.settings_of(args, usual).page.lan:
        # A phone's browser gives its microphone and its sound to encrypted pages alone.
        usual.append("page.https=true")
    settings = sources.for_one_microphone(options.settings_of(args, usual))
    if settings.output.actuator == "none":  # a stalled process then harms nobody
        settings = change(settings, ["process.watchdog=false"])
    name = settings.process.name or "try"
    open_source, microphone = sources.source_of(settings)
    with watch(name, microphone=microphone, **page.place(settings)) as served:
        page.announce(served, "try", browser=settings.page.open)
        both = runs.both_sides(
            settings, name=name, open_source=open_source, report=output.note
        )
        with (
            console.keys_obeyed(name) as keys,
            both as sides,
            live.recorded(args, settings, name),
        ):
            outcome = console.follow(sides, keys, duration=args.duration)
    return live.print_outcome(args, outcome)
