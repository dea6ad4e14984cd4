"""``tactophone demo``: the whole telephone with no hardware, in one command."""

import argparse
import math
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli import console, live, options, output, page

if TYPE_CHECKING:
    from tactophone.app.vibration_wav import RunScores
    from tactophone.live.runtime.supervisor import Supervisor
    from tactophone.live.telemetry.watcher import Snapshot
    from tactophone_lab.app.demo import Demonstration

EXAMPLES = (
    "tactophone demo",
    "tactophone demo --network internet --tip stylus --dashboard",
    "tactophone demo --fingers 5 --out hand --record hand/run.mcap",
)

USUAL = ["simulation.network=wifi-busy"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        default=Path("demo"),
        metavar="DIR",
        help="folder for picture and sound",
    )
    add(
        "--recording",
        type=Path,
        metavar="FILE",
        help="WAV or FLAC to send in place of the simulated finger's sound",
    )
    options.add_json(parser, "print the scores as JSON")
    add(
        "--verbose",
        action="store_true",
        help="print the counts of packets, the latency by stage and every file too",
    )
    options.add_settings(parser, "demo", USUAL)
    options.add_fingers(parser)
    live.add_record(parser, bridge=False)
    page.add_dashboard(parser)


def run(args: argparse.Namespace) -> int:
    from tactophone_lab.app.demo import demonstrate, free_name

    output.make_folder(args.out)
    settings = options.settings_of(args, USUAL)

    def follow(
        sides: "Sequence[Supervisor]", name: str, duration: float
    ) -> "Snapshot | None":
        watched = page.shown(settings, name, page=page.wanted(args, settings))
        with watched, live.recorded(args, settings, name):
            outcome = console.follow(sides, keys, duration=duration)
        if outcome.signal:
            raise KeyboardInterrupt
        return outcome.last

    with (
        output.as_private_as(*filter(None, [args.recording])),
        nullcontext(settings.process.name)
        if settings.process.name
        else free_name() as name,
        console.keys_obeyed(name) as keys,
    ):
        shown = demonstrate(
            settings,
            args.out,
            recording=args.recording,
            name=name,
            follow=follow,
            report=output.note,
            warn=output.warn,
        )
    values: dict[str, Any] = {
        name: {**of.files, **asdict(of.scores)} for name, of in shown.fingers.items()
    }
    if "" in values:
        values = {
            **values[""],
            "counters": shown.last.counters,
            "gauges": shown.last.gauges,
        }
    output.show(values, _parts(shown, verbose=args.verbose), as_json=args.json)
    return 0


def _parts(shown: "Demonstration", *, verbose: bool) -> Iterator[output.Part]:
    last = shown.last
    if verbose:
        yield "packets, and median latency by stage:"
        yield from live.counts_and_budget(last.counters, last.gauges)
        yield ""
    if lost := last.counters["xruns"] * last.gauges["device_period"]:
        yield (
            f"{lost:.1f} s of vibration are missing: this machine stood still for "
            "too long"
        )
    for name, finger in shown.fingers.items():
        yield from _words(name, finger.scores)
    files = {
        f"{name} {kind}".strip(): path
        for name, own in shown.fingers.items()
        for kind, path in own.files.items()
    }
    # The picture last: it is what to look at next.
    for kind, path in reversed(files.items()):
        if verbose or kind.endswith("picture"):
            yield f"{kind + ':':12} {path}"


def _words(name: str, scores: "RunScores") -> Iterator[str]:
    of = f"{name}, " * bool(name)
    if math.isfinite(scores.smooth_right):
        bumps = f"{scores.false_bumps} false bump{'s' * (scores.false_bumps != 1)}"
        yield (
            f"{of}on the smooth stone: {output.percent(scores.smooth_right)} of "
            f"predictions are smooth, {bumps}"
        )
    if math.isfinite(scores.rough_right):
        dips = f"{scores.dips} dip{'s' * (scores.dips != 1)}"
        yield (
            f"{of}on the rough stone:  {output.percent(scores.rough_right)} of "
            f"predictions are rough, {dips}"
        )
