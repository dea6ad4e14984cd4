"""What `tactophone feel` says of a recording: on the terminal, or as JSON."""

import math
import shlex
from collections import Counter
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from rich.markup import escape

from tactophone.cli._support import terminal
from tactophone.dataset import Segment
from tactophone.offline import RunSummary
from tactophone.perception import SILENT_DBFS, RecordingFloor
from tactophone.pipeline import Pipeline


@dataclass(frozen=True, slots=True)
class Result:
    """A recording that was processed, with the files written.

    ``notes`` state what was corrected or is missing; ``events`` counts touch events by kind; ``floor`` is ``None``
    where a threshold was given.
    """

    path: Path
    pipeline: Pipeline
    profile: str
    chosen_for_mono: bool
    label: str
    truth: tuple[Segment, ...]
    summary: RunSummary
    files: dict[str, Path]
    floor: RecordingFloor | None
    notes: list[str]
    events: Counter[str] = field(default_factory=Counter)


def as_json(result: Result) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    return {
        "recording": str(result.path),
        "model": result.pipeline.detector.name,
        "profile": result.profile,
        "label": result.label or None,
        **asdict(result.summary),
        "threshold_dbfs": result.pipeline.detector.threshold.dbfs,
        "noise_floor_dbfs": result.floor.floor_dbfs if result.floor and result.floor.known else None,
        "notes": result.notes,
        "events": dict(result.events),
        "speed": result.summary.speed,
        "files": {kind: str(path) for kind, path in result.files.items()},
    }


def print_result(result: Result) -> None:
    """Print the summary; where there was no contact, the likely cause and the next command."""
    summary, show = result.summary, partial(terminal.out().print, soft_wrap=True)
    label = f"; labelled {result.label}" if result.label else ""
    show(f"[bold]{escape(str(result.path))}[/]: {summary.duration:.1f} s{label}")
    show(f"  model      {escape(result.pipeline.detector.name)}{', for one channel' if result.chosen_for_mono else ''}")
    if result.chosen_for_mono:
        show("             (taken as the contact microphone; of a rod with its microphone on it, state --tip stylus)")
    show(f"  contact    {_percent(summary.contact)} of the time, of which rough {_percent(summary.rough)}")
    show(f"  threshold  {_threshold(result)}")
    for note in result.notes:
        show(f"  [yellow]note[/]       {note}")
    if result.events:
        show("  events     " + ", ".join(f"{count} x {kind}" for kind, count in sorted(result.events.items())))
    if summary.faults:
        show("  silenced   " + ", ".join(f"{count} x {cause}" for cause, count in summary.faults.items()))
    for kind, path in result.files.items():
        show(f"  {kind:10} {escape(str(path))}")
    show(f"  took       {summary.elapsed:.2f} s, {summary.speed:.0f} times faster than the sound")
    if not summary.contact:
        cause, command = _no_contact(result)
        show("[bold red]NO CONTACT was found: nothing vibrates.[/]")
        show(f"  cause      {cause}")
        show(f"  try        {escape(command)}")


def _threshold(result: Result) -> str:
    floor, threshold = result.floor, f"{result.pipeline.detector.threshold.dbfs:.1f} dBFS"
    if floor is None:
        return f"{threshold}, as given"
    if floor.known:
        return f"{threshold}; the recording's noise floor is {floor.floor_dbfs:.1f} dBFS"
    if floor.loudest_dbfs < SILENT_DBFS:
        return "none: the recording is digital silence"
    return "none: the recording holds no steady silence, so all of it is taken as touch; --threshold DBFS if it is not"


def _no_contact(result: Result) -> tuple[str, str]:
    """Return the likely cause of a recording without contact, and the next command."""
    floor, loudest = result.floor, result.summary.loudest_dbfs
    again = f"tactophone feel {shlex.quote(str(result.path))} --threshold"
    if "sound" in result.summary.faults:
        return "the samples are no sound: see the note", "write the file again: 16 or 24 bits, or floats from -1 to 1"
    if result.summary.faults:
        return "the model's output is invalid", f"tactophone model show {shlex.quote(result.pipeline.detector.name)}"
    if loudest < SILENT_DBFS:
        return "the recording is digital silence: no microphone was connected", "tactophone calibrate"
    if floor is None:
        return f"loudest window: {loudest:.1f} dBFS, under the threshold that was given", f"{again} {loudest - 10:.0f}"
    if floor.known:
        found = f"nothing is louder than its steady noise of {floor.floor_dbfs:.1f} dBFS; if all of it is touch:"
        return found, f"{again} {floor.floor_dbfs - 6:.0f}"
    return f"loudest window: {loudest:.1f} dBFS; the microphone or its gain is off", "tactophone calibrate"


def _percent(share: float) -> str:
    return "none" if math.isnan(share) else f"{100 * share:.0f} %"
