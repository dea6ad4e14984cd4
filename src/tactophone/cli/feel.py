"""``tactophone feel``: recordings in; the vibration that a finger would feel, and how it came about, out."""

import argparse
import math
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.markup import escape

from tactophone.capture import FileSource
from tactophone.cli._support import dashboard_options as page
from tactophone.cli._support import terminal
from tactophone.dataset import Segment, truth_of
from tactophone.errors import ConfigError, TactophoneError
from tactophone.haptics import PASSTHROUGH, PROFILES, Limits
from tactophone.offline.plots import draw_recording
from tactophone.offline.process_recording import OfflineRenderer, Outputs, Summary, feel
from tactophone.perception import shipped_models
from tactophone.pipeline import Pipeline, open_pipeline


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add = parser.add_argument
    add(
        "recordings", nargs="+", type=Path, metavar="RECORDING",
        help="WAV or FLAC at 2 kHz or more; one channel, or two: contact microphone, air microphone",
    )  # fmt: skip
    add("--out", type=Path, default=Path(), metavar="DIR", help="folder for the results; it is made if need be")
    add(
        "--model", metavar="NAME|FILE",
        help=f"a model file, or one that ships ({', '.join(shipped_models()) or 'none'}); "
        "default: the shipped one for the recording's channels",
    )  # fmt: skip
    add(
        "--profile",
        default="paper",
        metavar="NAME",
        help=f"how belief becomes vibration: {', '.join(PROFILES)}; or the sound itself: {', '.join(PASSTHROUGH)}",
    )
    add(
        "--contact", choices=("fast", "window"), default="fast",
        help="tell contact within milliseconds, or by the model's whole window as in the paper",
    )  # fmt: skip
    add("--threshold", type=float, metavar="DBFS", help="level of contact, in dBFS, -120 to 0; default: the model's")
    add("--ceiling", type=float, default=1.0, metavar="LEVEL", help="greatest amplitude, 0 to 1 of full drive")
    add("--plot", action="store_true", help="draw a picture of what was heard, believed and felt")
    add("--json", action="store_true", help="print the summary as JSON, and write the timeline as JSON too")
    page.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Feel each recording; one that fails is named, and the others go on."""
    _check(args)
    try:
        args.out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--out {args.out}: cannot be made ({error.strerror}); name a folder of your own") from error
    results = []
    for path, stem in _stems(args.recordings):
        try:
            results.append(_feel(path, stem, args))
        except (TactophoneError, OSError) as error:
            told = str(error)
            terminal.complain(told if told.startswith(str(path)) else f"{path}: {told}")
            continue
        if not args.json:
            _print(results[-1])
    if args.json:
        terminal.print_json([result.as_json() for result in results])
    if args.dashboard:
        _replay([FileSource(result.path) for result in results], args)
    return 0 if len(results) == len(args.recordings) else 1


@dataclass(frozen=True, slots=True)
class _Result:
    path: Path
    model: str
    profile: str
    chosen_for_mono: bool
    label: str
    summary: Summary
    files: dict[str, Path]

    def as_json(self) -> dict[str, Any]:
        return {
            "recording": str(self.path),
            "model": self.model,
            "profile": self.profile,
            "label": self.label or None,
            **asdict(self.summary),
            "speed": self.summary.speed,
            "files": {kind: str(path) for kind, path in self.files.items()},
        }


def _check(args: argparse.Namespace) -> None:
    if not 0 <= args.ceiling <= 1:
        raise ConfigError(f"--ceiling {args.ceiling}, but it lies from 0 to 1 of full drive")
    if args.threshold is not None and not -120 <= args.threshold <= 0:
        raise ConfigError(f"--threshold {args.threshold}, but it lies from -120 to 0 dBFS")


def _stems(paths: Iterable[Path]) -> list[tuple[Path, str]]:
    """Name the results of each recording after it; a second ``a.wav`` from another folder becomes ``a-2``."""
    taken: set[str] = set()
    stems = []
    for path in paths:
        stem, number = path.stem, 2
        while stem in taken:
            stem, number = f"{path.stem}-{number}", number + 1
        taken.add(stem)
        stems.append((path, stem))
    return stems


def _feel(path: Path, stem: str, args: argparse.Namespace) -> _Result:
    source = FileSource(path)
    walk = _open_walk(source, args)
    outputs = Outputs.beside(args.out, stem, json=args.json)
    with terminal.progress("feeling") as bar:
        task = bar.add_task("", total=source.size, note=escape(path.name))
        sounding = PASSTHROUGH[args.profile](walk.limits) if args.profile in PASSTHROUGH else None
        summary, feeling = feel(
            source, walk, outputs, sounding=sounding, watch=lambda tick: bar.update(task, completed=tick.block.end)
        )
    files = {"vibration": outputs.waveform, "timeline": outputs.timeline}
    if outputs.timeline_json:
        files["timeline_json"] = outputs.timeline_json
    truth = truth_of(path, duration=source.duration)
    words = {one.word for one in truth}
    label = words.pop() if len(words) == 1 else "mixed" * bool(words)
    if args.plot:
        files["picture"] = args.out / f"{stem}.feel.png"
        _draw(files["picture"], feeling, outputs, title=_title(path, walk, label), truth=truth)
    mono = source.channels == 1 and not args.model
    return _Result(path, walk.judge.detector.name, args.profile, mono, label, summary, files)


def _replay(sources: list[FileSource], args: argparse.Namespace) -> None:
    from tactophone.cli._support import recording_playback as replay

    takes = [replay.Take(one, _open_walk(one, args), truth_of(one.path, duration=one.duration)) for one in sources]
    replay.on_page(args, takes, name="feel")


def _open_walk(source: FileSource, args: argparse.Namespace) -> Pipeline:
    walk = open_pipeline(
        args.model or "",
        sample_rate=source.sample_rate,
        channels=source.channels,
        profile="paper" if args.profile in PASSTHROUGH else args.profile,
        limits=Limits(ceiling=args.ceiling),
        fast_contact=args.contact == "fast",
    )
    if args.threshold is not None:
        walk.judge.threshold_dbfs = args.threshold
    return walk


def _title(path: Path, walk: Pipeline, label: str) -> str:
    known = f", labelled {label}" if label else ""
    return f"{path.name}{known}: judged by {walk.judge.detector.name}, felt as {walk.profile.name}"


def _draw(path: Path, feeling: OfflineRenderer, outputs: Outputs, *, title: str, truth: tuple[Segment, ...]) -> None:
    draw_recording(
        path,
        timeline=outputs.timeline,
        microphones=feeling.microphones,
        vibration=feeling.vibration,
        title=title,
        truth=truth,
    )


def _print(result: _Result) -> None:
    summary, show = result.summary, terminal.out().print
    label = f"; labelled {result.label}" if result.label else ""
    show(f"[bold]{escape(str(result.path))}[/]: {summary.duration:.1f} s{label}", soft_wrap=True)
    show(f"  judged by  {escape(result.model)}{', as it has one channel' if result.chosen_for_mono else ''}")
    if result.chosen_for_mono:
        show("             (if that is an air microphone, take --model impulses)")
    show(f"  contact    {_percent(summary.contact)} of the time, of which rough {_percent(summary.rough)}")
    if not summary.contact:
        show(f"             (loudest window: {summary.loudest_dbfs:.1f} dBFS; lower --threshold if that was touch)")
    if summary.faults:
        show("  silenced   " + ", ".join(f"{count} x {cause}" for cause, count in summary.faults.items()))
    for kind, path in result.files.items():
        show(f"  {kind:10} {escape(str(path))}", soft_wrap=True)
    show(f"  took       {summary.elapsed:.2f} s, {summary.speed:.0f} times faster than the sound")


def _percent(share: float) -> str:
    return "none" if math.isnan(share) else f"{100 * share:.0f} %"
