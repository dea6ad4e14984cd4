"""``tactophone record``: record the paper's seven takes with guidance, a check of each, and no loss by a kill."""

import argparse
import datetime
import os
from pathlib import Path

from rich.console import Group
from rich.text import Text

from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.cli import console, options, output
from tactophone.cli.guide import Meters
from tactophone.cli.options import Within
from tactophone.cli.simulate import takes_named
from tactophone.core.types import SURFACE_LABELS, Touch
from tactophone.lab.dataset.metadata import manifests_in
from tactophone.lab.dataset.read import open_dataset
from tactophone.lab.recording import protocol
from tactophone.lab.recording.protocol import Key, Stage
from tactophone.lab.recording.quality import GOOD
from tactophone.lab.recording.recorder import RecordedObject, Recorder, SessionPlan
from tactophone.lab.recording.safe_writer import recording_in, recover
from tactophone.lab.simulation.takes import TAKES
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.health import Reference

RECORD_SCENARIOS = ("held", "table", "box")
RECORD_KEYS = {
    " ": Key.GO,
    "\n": Key.GO,
    "\r": Key.GO,
    "r": Key.RETAKE,
    "q": Key.QUIT,
    "\x03": Key.QUIT,
    "\x04": Key.QUIT,
}
STAGE_STYLES = {
    Stage.RECORDING: "bold red",
    Stage.PAUSED: "yellow",
    Stage.REVIEW: "cyan",
    Stage.COUNTDOWN: "bold yellow",
}

