"""``tactophone feel``: recordings in; the vibration that a finger would feel, and a timeline of predictions, out."""

import argparse
import math
import shlex
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rich.markup import escape

from tactophone.app.plot import draw_recording
from tactophone.app.prepare import Preparation, PreparedSource
from tactophone.app.vibration_wav import OutputFiles, RunScores, RunSummary, process_recording, score_run
from tactophone.cli import options, output, page
from tactophone.core.errors import ConfigError, TactophoneError
from tactophone.core.settings import Settings
from tactophone.core.types import DEFAULT_TIP, PipelineStep, TouchEvent
from tactophone.lab.dataset.read import ground_truth
from tactophone.lab.dataset.values import Segment
from tactophone.live.audio.files import FileSource
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import PASSTHROUGH
from tactophone.signal.haptics.profiles import PROFILES
from tactophone.signal.perception.model_file import ModelCard, read_model
from tactophone.signal.perception.models import default_model, model_path, tip_mismatch
from tactophone.signal.perception.noise_floor import FLOOR_SILENT_DBFS, RecordingFloor, measure_floor
from tactophone.signal.pipeline import Pipeline, open_pipeline

EXAMPLES = (
    "tactophone feel stroke.wav --plot",
    "tactophone feel recordings/*.flac --out felt --profile lra --to .haptic",
    "tactophone feel run.mcap --finger index --dashboard",
)


