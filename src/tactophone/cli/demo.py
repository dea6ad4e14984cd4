"""``tactophone demo``: the whole telephone with no hardware, in one command.

Only the finger is simulated, or replaced by a recording. The rest is the live system: one process encodes, encrypts and
sends the sound, a simulated network loses some of it, another process predicts and renders.
"""

import argparse
import math
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli._support import console, dashboard_options, flags, log_option, record_option, run_summary, terminal
from tactophone.cli._support.folders import make_folder
from tactophone.cli._support.ranges import SEED
from tactophone.errors import ConfigError
from tactophone.hand import each_finger, names_of
from tactophone.settings import Finger, Settings, change

if TYPE_CHECKING:
    from tactophone.capture import FileSource
    from tactophone.dataset import Segment
    from tactophone.offline import RunRecorder, RunScores

TIMELINE = "timeline.csv"

PATIENCE = 20.0
"""Seconds beyond the sound's length after which a hanging demonstration is ended."""

RECORDED = ("capture.source=file", "capture.loop=false", "output.actuator=none")
"""Settings of both sides over a recording."""

FLAGS = {
    "--tip": "capture.tip",
    "--codec": "link.codec",
    "--packet-duration": "link.packet_duration",
    "--send-predictions": "link.send_predictions",
    "--model": "detector.model",
    "--profile": "rendering.profile",
    "--ceiling": "rendering.ceiling",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add = parser.add_argument
    add("--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for picture and sound")
    add("--recording", type=Path, metavar="FILE", help="WAV or FLAC to send in place of the simulated finger's sound")
    add("--network", default="wifi-busy", metavar="NETWORK", help="simulated network, as in `tactophone loopback`")
    add("--seed", type=SEED, default=0, help="random seed of strokes, set-up and network, %(type)s")
    add("--json", action="store_true", help="print the scores as JSON")
    flags.add_settings(parser, FLAGS)
    flags.add_fingers(parser)
    log_option.add_arguments(parser)
    record_option.add_arguments(parser)
    dashboard_options.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run both sides over the recording, or one for each finger; write picture and sound, print scores."""
    from tactophone.capture import FileSource
    from tactophone.cli.loopback import both_sides
    from tactophone.dataset import ground_truth
    from tactophone.offline import RunRecorder, score_run
    from tactophone.telemetry import read_timeline

    make_folder(args.out)
    settings = _with_sound(args, flags.settings_of(args))
    name = settings.process.name or "demo"
    settings = change(settings, [*RECORDED, f"process.name={name}"])
    sources = [FileSource(own.capture.device) for own in each_finger(settings)]
    duration = max(source.duration for source in sources)
    terminal.log().print(f"sending {duration:.0f} s of sound over {args.network}, in real time", style="dim")
    with (
        both_sides(settings, args.network, name=name, seed=args.seed) as sides,
        record_option.recorded(args, name),
        dashboard_options.shown(args, name),
        log_option.logged(_timeline(args), name),
        ExitStack() as stack,
    ):
        recorders = [stack.enter_context(RunRecorder(name, finger=place)) for place in range(len(sources))]
        outcome = console.follow(sides, name, duration=duration + PATIENCE)
    if outcome.signal:
        raise KeyboardInterrupt
    scores, files = {}, {}
    for finger, source, recorder in zip(names_of(settings), sources, recorders, strict=True):
        truth = ground_truth(source.path, duration=source.duration)
        files[finger] = _write(args, source, recorder, truth, finger=finger)
        scores[finger] = score_run(read_timeline(_timeline(args), finger=finger), truth)
    if settings.is_hand:
        _print_hand(args, outcome, scores, files)
    else:
        _print(args, outcome, scores[""], files[""])
    return 0


def _with_sound(args: argparse.Namespace, settings: Settings) -> Settings:
    """Name a recording for every finger; where there is none, the demonstration is rendered first."""
    tip = settings.capture.tip
    if not settings.is_hand:
        sound = args.recording
        if sound is None:
            from tactophone.simulation.demonstration import write_demonstration

            sound = write_demonstration(args.out, seed=args.seed, tip=tip)
        return change(settings, [f"capture.device={sound}"])
    if args.recording:
        raise ConfigError("--recording is of one finger: name each finger's in its table, as in device = FILE")
    if all(own.capture.device for own in each_finger(settings)):
        return settings
    from tactophone.simulation.demonstration import demonstrate_hand

    paths = demonstrate_hand(args.out, names_of(settings), seed=args.seed, tip=tip)
    fingers = zip(settings.fingers, paths, strict=True)
    return replace(
        settings,
        fingers=tuple(
            Finger(finger.name, (*finger.settings, ("capture.device", str(path)))) for finger, path in fingers
        ),
    )


def _print_hand(
    args: argparse.Namespace,
    outcome: console.Outcome,
    scores: "dict[str, RunScores]",
    files: dict[str, dict[str, Path]],
) -> None:
    if args.json:
        paths = {finger: {kind: str(path) for kind, path in own.items()} for finger, own in files.items()}
        terminal.print_json({finger: {**paths[finger], **asdict(own)} for finger, own in scores.items()})
        return
    for finger, own in scores.items():
        print(f"{finger + ':':14}{own.smooth_right:.0%} of predictions on the smooth stone are smooth, "
              f"{own.rough_right:.0%} on the rough stone rough, {own.false_bumps} false bumps")  # fmt: skip
    print("\npackets, and median latency by stage:")
    run_summary.print_outcome(args, outcome)
    print(f"\npictures and sound: {args.out}, timeline: {_timeline(args)}")


def _timeline(args: argparse.Namespace) -> Path:
    return args.log or Path(args.out, TIMELINE)


def _write(
    args: argparse.Namespace,
    source: "FileSource",
    recorder: "RunRecorder",
    truth: "tuple[Segment, ...]",
    *,
    finger: str = "",
) -> dict[str, Path]:
    import soundfile

    from tactophone.offline import PeakEnvelope, draw_recording
    from tactophone.types import LIVE_SAMPLE_RATE

    ending = f"-{finger}" if finger else ""
    files = {
        "picture": args.out / f"demo{ending}.png",
        "microphones": source.path,
        "vibration": args.out / f"vibration{ending}.wav",
        "timeline": _timeline(args),
    }
    vibration = recorder.vibration(sample_rate=LIVE_SAMPLE_RATE)
    soundfile.write(files["vibration"], vibration, LIVE_SAMPLE_RATE, subtype="PCM_24")
    microphone_peaks = PeakEnvelope(source.channels, sample_rate=source.sample_rate)
    with source:
        for block in source:
            microphone_peaks.push(block.samples)
    vibration_peaks = PeakEnvelope(1, sample_rate=LIVE_SAMPLE_RATE)
    vibration_peaks.push(vibration[:, None])
    subject = source.path.name if args.recording else "a simulated finger on a smooth stone, then a rough one"
    draw_recording(
        files["picture"],
        timeline=files["timeline"],
        microphones=microphone_peaks,
        vibration=vibration_peaks,
        finger=finger,
        title=f"{finger or subject}: encrypted, over {args.network}",
        truth=truth,
    )
    return files


def _print(args: argparse.Namespace, outcome: console.Outcome, scores: "RunScores", files: dict[str, Path]) -> None:
    if args.json:
        last = outcome.last
        telemetry = {"counters": last.counters, "gauges": last.gauges} if last else {}
        terminal.print_json({**{name: str(path) for name, path in files.items()}, **asdict(scores), **telemetry})
        return
    if math.isfinite(scores.smooth_right):
        bumps = f"{scores.false_bumps} false bump{'s' * (scores.false_bumps != 1)}"
        print(f"on the smooth stone: {scores.smooth_right:.0%} of predictions are smooth, {bumps}")
    if math.isfinite(scores.rough_right):
        print(f"on the rough stone:  {scores.rough_right:.0%} of predictions are rough")
    print("\npackets, and median latency by stage:")
    run_summary.print_outcome(args, outcome)
    print()
    for name, path in files.items():
        print(f"{name + ':':13}{path}")
