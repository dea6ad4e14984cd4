"""``tactophone record``: the seven takes of the paper, guided and judged at once, safe from kills and full disks."""

import argparse
import datetime
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tactophone.cli._support import audio_input as hearing
from tactophone.cli._support import keyboard as keys
from tactophone.cli._support import terminal
from tactophone.cli._support.audio_input import AudioInput, SimulatedAct
from tactophone.cli._support.meters import Meters
from tactophone.dataset import Recording, open_dataset
from tactophone.dataset.metadata import holds_metadata
from tactophone.errors import ConfigError
from tactophone.perception.sensor_health.calibration_file import Calibration
from tactophone.perception.sensor_health.faults import Reference
from tactophone.recording.protocol import COUNTDOWN, DURATION, PROTOCOL, Key, Stage
from tactophone.recording.recorder import Plan, Recorder, Subject
from tactophone.recording.safe_writer import recover
from tactophone.types import Touch

SCENARIOS = ("held", "table", "box")
KEYS = {" ": Key.GO, "\n": Key.GO, "\r": Key.GO, "r": Key.RETAKE, "q": Key.QUIT, "\x03": Key.QUIT, "\x04": Key.QUIT}
STYLES = {Stage.RECORDING: "bold red", Stage.PAUSED: "yellow", Stage.JUDGED: "cyan", Stage.COUNTDOWN: "bold yellow"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("object", metavar="OBJECT", help="its name; with --source finger, one of the catalogue's")
    parser.add_argument("--label", required=True, choices=("smooth", "rough"), help="your word for how it feels")
    parser.add_argument("--surface", default="", metavar="NAME", help="what it is a piece of; empty: the object itself")
    parser.add_argument("--material", default="", metavar="WORD", help="what it is made of")
    parser.add_argument(
        "--scenario", default="table", metavar="WORD", help=f"how it is held: {', '.join(SCENARIOS)}, or any word"
    )
    parser.add_argument("--session", default="", metavar="WORD", help="the sitting; empty: today's date")
    parser.add_argument("--out", type=Path, default=Path("recordings"), metavar="DIR", help="data set to add to")
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="what `tactophone calibrate` wrote")
    parser.add_argument("--seconds", type=float, default=DURATION, metavar="S", help="length of a take, 1 to 600 s")
    parser.add_argument(
        "--takes", default="all", metavar="LIST",
        help=f"takes divided by commas, of {', '.join(take.name for take in PROTOCOL)}; or 'all'",
    )  # fmt: skip
    parser.add_argument("--yes", action="store_true", help="wait for no key; begin each take, and keep it")
    parser.add_argument("--json", action="store_true", help="at the end, print the takes as JSON")
    hearing.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Record until all takes are made, or somebody quits."""
    plan, subject = _plan(args), _subject(args)
    for recovered in recover(plan.root) if plan.root.is_dir() else ():
        terminal.log().print(f"finished {recovered.path}, which was cut off: {recovered.known('verdict')}")
    known = open_dataset(plan.root) if plan.root.is_dir() and holds_metadata(plan.root) else None
    with AudioInput(args, args.object) as heard, keys.listening() as keyboard:
        rate, channels = heard.source.sample_rate, heard.source.channels
        recorder = Recorder(subject, plan, known, sample_rate=rate, channels=channels)
        _follow(recorder, heard, plan, alone=args.yes or heard.simulated or not keyboard)
    _tell(args, recorder.made)
    return 0


def _plan(args: argparse.Namespace) -> Plan:
    names = [take.name for take in PROTOCOL]
    wanted = names if args.takes == "all" else args.takes.split(",")
    if unknown := sorted(set(wanted) - set(names)):
        raise ConfigError(f"--takes: {', '.join(unknown)} is no take; there are {', '.join(names)}")
    if not 1 <= args.seconds <= 600:
        raise ConfigError(f"--seconds {args.seconds:g}: a take lasts 1 to 600 s")
    reference = Calibration.read(args.calibration).reference if args.calibration else Reference()
    takes = tuple(take for take in PROTOCOL if take.name in wanted)
    return Plan(args.out, reference, takes, duration=args.seconds)


def _subject(args: argparse.Namespace) -> Subject:
    return Subject(
        args.object,
        Touch[args.label.upper()],
        surface=args.surface,
        material=args.material,
        scenario=args.scenario,
        session=args.session or datetime.date.today().isoformat(),
    )


def _follow(recorder: Recorder, heard: AudioInput, plan: Plan, *, alone: bool) -> None:
    """Pass sound and keys to the recorder, and show how it stands, until it is done."""
    meters = Meters(heard.source.channels, plan.reference.threshold_dbfs)
    title = f"{len(recorder.protocol.takes)} takes to make" if recorder.protocol.takes else "all takes are made"
    terminal.log().print(title)
    try:
        with _live() as live:
            for block in heard:
                if alone:
                    _go_on(recorder, heard, plan)
                elif key := KEYS.get(keys.pressed(0)):
                    recorder.press(key)
                before = recorder.protocol.stage
                recorder.push(block)
                meters.push(block)
                if recorder.protocol.stage is Stage.JUDGED and before is not Stage.JUDGED:
                    terminal.log().print(_judged(recorder), soft_wrap=True)
                if recorder.protocol.stage is Stage.DONE:
                    return
                if live is not None and meters.due():
                    live.update(_screen(recorder, meters, plan, alone=alone), refresh=True)
    finally:
        recorder.close()


def _go_on(recorder: Recorder, heard: AudioInput, plan: Plan) -> None:
    """Press the key that a person would, who keeps every take."""
    if recorder.protocol.stage is Stage.JUDGED:
        recorder.press(Key.GO)
    if recorder.protocol.stage is Stage.READY:
        recorder.press(Key.GO)
        # The hand is where it should be when the countdown ends.
        heard.ask(SimulatedAct("take", plan.duration + COUNTDOWN, take=recorder.protocol.take.name))


def _live() -> AbstractContextManager[Live | None]:
    console = terminal.log()
    return Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else nullcontext()


def _judged(recorder: Recorder) -> Text:
    take = recorder.protocol.take
    good = recorder.verdict is not None and recorder.verdict.good
    text = Text(f"{take.name:13}", style="bold").append(str(recorder.verdict), "green" if good else "yellow")
    if recorder.heard:
        text.append(f"  ({recorder.heard.contact:.0%} contact, {recorder.heard.level_dbfs:.0f} dBFS)", "dim")
    return text


def _screen(recorder: Recorder, meters: Meters, plan: Plan, *, alone: bool) -> Group:
    protocol = recorder.protocol
    take, stage = protocol.take, protocol.stage
    total = {Stage.COUNTDOWN: plan.countdown, Stage.RECORDING: plan.duration, Stage.PAUSED: plan.duration}.get(stage)
    head = Text(f" take {protocol.number} of {len(protocol.takes)}: ", style="dim").append(take.name, "bold")
    rows = [head, Text(f" {take.instruction}"), _bar(stage, protocol.remaining, total), *meters.rows()]
    if not alone:
        rows.append(Text(f" {_hint(stage)}", style="dim"))
    return Group(*rows)


def _bar(stage: Stage, remaining: float, total: float | None) -> Text:
    text = Text(f" {stage:10}", style=STYLES.get(stage, "cyan"))
    if total:
        done = round(44 * (1 - remaining / total))
        text.append("━" * done).append("─" * (44 - done), "dim").append(f" {remaining:4.1f} s left")
    return text


def _hint(stage: Stage) -> str:
    keep = {Stage.JUDGED: "space: keep it, next take", Stage.READY: "space: begin", Stage.PAUSED: "space: go on"}
    hint = keep.get(stage, "space: pause" if stage is Stage.RECORDING else "")
    again = "" if stage in (Stage.READY, Stage.COUNTDOWN) else "r: retake"
    return "   ".join(filter(None, (hint, again, "q: quit, keeping what there is")))


def _tell(args: argparse.Namespace, made: Sequence[Recording]) -> None:
    if args.json:
        told = [{"file": str(one.path), "take": one.take, **one.properties} for one in made]
        terminal.print_json({"object": args.object, "takes": told})
        return
    table = Table("take", "level", "verdict", box=None)
    for one in made:
        table.add_row(one.take, f"{float(one.known('level_dbfs')):.0f} dBFS", one.known("verdict"))
    if made:
        terminal.out().print(table)
    last = f"{len(made)} takes in {args.out}: check them with `tactophone dataset check {args.out}`"
    terminal.out().print(last, soft_wrap=True)