@dataclass(frozen=True, slots=True)
class Result:
    """A recording that was processed, with the files written.

    ``notes`` state what was corrected or is missing; ``events`` counts touch events by kind; ``floor`` is ``None``
    where a threshold was given, and ``scores`` where no label says what was touched.
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
    scores: RunScores | None
    events: Counter[str] = field(default_factory=Counter)

    def as_json(self) -> dict[str, Any]:
        return {
            "recording": str(self.path), "model": self.pipeline.detector.name, "profile": self.profile,
            "label": self.label or None, **asdict(self.summary),
            "threshold_dbfs": self.pipeline.detector.threshold.dbfs,
            "noise_floor_dbfs": self.floor.floor_dbfs if self.floor and self.floor.known else None, "notes": self.notes,
            "false_bumps": self.scores and self.scores.false_bumps, "dips": self.scores and self.scores.dips,
            "events": dict(self.events), "speed": self.summary.speed,
            "files": {kind: str(path) for kind, path in self.files.items()},
        }  # fmt: skip

    def parts(self) -> Iterator[output.Part]:
        """Print the summary; where there was no contact, the likely cause and the next command."""
        summary = self.summary
        label = f"; labelled {self.label}" if self.label else ""
        yield f"[bold]{escape(str(self.path))}[/]: {summary.duration:.1f} s{label}"
        yield f"  model      {escape(self.pipeline.detector.name)}{', for one channel' if self.chosen_for_mono else ''}"
        if self.chosen_for_mono:
            yield "  (taken as the contact microphone; of a rod with its microphone on it, give --tip stylus)"
        shares = (summary.contact, summary.rough, summary.unknown)
        contact, rough, unknown = (output.percent(share, unknown="none") for share in shares)
        yield f"  contact    {contact} of the time, of which rough {rough}, unknown {unknown}"
        yield f"  threshold  {_threshold(self)}"
        if self.scores:
            yield f"  felt       false bumps: {self.scores.false_bumps}; dips: {self.scores.dips}"
        for note in self.notes:
            yield f"  [yellow]note[/]       {note}"
        if self.events:
            yield "  events     " + ", ".join(f"{count} x {kind}" for kind, count in sorted(self.events.items()))
        if summary.faults:
            yield "  silenced   " + ", ".join(f"{count} x {cause}" for cause, count in summary.faults.items())
        for kind, path in self.files.items():
            yield f"  {kind:10} {escape(str(path))}"
        yield f"  took       {summary.elapsed:.2f} s, {summary.speed:.0f} times faster than the sound"
        if not summary.contact:
            cause, command = _no_contact(self)
            yield "[bold red]NO CONTACT was found: nothing vibrates.[/]"
            yield f"  cause      {cause}"
            yield f"  try        {escape(command)}"


def _threshold(result: Result) -> str:
    floor, threshold = result.floor, f"{result.pipeline.detector.threshold.dbfs:.1f} dBFS"
    if floor is None:
        return f"{threshold}, as given"
    if floor.known:
        over = floor.floor_dbfs > floor.threshold_dbfs
        words = ", louder than any threshold: all of it is taken as touch" if over else ""
        return f"{threshold}; the recording's noise floor is {floor.floor_dbfs:.1f} dBFS{words}"
    if floor.loudest_dbfs < FLOOR_SILENT_DBFS:
        why = "too short to show its noise" if result.summary.contact else "digital silence"
        return f"none: the recording is {why}"
    return "none: the recording holds no steady silence, so all of it is taken as touch; --threshold DBFS if it is not"


def _no_contact(result: Result) -> tuple[str, str]:
    """Return the likely cause of a recording without contact, and the next command."""
    floor, loudest = result.floor, result.summary.loudest_dbfs
    again = f"tactophone feel {shlex.quote(str(result.path))} --threshold"
    if "sound" in result.summary.faults:
        return "the samples are no sound: see the note", "write the file again: 16 or 24 bits, or floats from -1 to 1"
    if result.summary.faults:
        return "the model's output is invalid", f"tactophone model show {shlex.quote(result.pipeline.detector.name)}"
    if loudest < FLOOR_SILENT_DBFS:
        return "the recording is digital silence: no microphone was connected", "tactophone setup --check"
    if floor is None:
        return f"loudest window: {loudest:.1f} dBFS, under the threshold that was given", f"{again} {loudest - 10:.0f}"
    if floor.known:
        found = f"nothing is louder than its steady noise of {floor.floor_dbfs:.1f} dBFS; if all of it is touch:"
        return found, f"{again} {floor.floor_dbfs - 6:.0f}"
    return f"loudest window: {loudest:.1f} dBFS; the microphone or its gain is off", "tactophone setup --check"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("recordings", nargs="+", type=Path, metavar="RECORDING",
        help="WAV or FLAC at 2 kHz or more; one channel, or two: contact microphone, air microphone; or the sound of a "
        "run, an MCAP file of --record")  # fmt: skip
    add("--finger", default="", metavar="NAME",
        help="of the log of a hand: only the finger of this name (default: each)")  # fmt: skip
    add("--out", type=Path, default=Path(), metavar="DIR", help="folder for the results; created if it does not exist")
    add("--profile", dest="rendering.profile", choices=(*PROFILES, *PASSTHROUGH), default="paper", metavar="NAME",
        help=f"rendering profile: {', '.join(PROFILES)}; or the sound itself: {', '.join(PASSTHROUGH)}")  # fmt: skip
    add("--contact", choices=("fast", "window"), default="fast",
        help="detect contact within milliseconds, or by the model's whole window as in the paper")  # fmt: skip
    options.add_figure(parser)
    add("--json", action="store_true", help="print the summary as JSON, and write the timeline as JSON too")
    for name in options.flags_of("feel"):
        options.add_flag(parser, name)
    page.add_dashboard(parser)


def run(args: argparse.Namespace) -> int:
    """Process each recording; a failure is reported, and the others continue."""
    output.make_folder(args.out)
    results = []
    settings = options.settings_of(args)
    recordings, failed = _with_sound_of_logs(args)
    for path, stem in _unique_stems(recordings):
        try:
            results.append(_process(path, stem, args, settings))
        except (TactophoneError, OSError) as error:
            message = str(error)
            output.print_error(message if message.startswith(str(path)) else f"{path}: {message}")
            continue
        if not args.json:
            output.show(results[-1], results[-1].parts(), as_json=False)
    if args.json:
        output.show(results, as_json=True)
    if page.wanted(args, settings) and results:
        from tactophone.cli import playback

        takes = [playback.Take(each.path.name, [each.path], [each.pipeline], each.truth) for each in results]
        playback.play_on_page(settings, takes, name="feel")
    return 0 if len(results) == len(recordings) and not failed else 1


def _with_sound_of_logs(args: argparse.Namespace) -> tuple[list[Path], bool]:
    """Put the sound of each session in place of a log, written to ``--out``; true if one holds none."""
    from tactophone.live.log.mcap import is_mcap

    if args.finger and not any(map(is_mcap, args.recordings)):
        raise ConfigError("--finger chooses one of the fingers of a log, an MCAP file of --record: leave it out")
    recordings, failed = list[Path](), False
    for path in args.recordings:
        if not is_mcap(path):
            recordings.append(path)
            continue
        from tactophone.app.replay import write_sound  # for logs alone: it needs the extras link and record

        try:
            recordings += [sound.path for sound in write_sound(path, args.out, finger=args.finger)]
        except TactophoneError as error:
            output.print_error(str(error))
            failed = True
    return recordings, failed


def _unique_stems(paths: Iterable[Path]) -> list[tuple[Path, str]]:
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


def _process(path: Path, stem: str, args: argparse.Namespace, settings: Settings) -> Result:
    source, tip, profile = FileSource(path), settings.capture.tip, settings.rendering.profile
    model = settings.detector.model or default_model(tip)
    card = read_model(model_path(model)).card
    preparation, floor = _prepare(path, card, settings)
    sound = PreparedSource(source, preparation)
    pipeline = _open_pipeline(sound, model, floor, settings, fast_contact=args.contact == "fast")
    if warning := tip_mismatch(card, tip):
        output.note(f"{path}: {warning}")
    outputs = OutputFiles.in_folder(args.out, stem, json=args.json)
    passthrough = PASSTHROUGH[profile](pipeline.limits) if profile in PASSTHROUGH else None
    events: list[TouchEvent] = []
    misfits: dict[str, str] = {}

    def follow(step: PipelineStep) -> None:
        if misfit := getattr(pipeline.detector, "misfit", None):
            misfits[misfit.code] = misfit.text
        events.extend(event for prediction in step.predictions for event in prediction.events)
        update(completed=step.block.end)

    with output.progress("processing", source.size, note=escape(path.name)) as update:
        summary, renderer = process_recording(sound, pipeline, outputs, passthrough=passthrough, on_step=follow)
    files = {"vibration": outputs.waveform, "timeline": outputs.timeline}
    if settings.detector.events or profile == "events":
        files["events"] = args.out / f"{stem}.events.csv"
        lines = ["time,event", *(f"{event.time:.4f},{event.kind}" for event in events)]
        files["events"].write_text("\n".join(lines) + "\n", encoding="utf-8")
    if outputs.timeline_json:
        files["timeline_json"] = outputs.timeline_json
    files |= output.write_haptic_files(args.to, args.out / stem, outputs.timeline, duration=source.duration)
    truth = ground_truth(path, duration=source.duration)
    labels = {segment.label_name for segment in truth}
    label = labels.pop() if len(labels) == 1 else "mixed" * bool(labels)
    if args.plot:
        files["figure"] = args.out / f"{stem}.feel.png"
        labelled = f", labelled {label}" if label else ""
        draw_recording(
            files["figure"],
            timeline=outputs.timeline,
            microphones=renderer.microphones,
            vibration=renderer.vibration,
            title=f"{path.name}{labelled}; model {pipeline.detector.name}, profile {pipeline.profile.name}",
            truth=truth,
        )
    mono = sound.channels == 1 and not settings.detector.model and tip == DEFAULT_TIP
    counts = Counter(event.kind for event in events)
    if source.sample_rate < card.sample_rate:
        misfits["narrow-band"] = (
            f"recorded at {source.sample_rate} Hz, so without sound over {source.sample_rate // 2} Hz, but the model "
            f"uses up to {card.sample_rate // 2}: rough may be rendered smooth; record at a higher rate"
        )
    notes = [*preparation.notes(source.channels, used=card.channels), *misfits.values()]
    scores = score_run(read_timeline(outputs.timeline), truth) if label else None
    return Result(path, pipeline, profile, mono, label, truth, summary, files, floor, notes, scores, counts)


def _prepare(path: Path, card: ModelCard, settings: Settings) -> tuple[Preparation, RecordingFloor | None]:
    """Read a recording before it is processed: what to correct in it, and its contact threshold if none is given."""
    preparation = Preparation.of(FileSource(path)).for_tip(card.tip)
    if card.imported:  # trained on sound as its authors recorded it
        preparation = replace(preparation, offset=(0.0,) * len(preparation.offset), hum=None)
    if not math.isnan(settings.detector.threshold_dbfs):
        return preparation, None
    floor = _measure_floor(path, preparation, card)
    # Sound that is rendered itself keeps its level.
    level_counts = card.imported or settings.rendering.profile in PASSTHROUGH
    louder = preparation if level_counts else preparation.amplified(floor.loudest_dbfs)
    return louder, floor if louder == preparation else _measure_floor(path, louder, card)


def _measure_floor(path: Path, preparation: Preparation, card: ModelCard) -> RecordingFloor:
    with PreparedSource(FileSource(path), preparation) as sound:
        return measure_floor(sound, sample_rate=sound.sample_rate, rule=card.gate.rule)


def _open_pipeline(
    sound: PreparedSource, model: str, floor: RecordingFloor | None, settings: Settings, *, fast_contact: bool
) -> Pipeline:
    profile = settings.rendering.profile
    pipeline = open_pipeline(
        model, sample_rate=sound.sample_rate, channels=sound.channels,
        profile="paper" if profile in PASSTHROUGH else profile, limits=Limits(ceiling=settings.rendering.ceiling),
        fast_contact=fast_contact, follow_floor=False, events=settings.detector.events, tip=settings.capture.tip,
    )  # fmt: skip
    pipeline.detector.threshold.dbfs = floor.threshold_dbfs if floor else settings.detector.threshold_dbfs
    return pipeline
