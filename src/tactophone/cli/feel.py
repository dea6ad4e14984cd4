"""``tactophone feel``: recordings in; the vibration that a finger would feel, and a timeline of predictions, out."""

import argparse
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from rich.markup import escape

from tactophone.capture import FileSource
from tactophone.cli._support import dashboard_options, haptic_file_option, terminal
from tactophone.cli._support.feel_result import Result, as_json, print_result
from tactophone.cli._support.folders import make_folder
from tactophone.cli._support.ranges import CEILING, Within
from tactophone.dataset import ground_truth
from tactophone.errors import ConfigError, TactophoneError
from tactophone.haptics import PASSTHROUGH, PROFILES, Limits
from tactophone.offline import OutputFiles, Preparation, PreparedSource, draw_recording, process_recording
from tactophone.perception import (
    ModelCard,
    RecordingFloor,
    default_model,
    measure_floor,
    model_path,
    read_model,
    shipped_models,
    tip_mismatch,
)
from tactophone.pipeline import Pipeline, open_pipeline
from tactophone.types import DEFAULT_TIP, TIP_NAMES, PipelineStep, TouchEvent


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add = parser.add_argument
    add(
        "recordings", nargs="+", type=Path, metavar="RECORDING",
        help="WAV or FLAC at 2 kHz or more; one channel, or two: contact microphone, air microphone; or the sound of a "
        "run, an MCAP file of --record",
    )  # fmt: skip
    add(
        "--finger",
        default="",
        metavar="NAME",
        help="of the log of a hand: only the finger of this name (default: each)",
    )
    add("--out", type=Path, default=Path(), metavar="DIR", help="folder for the results; created if it does not exist")
    add(
        "--model", metavar="NAME|FILE",
        help=f"a model file, or a shipped model ({', '.join(shipped_models()) or 'none'}); "
        "default: the shipped model for the tip",
    )  # fmt: skip
    add("--tip", choices=TIP_NAMES, default=DEFAULT_TIP, help="tip that touched the surface")
    add(
        "--profile",
        choices=(*PROFILES, *PASSTHROUGH),
        default="paper",
        metavar="NAME",
        help=f"rendering profile: {', '.join(PROFILES)}; or the sound itself: {', '.join(PASSTHROUGH)}",
    )
    add(
        "--contact", choices=("fast", "window"), default="fast",
        help="detect contact within milliseconds, or by the model's whole window as in the paper",
    )  # fmt: skip
    add(
        "--threshold", type=Within(float, -120, 0, unit="dBFS"), metavar="DBFS",
        help="contact threshold, %(type)s; default: just over the recording's own noise floor",
    )  # fmt: skip
    add(
        "--ceiling",
        type=CEILING,
        default=Limits().ceiling,
        metavar="LEVEL",
        help="greatest amplitude, %(type)s; profiles are scaled down to it",
    )
    add("--events", action="store_true", help="detect taps, strokes and slips, and write them as STEM.events.csv")
    add("--plot", action="store_true", help="draw a figure of sound, prediction and vibration")
    haptic_file_option.add_arguments(parser)
    add("--json", action="store_true", help="print the summary as JSON, and write the timeline as JSON too")
    dashboard_options.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Process each recording; a failure is reported, and the others continue."""
    make_folder(args.out)
    results = []
    recordings, failed = _with_sound_of_logs(args)
    for path, stem in _unique_stems(recordings):
        try:
            results.append(_process(path, stem, args))
        except (TactophoneError, OSError) as error:
            message = str(error)
            terminal.print_error(message if message.startswith(str(path)) else f"{path}: {message}")
            continue
        if not args.json:
            print_result(results[-1])
    if args.json:
        terminal.print_json([as_json(result) for result in results])
    if dashboard_options.wanted(args):
        from tactophone.cli._support import recording_playback

        takes = [
            recording_playback.Take(result.path.name, [result.path], [result.pipeline], result.truth)
            for result in results
        ]
        recording_playback.play_on_page(args, takes, name="feel")
    return 0 if len(results) == len(recordings) and not failed else 1


def _with_sound_of_logs(args: argparse.Namespace) -> tuple[list[Path], bool]:
    """Put the sound of each session in place of a log, written to ``--out``; true if one holds none."""
    from tactophone.bridges import is_mcap

    if args.finger and not any(map(is_mcap, args.recordings)):
        raise ConfigError("--finger chooses one of the fingers of a log, an MCAP file of --record: leave it out")
    recordings, failed = list[Path](), False
    for path in args.recordings:
        if not is_mcap(path):
            recordings.append(path)
            continue
        from tactophone.offline.replay import write_sound  # for logs alone: it needs the extras link and record

        try:
            recordings += [sound.path for sound in write_sound(path, args.out, finger=args.finger)]
        except TactophoneError as error:
            terminal.print_error(str(error))
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


def _process(path: Path, stem: str, args: argparse.Namespace) -> Result:
    source = FileSource(path)
    model = args.model or default_model(args.tip)
    card = read_model(model_path(model)).card
    preparation, floor = _prepare(path, card, args)
    sound = PreparedSource(source, preparation)
    pipeline = _open_pipeline(sound, model, floor, args)
    if warning := tip_mismatch(card, args.tip):
        terminal.note(f"{path}: {warning}")
    outputs = OutputFiles.in_folder(args.out, stem, json=args.json)
    passthrough = PASSTHROUGH[args.profile](pipeline.limits) if args.profile in PASSTHROUGH else None
    events: list[TouchEvent] = []

    def follow(step: PipelineStep) -> None:
        events.extend(event for prediction in step.predictions for event in prediction.events)
        update(completed=step.block.end)

    with terminal.progress("processing", source.size, note=escape(path.name)) as update:
        summary, renderer = process_recording(sound, pipeline, outputs, passthrough=passthrough, on_step=follow)
    files = {"vibration": outputs.waveform, "timeline": outputs.timeline}
    if args.events or args.profile == "events":
        files["events"] = _write_events(args.out / f"{stem}.events.csv", events)
    if outputs.timeline_json:
        files["timeline_json"] = outputs.timeline_json
    files |= haptic_file_option.write(args, args.out / stem, outputs.timeline, duration=source.duration)
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
    mono = sound.channels == 1 and not args.model and args.tip == DEFAULT_TIP
    counts = Counter(event.kind for event in events)
    notes = preparation.notes(source.channels) + _missing_treble(source, card)
    return Result(path, pipeline, args.profile, mono, label, truth, summary, files, floor, notes, counts)


def _write_events(path: Path, events: Iterable[TouchEvent]) -> Path:
    lines = ["time,event", *(f"{event.time:.4f},{event.kind}" for event in events)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def _prepare(path: Path, card: ModelCard, args: argparse.Namespace) -> tuple[Preparation, RecordingFloor | None]:
    """Read a recording before it is processed: what to correct in it, and its contact threshold if none is given."""
    preparation = Preparation.of(FileSource(path)).for_tip(card.tip)
    if args.threshold is not None:
        return preparation, None
    floor = _measure_floor(path, preparation, card)
    # Sound that is rendered itself keeps its level.
    louder = preparation if args.profile in PASSTHROUGH else preparation.amplified(floor.loudest_dbfs)
    return louder, floor if louder == preparation else _measure_floor(path, louder, card)


def _measure_floor(path: Path, preparation: Preparation, card: ModelCard) -> RecordingFloor:
    with PreparedSource(FileSource(path), preparation) as sound:
        return measure_floor(sound, sample_rate=sound.sample_rate, rule=card.gate.rule)


def _missing_treble(source: FileSource, card: ModelCard) -> list[str]:
    if source.sample_rate >= card.sample_rate:
        return []
    return [
        f"recorded at {source.sample_rate} Hz, so without what the model uses up to {card.sample_rate // 2} Hz: rough "
        "may be rendered smooth; record at a higher rate"
    ]


def _open_pipeline(
    sound: PreparedSource, model: str, floor: RecordingFloor | None, args: argparse.Namespace
) -> Pipeline:
    pipeline = open_pipeline(
        model,
        sample_rate=sound.sample_rate,
        channels=sound.channels,
        profile="paper" if args.profile in PASSTHROUGH else args.profile,
        limits=Limits(ceiling=args.ceiling),
        fast_contact=args.contact == "fast",
        follow_floor=False,
        events=args.events,
        tip=args.tip,
    )
    pipeline.detector.threshold.dbfs = floor.threshold_dbfs if floor else args.threshold
    return pipeline
