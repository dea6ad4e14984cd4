"""``tactophone demo``: the whole telephone with no hardware, in one command.

Only the finger is simulated, or replaced by a recording. The rest is the live system: one process encodes, encrypts and
sends the sound, a simulated network loses some of it, another process predicts and renders.
"""

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone import config
from tactophone.cli._support import console, dashboard_options, flags, log_option, record_option, run_summary, terminal
from tactophone.config import Settings

if TYPE_CHECKING:
    from tactophone.capture import FileSource
    from tactophone.dataset import Segment
    from tactophone.offline import RunRecorder, RunScores

TIMELINE = "timeline.csv"

PATIENCE = 20.0
"""Seconds beyond the sound's length after which a hanging demonstration is ended."""

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
    add(
        "--network",
        default="wifi-busy",
        metavar="NETWORK",
        help="simulated network, as in `tactophone loopback`",
    )
    add("--seed", type=int, default=0, help="random seed of strokes, set-up and network, 0 or more")
    add("--json", action="store_true", help="print the scores as JSON")
    flags.add_settings(parser, FLAGS)
    flags.add_fingers(parser)
    log_option.add_arguments(parser)
    record_option.add_arguments(parser)
    dashboard_options.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Run both sides over the recording; write picture and sound, print scores."""
    from tactophone.capture import FileSource
    from tactophone.cli.loopback import both_sides
    from tactophone.dataset import ground_truth
    from tactophone.offline import RunRecorder, score_run
    from tactophone.telemetry import read_timeline

    args.out.mkdir(parents=True, exist_ok=True)
    settings = flags.settings_of(args)
    source = FileSource(args.recording or _demonstration(args.out, args.seed, settings.capture.tip))
    terminal.log().print(f"sending {source.duration:.0f} s of sound over {args.network}, in real time", style="dim")
    settings = _over(settings, source.path)
    name = settings.process.name
    with (
        both_sides(settings, args.network, name=name, seed=args.seed) as sides,
        record_option.recorded(args, name),
        dashboard_options.shown(args, name),
        log_option.logged(_timeline(args), name),
        RunRecorder(name) as recorder,
    ):
        outcome = console.follow(sides, name, duration=source.duration + PATIENCE)
    truth = ground_truth(source.path, duration=source.duration)
    files = _write(args, source, recorder, truth)
    _print(args, outcome, score_run(read_timeline(files["timeline"]), truth), files)
    return 0


def _timeline(args: argparse.Namespace) -> Path:
    return args.log or Path(args.out, TIMELINE)


def _demonstration(folder: Path, seed: int, tip: str) -> Path:
    from tactophone.simulation import write_demonstration

    return write_demonstration(folder, seed=seed, tip=tip)


def _over(settings: Settings, sound: Path) -> Settings:
    """Settings of both sides over a recording."""
    fixed = ["capture.source=file", f"capture.device={sound}", "capture.loop=false", "output.actuator=none"]
    return config.change(settings, [*fixed, f"process.name={settings.process.name or 'demo'}"])


def _write(
    args: argparse.Namespace, source: "FileSource", recorder: "RunRecorder", truth: "tuple[Segment, ...]"
) -> dict[str, Path]:
    import soundfile

    from tactophone.offline import PeakEnvelope, draw_recording
    from tactophone.types import LIVE_SAMPLE_RATE

    files = {
        "picture": args.out / "demo.png",
        "microphones": source.path,
        "vibration": args.out / "vibration.wav",
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
        title=f"{subject}: encrypted, over {args.network}",
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
