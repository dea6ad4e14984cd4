"""``tactophone demo``: the whole telephone with no hardware, in one command.

The finger is simulated, or a recording stands for it. Everything after it is the real thing: the robot's process codes
and seals the sound, a bad line loses some of it, the operator's process judges and feels.
"""

import argparse
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import soundfile

from tactophone import config
from tactophone.capture import FileSource
from tactophone.cli._support import console as face
from tactophone.cli._support import dashboard_options as page
from tactophone.cli._support import flags, terminal
from tactophone.cli._support import run_summary as outcome
from tactophone.cli.loopback import both_sides
from tactophone.config import Settings
from tactophone.dataset import Recording, Segment, truth_of, write_metadata
from tactophone.offline.peaks import PeakEnvelope
from tactophone.offline.plots import draw_recording
from tactophone.offline.run_recorder import RunRecorder
from tactophone.offline.run_summary import Numbers, measure
from tactophone.runtime.wiring import SAMPLE_RATE
from tactophone.telemetry.prediction_log import read_timeline

PATIENCE = 20.0
"""Seconds beyond the sound's length after which a demonstration that hangs is over."""

FLAGS = {
    "--codec": "link.codec",
    "--packet": "link.packet_duration",
    "--judge": "link.judge",
    "--model": "judge.model",
    "--profile": "feel.profile",
    "--ceiling": "feel.ceiling",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add = parser.add_argument
    add("--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for picture and sound")
    add("--recording", type=Path, metavar="FILE", help="WAV or FLAC to send in place of the simulated finger's sound")
    add(
        "--network",
        default="wifi-busy",
        metavar="LINE",
        help="what the line does to packets, as in `tactophone loopback`",
    )
    add("--seed", type=int, default=0, help="another seed strokes otherwise, in another set-up, over another line")
    add("--json", action="store_true", help="print the numbers as JSON")
    flags.add_settings(parser, FLAGS)
    page.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Stroke, send, judge, feel; then show what came of it."""
    args.out.mkdir(parents=True, exist_ok=True)
    heard = FileSource(args.recording or simulate(args.out, seed=args.seed))
    terminal.log().print(
        f"{heard.duration:.0f} s of sound go over a {args.network} line, as they are heard", style="dim"
    )
    settings = _settings(args, heard.path)
    with (
        both_sides(settings, args.network, name=settings.process.name, seed=args.seed) as sides,
        page.shown(args, settings.process.name),
        RunRecorder(settings.process.name) as witness,
    ):
        ended = face.follow(sides, settings.process.name, duration=heard.duration + PATIENCE)
    truth = truth_of(heard.path, duration=heard.duration)
    files = _write(args, heard, witness, truth)
    numbers = measure(read_timeline(files["timeline"]), truth)
    _print(args, ended, numbers, files)
    return 0


def simulate(folder: Path, *, seed: int) -> Path:
    """Write what the simulated finger's microphones hear, with the truth beside it, as a data set of one recording."""
    from tactophone.simulation.content.demonstration import demonstration
    from tactophone.simulation.content.render_store import tell

    path, finger = folder / "microphones.wav", demonstration(seed)
    things = []
    with soundfile.SoundFile(path, "w", SAMPLE_RATE, finger.channels, "PCM_24") as file, finger:
        for block in finger:
            file.write(block.samples)
            things.append(finger.truth.thing)
    segments, _ = tell(np.concatenate(things), finger.scene)
    channels = ("contact", "air")
    write_metadata(folder, [Recording(path, "competition stones", channels=channels, segments=segments)])
    return path


def _settings(args: argparse.Namespace, sound: Path) -> Settings:
    settings = flags.settings_of(args)
    name = settings.process.name or "demo"
    fixed = [
        "capture.source=file",
        f"capture.device={sound}",
        "capture.loop=false",
        "output.actuator=none",
        f"process.name={name}",
    ]
    return config.change(settings, fixed)


def _write(
    args: argparse.Namespace, heard: FileSource, witness: RunRecorder, truth: tuple[Segment, ...]
) -> dict[str, Path]:
    files = {
        "picture": args.out / "demo.png",
        "microphones": heard.path,
        "vibration": args.out / "vibration.wav",
        "timeline": args.out / "timeline.csv",
    }
    vibration = witness.vibration(sample_rate=SAMPLE_RATE)
    soundfile.write(files["vibration"], vibration, SAMPLE_RATE, subtype="PCM_24")
    witness.write_timeline(files["timeline"])
    what = heard.path.name if args.recording else "a simulated finger on a smooth stone, then a rough one"
    draw_recording(
        files["picture"],
        timeline=files["timeline"],
        microphones=_envelope(heard),
        vibration=_gathered(vibration[:, None]),
        title=f"{what}: felt over a sealed {args.network} line",
        truth=truth,
    )
    return files


def _envelope(heard: FileSource) -> PeakEnvelope:
    envelope = PeakEnvelope(heard.channels, sample_rate=heard.sample_rate)
    with heard:
        for block in heard:
            envelope.push(block.samples)
    return envelope


def _gathered(samples: np.ndarray) -> PeakEnvelope:
    envelope = PeakEnvelope(samples.shape[1], sample_rate=SAMPLE_RATE)
    envelope.push(samples)
    return envelope


def _print(args: argparse.Namespace, ended: face.Outcome, numbers: Numbers, files: dict[str, Path]) -> None:
    if args.json:
        last = ended.last
        line = {"counters": last.counters, "gauges": last.gauges} if last else {}
        terminal.print_json({**{name: str(path) for name, path in files.items()}, **asdict(numbers), **line})
        return
    if math.isfinite(numbers.smooth_right):
        bumps = f"{numbers.false_bumps} false bump{'s' * (numbers.false_bumps != 1)}"
        print(f"where it is smooth: felt smooth {numbers.smooth_right:.0%} of the time, {bumps}")
    if math.isfinite(numbers.rough_right):
        print(f"where it is rough:  felt rough {numbers.rough_right:.0%} of the time")
    print("\nthe line, and where the time went (medians):")
    outcome.print_outcome(args, ended)
    print()
    for name, path in files.items():
        print(f"{name + ':':13}{path}")
