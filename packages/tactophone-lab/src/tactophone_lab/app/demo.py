"""``tactophone demo``: both sides over recordings or a simulated finger, scored and
drawn; no hardware is needed."""

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path

import soundfile

from tactophone.app import runs
from tactophone.app.plot import draw_recording
from tactophone.app.recordings import corrected_source, with_own_thresholds
from tactophone.app.vibration_wav import PeakEnvelope, RunRecorder, RunScores, score_run
from tactophone.core.errors import ConfigError, TactophoneError
from tactophone.core.hand import each_finger, names_of
from tactophone.core.processes import hold, make_room
from tactophone.core.recordings.read import ground_truth
from tactophone.core.recordings.values import Segment
from tactophone.core.settings import FingerSettings, Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE, ignore
from tactophone.live.audio.files import FileSource
from tactophone.live.runtime.supervisor import Supervisor
from tactophone.live.telemetry.prediction_log import PredictionLog
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.live.telemetry.watcher import Snapshot, running

PATIENCE = 20.0
"""Seconds beyond the sound's length after which a hanging demonstration is ended."""

RECORDED = ("capture.source=file", "capture.loop=false", "output.actuator=none")
"""Settings of both sides over a recording."""

Follow = Callable[[Sequence[Supervisor], str, float], Snapshot | None]
"""Waits for the end of the named run, no longer than the given seconds; returns its
last snapshot."""


@dataclass(frozen=True, slots=True)
class DemoFinger:
    """How a finger of a demonstration was rendered: its scores, and its files by what
    they hold."""

    scores: RunScores
    files: dict[str, Path]


@dataclass(frozen=True, slots=True)
class Demonstration:
    """A demonstration: its fingers by name, which is empty for a single one, and the
    last snapshot of the operator."""

    fingers: dict[str, DemoFinger]
    last: Snapshot


def demonstrate(
    settings: Settings,
    folder: Path,
    *,
    recording: Path | None = None,
    name: str = "demo",
    follow: Follow = runs.wait_for_end,
    report: Callable[[str], None] = ignore,
    warn: Callable[[str], None] = ignore,
) -> Demonstration:
    """Run both sides over sound, in real time, with the simulated network of the
    settings between them.

    - ``recording``: WAV or FLAC of the only finger; it is opened as
      `tactophone.app.feel` opens it. Without it, and without a file in the settings of
      each finger, a simulated finger is rendered into ``folder``.
    - ``name``: of the run.
    - ``follow``: waits for its end; by default until a side ends.
    - ``report``, ``warn``: called with what people should know, and with what has gone
      wrong, from any thread.

    Writes picture, vibration and timeline to ``folder``. Raises `ConfigError` if a
    setting does not fit, and `TactophoneError` if no side ever started.
    """
    if not recording:
        report("a simulated finger strokes a smooth stone, then a rough one ...")
    own = settings.is_hand and all(
        each.capture.device for each in each_finger(settings)
    )
    settings = change(
        settings if own else _with_sound(settings, folder, recording),
        [*RECORDED, f"process.name={name}"],
    )
    sources = [FileSource(each.capture.device) for each in each_finger(settings)]
    duration = max(source.duration for source in sources)
    timeline = folder / "timeline.csv"
    network = settings.simulation.network
    recorded = bool(recording) or own
    report(f"sending {duration:.0f} s of sound over {network}, in real time")
    with (
        runs.both_sides(
            with_own_thresholds(settings) if recorded else settings,
            name=name,
            open_source=corrected_source if recorded else None,
            report=report,
        ) as sides,
        PredictionLog(name, timeline, report=warn),
        ExitStack() as stack,
    ):
        recorders = [
            stack.enter_context(RunRecorder(name, finger=place))
            for place in range(len(sources))
        ]
        last = follow(sides, name, duration + PATIENCE)
    if last is None:
        raise TactophoneError(
            f"{name}: no side started; `tactophone loopback` says why"
        )
    report("drawing ...")
    fingers = {}
    for finger, source, recorder in zip(
        names_of(settings), sources, recorders, strict=True
    ):
        truth = ground_truth(source.path, duration=source.duration)
        subject = finger or (
            recording.name
            if recording
            else "a simulated finger on a smooth stone, then a rough one"
        )
        title = f"{subject}: encrypted, over {network}"
        files = _write(folder, source, recorder, truth, finger=finger, title=title)
        fingers[finger] = DemoFinger(
            score_run(read_timeline(timeline, finger=finger), truth), files
        )
    return Demonstration(fingers, last)


@contextmanager
def free_name() -> Iterator[str]:
    """Yield a name that no run of this machine has, so that two demonstrations run side
    by side.

    A run shows its name only after seconds of starting; until then, a locked file keeps
    it from other demonstrations.
    """
    for number in count(1):
        name = "demo" if number == 1 else f"demo-{number}"
        with _locked(name) as ours:
            if ours and name not in running():
                yield name
                return


@contextmanager
def _locked(name: str) -> Iterator[bool]:
    """Yield whether no other demonstration of this user is starting by this name, and
    keep others from it meanwhile.

    In the folder for temporary files another user may have made a file of the lock's
    name. It says nothing then, and the name of the run alone decides.
    """
    path = Path(tempfile.gettempdir(), f"tactophone-{os.getuid()}-{name}.lock")
    with ExitStack() as stack:
        ours = True
        with suppress(OSError):
            lock = os.open(path, os.O_CREAT | os.O_RDWR | os.O_NOFOLLOW, 0o600)
            stack.callback(os.close, lock)
            ours = os.fstat(lock).st_uid != os.getuid() or hold(lock)
        yield ours


def _with_sound(settings: Settings, folder: Path, recording: Path | None) -> Settings:
    """Name a recording for every finger. Without a recording, the demonstration is
    rendered first."""
    from tactophone_lab.simulation.demonstration import write_demonstration

    tip = settings.capture.tip
    seed = settings.simulation.seed
    if not settings.is_hand:
        if recording is None:
            recording = write_demonstration(folder, seed=seed, tip=tip)[0]
        return change(settings, [f"capture.device={recording}"])
    if recording:
        raise ConfigError(
            "--recording applies to a single finger; with --fingers, set device = "
            "FILE in each finger's table"
        )
    paths = write_demonstration(folder, names_of(settings), seed=seed, tip=tip)
    fingers = (
        FingerSettings(finger.name, (*finger.settings, ("capture.device", str(path))))
        for finger, path in zip(settings.fingers, paths, strict=True)
    )
    return replace(settings, fingers=tuple(fingers))


def _write(
    folder: Path,
    source: FileSource,
    recorder: RunRecorder,
    truth: tuple[Segment, ...],
    *,
    finger: str,
    title: str,
) -> dict[str, Path]:
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
        files["picture"],
        timeline=files["timeline"],
        microphones=microphone_peaks,
        vibration=vibration_peaks,
        finger=finger,
        title=title,
        truth=truth,
    )
    return files
