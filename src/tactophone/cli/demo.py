"""``tactophone demo``: the whole telephone with no hardware, in one command.

Only the finger is simulated, or replaced by a recording. The rest is the live system: one process encodes, encrypts and
sends the sound, a simulated network loses some of it, another process predicts and renders.
"""

import argparse
import math
import os
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import asdict, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.app import runs
from tactophone.cli import console, live, options, output, page
from tactophone.core.errors import ConfigError
from tactophone.core.hand import each_finger, names_of
from tactophone.core.processes import make_room
from tactophone.core.settings import Finger, Settings, change
from tactophone.live.telemetry.prediction_log import PredictionLog
from tactophone.live.telemetry.watcher import running

if TYPE_CHECKING:
    from tactophone.app.vibration_wav import RunRecorder, RunScores
    from tactophone.lab.dataset.values import Segment
    from tactophone.live.audio.files import FileSource
    from tactophone.live.telemetry.watcher import Snapshot

    Fingers = dict[str, tuple[RunScores, dict[str, Path]]]  # scores and files by name; a single finger has none

EXAMPLES = (
    "tactophone demo",
    "tactophone demo --network internet --tip stylus --open",
    "tactophone demo --fingers 5 --out hand --record hand/run.mcap",
)

PATIENCE = 20.0
"""Seconds beyond the sound's length after which a hanging demonstration is ended."""

USUAL = ["simulation.network=wifi-busy"]

RECORDED = ("capture.source=file", "capture.loop=false", "output.actuator=none")
"""Settings of both sides over a recording."""


def _parts(fingers: "Fingers", last: "Snapshot", *, verbose: bool) -> Iterator[output.Part]:
    if verbose:
        yield "packets, and median latency by stage:"
        yield from live.counts_and_budget(last.counters, last.gauges)
        yield ""
    if lost := last.counters["xruns"] * last.gauges["device_period"]:
        yield f"{lost:.1f} s of vibration are missing: this machine stood still for too long"
    for name, (scores, _) in fingers.items():
        yield from _words(name, scores)
    files = {f"{name} {kind}".strip(): path for name, (_, own) in fingers.items() for kind, path in own.items()}
    # The picture last: it is what to look at next.
    for kind, path in reversed(files.items()):
        if verbose or kind.endswith("picture"):
            yield f"{kind + ':':12} {path}"


def _words(name: str, scores: "RunScores") -> Iterator[str]:
    of = f"{name}, " * bool(name)
    if math.isfinite(scores.smooth_right):
        bumps = f"{scores.false_bumps} false bump{'s' * (scores.false_bumps != 1)}"
        yield f"{of}on the smooth stone: {output.percent(scores.smooth_right)} of predictions are smooth, {bumps}"
    if math.isfinite(scores.rough_right):
        dips = f"{scores.dips} dip{'s' * (scores.dips != 1)}"
        yield f"{of}on the rough stone:  {output.percent(scores.rough_right)} of predictions are rough, {dips}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for picture and sound")
    add("--recording", type=Path, metavar="FILE", help="WAV or FLAC to send in place of the simulated finger's sound")
    options.add_json(parser, "print the scores as JSON")
    add("--verbose", action="store_true", help="print the counts of packets, the latency by stage and every file too")
    options.add_settings(parser, "demo", USUAL)
    options.add_fingers(parser)
    live.add_record(parser, bridge=False)
    page.add_dashboard(parser)


def run(args: argparse.Namespace) -> int:
    output.make_folder(args.out)
    if not args.recording:
        output.log().print("a simulated finger strokes a smooth stone, then a rough one ...", style="dim")
    given = options.settings_of(args, USUAL)
    settings = _with_sound(args, given)
    recorded = bool(args.recording) or (given.is_hand and settings is given)
    with nullcontext(settings.process.name) if settings.process.name else _free_name() as name:
        return _demonstrate(args, change(settings, [*RECORDED, f"process.name={name}"]), name, recorded=recorded)


