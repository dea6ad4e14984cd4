"""``tactophone record``: record the paper's seven takes with guidance, a check of each,
and no loss by a kill."""

import argparse
import datetime
import os
from pathlib import Path

from rich.console import Group
from rich.live import Live
from rich.text import Text

from tactophone.app.sources import UNATTENDED
from tactophone.cli import console, options, output
from tactophone.cli.guide import Meters
from tactophone.cli.options import Within
from tactophone.core.types import SURFACE_LABELS, AudioBlock, Touch
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.health import Reference
from tactophone_lab.app.record import record_object
from tactophone_lab.recording import protocol
from tactophone_lab.recording.protocol import Key, Stage
from tactophone_lab.recording.quality import GOOD
from tactophone_lab.recording.take_recorder import RecordedObject, Recorder, SessionPlan
from tactophone_lab.simulation.takes import TAKES, takes_named

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
    "tactophone record 'polished marble' --label smooth --source finger --seconds 2 "
    "--takes short_light,long_light",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "object",
        metavar="OBJECT",
        help="the object's name; with --source finger, a name from the catalogue",
    )
    add(
        "--label",
        required=True,
        choices=[label.name.lower() for label in SURFACE_LABELS],
        help="how it feels to you",
    )
    add(
        "--surface",
        default="",
        metavar="NAME",
        help="its surface, if others share it (default: the object's name)",
    )
    add("--material", default="", metavar="NAME", help="its material")
    words = f"how it is held: {', '.join(RECORD_SCENARIOS)}, or any other"
    add("--scenario", default="table", metavar="NAME", help=words)
    add(
        "--session",
        default="",
        metavar="NAME",
        help="recording session (default: today's date)",
    )
    add(
        "--out",
        type=Path,
        default=Path("recordings"),
        metavar="DIR",
        help="data set to add the takes to",
    )
    add(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="calibration file of this set-up",
    )
    add(
        "--seconds",
        type=Within(float, 1, 600, unit="s"),
        default=protocol.TAKE_DURATION,
        metavar="S",
        help="length of a take, %(type)s",
    )
    add(
        "--takes",
        default="all",
        metavar="LIST",
        help=f"comma-separated takes, of {', '.join(take.name for take in TAKES)}; or "
        "'all'",
    )
    add(
        "--yes",
        action="store_true",
        help="start and keep each take without a key press",
    )
    options.add_json(parser, "at the end, print the takes as JSON")
    options.add_settings(parser, "record")
    options.add_finger(parser)


def run(args: argparse.Namespace) -> int:
    os.umask(0o077)  # no other user of this machine hears what is recorded
    plan = _plan(args)
    target = RecordedObject(
        args.object,
        Touch[args.label.upper()],
        surface=args.surface,
        material=args.material,
        scenario=args.scenario,
        session=args.session or datetime.date.today().isoformat(),
    )
    settings = options.settings_of(args)
    with console.single_keys() as has_keyboard, output.live_display() as live:
        attended = (
            has_keyboard and not args.yes and settings.capture.source not in UNATTENDED
        )
        screen = _Screen(plan, live, attended=attended)
        key = (lambda: RECORD_KEYS.get(console.read_key(0))) if attended else None
        takes = record_object(
            settings,
            target,
            plan,
            key=key,
            follow=screen.push,
            report=output.log().print,
        )
    known = [
        (each.take, float(each.properties["level_dbfs"]), each.properties["quality"])
        for each in takes
    ]
    rows = [
        {"take": take, "level": f"{level:.0f} dBFS", "quality": quality}
        for take, level, quality in known
    ]
    folder = str(args.out)
    words = (
        f"{len(takes)} takes in {folder}: check them with `tactophone dataset "
        f"check {folder}`"
    )
    values = [
        {"file": each.path, "take": each.take, **each.properties} for each in takes
    ]
    output.show(
        {"object": args.object, "takes": values}, [rows, words], as_json=args.json
    )
    return 0


def _plan(args: argparse.Namespace) -> SessionPlan:
    reference = (
        Calibration.read(args.calibration).reference
        if args.calibration
        else Reference()
    )
    selected = takes_named(args.takes)
    takes = tuple(take for take in TAKES if take in selected)
    return SessionPlan(args.out, reference, takes, duration=args.seconds)


class _Screen:
    """Shows the recorder and the microphones' levels in the terminal, and prints each
    take's quality."""

    def __init__(self, plan: SessionPlan, live: Live | None, *, attended: bool) -> None:
        self._plan = plan
        self._live = live
        self._attended = attended
        self._meters: Meters | None = None
        self._stage: Stage | None = None

    def push(self, recorder: Recorder, block: AudioBlock) -> None:
        self._meters = self._meters or Meters(
            block.channels, self._plan.reference.threshold_dbfs
        )
        self._meters.push(block)
        before = self._stage
        self._stage = recorder.protocol.stage
        if self._stage is Stage.REVIEW and before is not Stage.REVIEW:
            output.log().print(_quality(recorder), soft_wrap=True)
        if (
            self._live is not None
            and self._stage is not Stage.DONE
            and self._meters.due()
        ):
            screen = _screen(
                recorder, self._meters, self._plan, unattended=not self._attended
            )
            self._live.update(screen, refresh=True)


def _quality(recorder: Recorder) -> Text:
    text = Text(f"{recorder.protocol.take.name:13}", style="bold")
    text.append(recorder.quality, "green" if recorder.quality == GOOD else "yellow")
    if recorder.levels:
        text.append(
            f"  ({recorder.levels.contact:.0%} contact, "
            f"{recorder.levels.level_dbfs:.0f} dBFS)",
            "dim",
        )
    return text


def _screen(
    recorder: Recorder, meters: Meters, plan: SessionPlan, *, unattended: bool
) -> Group:
    session = recorder.protocol
    take = session.take
    stage = session.stage
    total = {
        Stage.COUNTDOWN: plan.countdown,
        Stage.RECORDING: plan.duration,
        Stage.PAUSED: plan.duration,
    }.get(stage)
    head = Text(
        f" take {session.number} of {len(session.takes)}: ", style="dim"
    ).append(take.name, "bold")
    rows = [
        head,
        Text(f" {take.instruction}"),
        _bar(stage, session.remaining, total),
        *meters.rows(),
    ]
    if not unattended:
        rows.append(Text(f" {_hint(stage)}", style="dim"))
    return Group(*rows)


def _bar(stage: Stage, remaining: float, total: float | None) -> Text:
    text = Text(f" {stage:10}", style=STAGE_STYLES.get(stage, "cyan"))
    if total:
        done = round(44 * (1 - remaining / total))
        text.append("━" * done).append("─" * (44 - done), "dim").append(
            f" {remaining:4.1f} s left"
        )
    return text


def _hint(stage: Stage) -> str:
    keep = {
        Stage.REVIEW: "space: keep, next take",
        Stage.READY: "space: start",
        Stage.PAUSED: "space: continue",
    }
    hint = keep.get(stage, "space: pause" if stage is Stage.RECORDING else "")
    again = "" if stage in (Stage.READY, Stage.COUNTDOWN) else "r: retake"
    return "   ".join(filter(None, (hint, again, "q: quit and keep all takes")))