EXAMPLES = (
    "tactophone record slate --label rough --calibration calibration.toml",
    "tactophone record 'polished marble' --label smooth --source finger --seconds 2 --takes short_light,long_light",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("object", metavar="OBJECT", help="the object's name; with --source finger, a name from the catalogue")
    add("--label", required=True, choices=[label.name.lower() for label in SURFACE_LABELS], help="how it feels to you")
    add("--surface", default="", metavar="NAME", help="its surface, if others share it (default: the object's name)")
    add("--material", default="", metavar="NAME", help="its material")
    words = f"how it is held: {', '.join(RECORD_SCENARIOS)}, or any other"
    add("--scenario", default="table", metavar="NAME", help=words)
    add("--session", default="", metavar="NAME", help="recording session (default: today's date)")
    add("--out", type=Path, default=Path("recordings"), metavar="DIR", help="data set to add the takes to")
    add("--calibration", type=Path, metavar="FILE", help="calibration file of this set-up")
    add("--seconds", type=Within(float, 1, 600, unit="s"), default=protocol.TAKE_DURATION, metavar="S",
        help="length of a take, %(type)s")  # fmt: skip
    add("--takes", default="all", metavar="LIST",
        help=f"comma-separated takes, of {', '.join(take.name for take in TAKES)}; or 'all'")  # fmt: skip
    add("--yes", action="store_true", help="start and keep each take without a key press")
    options.add_json(parser, "at the end, print the takes as JSON")
    options.add_settings(parser, "record")
    options.add_finger(parser)


def run(args: argparse.Namespace) -> int:
    os.umask(0o077)  # no other user of this machine hears what is recorded
    plan = _plan(args)
    target = RecordedObject(
        args.object, Touch[args.label.upper()], surface=args.surface, material=args.material, scenario=args.scenario,
        session=args.session or datetime.date.today().isoformat(),
    )  # fmt: skip
    with recording_in(plan.root):
        recorder = _session(args, plan, target)
    takes = recorder.recordings
    known = [(each.take, float(each.properties["level_dbfs"]), each.properties["quality"]) for each in takes]
    rows = [{"take": take, "level": f"{level:.0f} dBFS", "quality": quality} for take, level, quality in known]
    folder = str(args.out)
    words = f"{len(takes)} takes in {folder}: check them with `tactophone dataset check {folder}`"
    values = [{"file": each.path, "take": each.take, **each.properties} for each in takes]
    output.show({"object": args.object, "takes": values}, [rows, words], as_json=args.json)
    return 0


def _session(args: argparse.Namespace, plan: SessionPlan, target: RecordedObject) -> Recorder:
    """Finish what was cut off before, then record."""
    for recovered in recover(plan.root):
        output.log().print(f"finished {recovered.path}, which was cut off: {recovered.known('quality')}")
    known = open_dataset(plan.root) if manifests_in(plan.root) else None
    with AudioInput(options.settings_of(args), args.object) as audio, console.single_keys() as has_keyboard:
        rate, channels = audio.source.sample_rate, audio.source.channels
        recorder = Recorder(target, plan, known, sample_rate=rate, channels=channels)
        _record(recorder, audio, plan, unattended=args.yes or audio.simulated or not has_keyboard)
    return recorder


def _plan(args: argparse.Namespace) -> SessionPlan:
    reference = Calibration.read(args.calibration).reference if args.calibration else Reference()
    selected = takes_named(args.takes)
    takes = tuple(take for take in TAKES if take in selected)
    return SessionPlan(args.out, reference, takes, duration=args.seconds)


def _record(recorder: Recorder, audio: AudioInput, plan: SessionPlan, *, unattended: bool) -> None:
    """Pass sound and keys to the recorder, and show its state, until it is done."""
    meters = Meters(audio.source.channels, plan.reference.threshold_dbfs)
    count = len(recorder.protocol.takes)
    output.log().print(f"{count} takes to record" if count else "all takes are recorded already")
    try:
        with output.live_display() as live:
            for block in audio:
                if unattended:
                    _press_go(recorder, audio, plan)
                elif key := RECORD_KEYS.get(console.read_key(0)):
                    recorder.press(key)
                before = recorder.protocol.stage
                recorder.push(block)
                meters.push(block)
                if recorder.protocol.stage is Stage.REVIEW and before is not Stage.REVIEW:
                    output.log().print(_quality(recorder), soft_wrap=True)
                if recorder.protocol.stage is Stage.DONE:
                    return
                if live is not None and meters.due():
                    live.update(_screen(recorder, meters, plan, unattended=unattended), refresh=True)
    finally:
        recorder.close()


def _press_go(recorder: Recorder, audio: AudioInput, plan: SessionPlan) -> None:
    """Start each take and keep it, as a person does who accepts every take."""
    if recorder.protocol.stage is Stage.REVIEW:
        recorder.press(Key.GO)
    if recorder.protocol.stage is Stage.READY:
        recorder.press(Key.GO)
        # The simulated person starts at once, so that the countdown is over when the stroke is under way.
        audio.ask(SimulatedAct("take", plan.duration + plan.countdown, take=recorder.protocol.take.name))


def _quality(recorder: Recorder) -> Text:
    text = Text(f"{recorder.protocol.take.name:13}", style="bold")
    text.append(recorder.quality, "green" if recorder.quality == GOOD else "yellow")
    if recorder.levels:
        text.append(f"  ({recorder.levels.contact:.0%} contact, {recorder.levels.level_dbfs:.0f} dBFS)", "dim")
    return text


def _screen(recorder: Recorder, meters: Meters, plan: SessionPlan, *, unattended: bool) -> Group:
    session = recorder.protocol
    take, stage = session.take, session.stage
    total = {Stage.COUNTDOWN: plan.countdown, Stage.RECORDING: plan.duration, Stage.PAUSED: plan.duration}.get(stage)
    head = Text(f" take {session.number} of {len(session.takes)}: ", style="dim").append(take.name, "bold")
    rows = [head, Text(f" {take.instruction}"), _bar(stage, session.remaining, total), *meters.rows()]
    if not unattended:
        rows.append(Text(f" {_hint(stage)}", style="dim"))
    return Group(*rows)


def _bar(stage: Stage, remaining: float, total: float | None) -> Text:
    text = Text(f" {stage:10}", style=STAGE_STYLES.get(stage, "cyan"))
    if total:
        done = round(44 * (1 - remaining / total))
        text.append("━" * done).append("─" * (44 - done), "dim").append(f" {remaining:4.1f} s left")
    return text


def _hint(stage: Stage) -> str:
    keep = {Stage.REVIEW: "space: keep, next take", Stage.READY: "space: start", Stage.PAUSED: "space: continue"}
    hint = keep.get(stage, "space: pause" if stage is Stage.RECORDING else "")
    again = "" if stage in (Stage.READY, Stage.COUNTDOWN) else "r: retake"
    return "   ".join(filter(None, (hint, again, "q: quit and keep all takes")))