def _demonstrate(args: argparse.Namespace, settings: Settings, name: str, *, recorded: bool) -> int:
    """Run both sides over the sound; one of the user's own recordings is opened as `tactophone feel` does."""
    from tactophone.app.recordings import corrected_source, with_own_thresholds
    from tactophone.app.vibration_wav import RunRecorder, score_run
    from tactophone.lab.dataset.read import ground_truth
    from tactophone.live.audio.files import FileSource
    from tactophone.live.telemetry.timeline import read_timeline

    sources = [FileSource(own.capture.device) for own in each_finger(settings)]
    duration = max(source.duration for source in sources)
    timeline = args.out / "timeline.csv"
    network = settings.simulation.network
    output.log().print(f"sending {duration:.0f} s of sound over {network}, in real time", style="dim")
    with (
        runs.both_sides(
            with_own_thresholds(settings) if recorded else settings,
            name=name,
            open_source=corrected_source if recorded else None,
            report=output.note,
        ) as sides,
        live.recorded(args, settings, name),
        page.shown(settings, name, page=page.wanted(args, settings)),
        PredictionLog(name, timeline, report=output.warn),
        ExitStack() as stack,
    ):
        recorders = [stack.enter_context(RunRecorder(name, finger=place)) for place in range(len(sources))]
        outcome = console.follow(sides, name, duration=duration + PATIENCE)
    if outcome.signal:
        raise KeyboardInterrupt
    output.log().print("drawing ...", style="dim")
    fingers: Fingers = {}
    for finger, source, recorder in zip(names_of(settings), sources, recorders, strict=True):
        truth = ground_truth(source.path, duration=source.duration)
        subject = finger or (
            source.path.name if args.recording else "a simulated finger on a smooth stone, then a rough one"
        )
        files = _write(args.out, source, recorder, truth, finger=finger, title=f"{subject}: encrypted, over {network}")
        fingers[finger] = score_run(read_timeline(timeline, finger=finger), truth), files
    last = outcome.last
    assert last is not None, "a run that was scored has had a snapshot"
    values: dict[str, Any] = {name: {**files, **asdict(scores)} for name, (scores, files) in fingers.items()}
    if "" in values:
        values = {**values[""], "counters": last.counters, "gauges": last.gauges}
    output.show(values, _parts(fingers, last, verbose=args.verbose), as_json=args.json)
    return 0


@contextmanager
def _free_name() -> Iterator[str]:
    """Yield a name that no run of this machine has, so that two demonstrations run side by side.

    A run shows its name only after seconds of starting; until then, a locked file keeps it from other demonstrations.
    """
    import fcntl  # not on Windows, where the live system does not run

    for number in count(1):
        name = "demo" if number == 1 else f"demo-{number}"
        path = Path(tempfile.gettempdir(), f"tactophone-{os.getuid()}-{name}.lock")
        with os.fdopen(os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o600), "w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            if name not in running():
                yield name
                return


def _with_sound(args: argparse.Namespace, settings: Settings) -> Settings:
    """Name a recording for every finger; where there is none, the demonstration is rendered first."""
    tip, seed = settings.capture.tip, settings.simulation.seed
    if not settings.is_hand:
        sound = args.recording
        if sound is None:
            from tactophone.lab.simulation.demonstration import write_demonstration

            (sound,) = write_demonstration(args.out, seed=seed, tip=tip)
        return change(settings, [f"capture.device={sound}"])
    if args.recording:
        raise ConfigError(
            "--recording applies to a single finger; with --fingers, set device = FILE in each finger's table"
        )
    if all(own.capture.device for own in each_finger(settings)):
        return settings
    from tactophone.lab.simulation.demonstration import write_demonstration

    paths = write_demonstration(args.out, names_of(settings), seed=seed, tip=tip)
    fingers = zip(settings.fingers, paths, strict=True)
    return replace(
        settings,
        fingers=tuple(
            Finger(finger.name, (*finger.settings, ("capture.device", str(path)))) for finger, path in fingers
        ),
    )


def _write(
    folder: Path, source: "FileSource", recorder: "RunRecorder", truth: "tuple[Segment, ...]", *, finger: str,
    title: str,
) -> dict[str, Path]:  # fmt: skip
    import soundfile

    from tactophone.app.plot import draw_recording
    from tactophone.app.vibration_wav import PeakEnvelope
    from tactophone.core.types import LIVE_SAMPLE_RATE

    ending = f"-{finger}" if finger else ""
    files = {
        "picture": folder / f"demo{ending}.png",
        "microphones": source.path,
        "vibration": folder / f"vibration{ending}.wav",
        "timeline": folder / "timeline.csv",
    }
    vibration = recorder.vibration(sample_rate=LIVE_SAMPLE_RATE)
    make_room(files["vibration"])
    soundfile.write(files["vibration"], vibration, LIVE_SAMPLE_RATE, subtype="PCM_24")
    microphone_peaks = PeakEnvelope(source.channels, sample_rate=source.sample_rate)
    with source:
        for block in source:
            microphone_peaks.push(block.samples)
    vibration_peaks = PeakEnvelope(1, sample_rate=LIVE_SAMPLE_RATE)
    vibration_peaks.push(vibration[:, None])
    draw_recording(
        files["picture"], timeline=files["timeline"], microphones=microphone_peaks, vibration=vibration_peaks,
        finger=finger, title=title, truth=truth,
    )  # fmt: skip
    return files
