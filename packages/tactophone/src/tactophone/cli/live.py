"""``tactophone send``, ``receive`` and ``loopback``, and what live verbs share: their
options, and how a run ends.

Each log and each bridge is a process of its own that reads telemetry, so that none of
them delays the sound.
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.app import runs, sources
from tactophone.cli import console, options, output, page
from tactophone.cli.console import Outcome
from tactophone.core.settings import Settings
from tactophone.live.telemetry.layout import COUNTERS, STAGES

if TYPE_CHECKING:  # its import takes 0.3 s, which would slow down --help
    from tactophone.live.runtime.supervisor import Supervisor

EXAMPLES = {
    "send": (
        "tactophone send --peer operator.local",
        "tactophone send --peer operator.local --source finger --tip stylus",
        "tactophone send --peer 192.0.2.7:48470 --codec pcm16 --record run.mcap",
    ),
    "receive": (
        "tactophone receive --calibration calibration.toml --dashboard",
        (
            "tactophone receive --actuator portaudio:DualSense "
            "--profile dualsense --ceiling 0.3"
        ),
        (
            "tactophone receive --settings operator.toml "
            "--record run.csv --bridge foxglove"
        ),
    ),
    "loopback": (
        "tactophone loopback --source finger --actuator none --dashboard",
        (
            "tactophone loopback --source file:stroke.wav "
            "--actuator file:vibration.wav --network wifi"
        ),
        "tactophone loopback --source finger --actuator none --duration 1",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the settings of a live verb, and all that a live run can show, record and
    pass on."""
    options.add_settings(parser, parser.get_default("verb"))
    options.add_fingers(parser)
    page.add_dashboard(parser)
    add_record(parser)
    add_end(parser)


def add_end(parser: argparse.ArgumentParser) -> None:
    """Add when a run ends, and what it then prints."""
    parser.add_argument(
        "--duration",
        type=options.Within(float, 0, unit="s"),
        default=0.0,
        metavar="S",
        help="how long to run, %(type)s; 0: until interrupted",
    )
    options.add_json(parser, "at the end, print all counters as JSON")


def add_record(parser: argparse.ArgumentParser, *, bridge: bool = True) -> None:
    parser.add_argument(
        "--record",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help=(
            "RUN.mcap: packets, sound, predictions, commands and settings, for "
            "`tactophone replay`; or RUN.csv: each prediction and command, as "
            "`tactophone feel` writes them; repeatable; complete up to 1 s if a "
            "process dies"
        ),
    )
    if not bridge:
        parser.set_defaults(bridge=())
        return
    words = "; ".join(f"{name}: {what}" for name, what in runs.BRIDGES.items())
    parser.add_argument(
        "--bridge",
        action="append",
        default=[],
        metavar="NAME[=FOXGLOVE_ADDRESS]",
        help=(
            f"show the run elsewhere, repeatable. {words}. Details: [bridges] in "
            "`tactophone settings`"
        ),
    )


def run(args: argparse.Namespace) -> int:
    from tactophone.live.runtime.supervisor import supervised

    settings = options.settings_of(args)
    open_source = None
    microphone = None
    name = settings.process.name or args.verb
    if args.verb == "loopback":
        settings = sources.for_one_microphone(settings)
    if args.verb != "receive":
        open_source, microphone = sources.source_of(
            settings, page=page.wanted(args, settings)
        )
    sides: AbstractContextManager[Sequence[Supervisor]]
    if args.verb == "loopback":
        sides = runs.both_sides(
            settings, name=name, open_source=open_source, report=output.note
        )
    else:
        sides = supervised(
            runs.open_side(settings, name, open_source, report=output.note)
        )
    return follow(args, settings, sides, name, microphone=microphone)


def follow(
    args: argparse.Namespace,
    settings: Settings,
    sides: "AbstractContextManager[Sequence[Supervisor]]",
    name: str,
    *,
    microphone: Connection | None = None,
) -> int:
    """Start the sides, show and record the run of that name until it ends; return the
    verb's exit code.

    ``microphone`` takes the sound of a page's microphone.
    """
    # The page comes first: it says what starts, while models and devices are opened.
    with (
        page.shown(
            settings, name, page=page.wanted(args, settings), microphone=microphone
        ),
        console.keys_obeyed(name) as keys,
        sides as running,
        recorded(args, settings, name),
    ):
        outcome = console.follow(running, keys, duration=args.duration)
    return print_outcome(args, outcome)


@contextmanager
def recorded(args: argparse.Namespace, settings: Settings, name: str) -> Iterator[None]:
    """Record the run of that name meanwhile, and pass it on, as the options say."""
    with runs.observed(
        settings,
        name,
        record=args.record,
        bridges=args.bridge,
        sends=args.verb == "send",
        report=output.note,
        warn=output.warn,
    ):
        yield


def print_outcome(args: argparse.Namespace, outcome: Outcome) -> int:
    last = outcome.last
    if last is None:
        return 1
    summary = {
        "counters": last.counters,
        "gauges": last.gauges,
        "state": last.state,
        "restarts": outcome.restarts,
    }
    output.show(
        summary, counts_and_budget(last.counters, last.gauges), as_json=args.json
    )
    return outcome.exit_code


def counts_and_budget(
    counters: dict[str, Any], gauges: dict[str, float]
) -> Iterator[output.Part]:
    """Yield what was counted, and the median latency by stage where it is known."""
    counted = (
        (str(counters[name]), words)
        for name, words in COUNTERS.items()
        if counters[name]
    )
    yield output.listing(counted, justify="right", style="")
    if math.isfinite(gauges["latency_total"]):
        stages = (*STAGES, "total")
        yield [
            {stage: f"{1000 * gauges[f'latency_{stage}']:.2f} ms" for stage in stages}
        ]
        yield (
            "total: from the middle of a packet's sound to its vibration (`latency` "
            "measures a touch's first one)"
        )
