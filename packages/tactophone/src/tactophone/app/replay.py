"""``tactophone replay``: a logged run computed again in virtual time, compared with its
log, rendered, and played.

Needs the link's libraries.
"""

import itertools
import math
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

from msgspec import structs

from tactophone.app.logged_run import (
    LONGEST_GAP,
    Change,
    LoggedEndpoint,
    WakeUp,
    add_sound,
    wake_ups,
    write_sound,
)
from tactophone.app.playback import PlayableRecording
from tactophone.app.plot import draw_recording
from tactophone.app.vibration_wav import OfflineRenderer, OutputFiles, RunSummary
from tactophone.core.errors import DatasetError
from tactophone.core.hand import names_of
from tactophone.core.microphones import CONTACT, MICROPHONES
from tactophone.core.settings import DEFAULT_CEILING, FingerSettings, Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE, HapticCommand, PipelineStep
from tactophone.live.audio.files import FileSource
from tactophone.live.log.mcap import LogEnd, LogEntry, LoggedPrediction, read_log
from tactophone.live.log.reader import encoded
from tactophone.live.telemetry.records import Controls, EventBatch, RunStart
from tactophone.signal.haptics.limits import Limits

MOST_NOTED = 10
"""Most gaps that are noted one by one."""


@dataclass(slots=True)
class Comparison:
    """How the predictions and commands of a replay compare with those in the log, one
    by one."""

    equal: int = 0
    different: int = 0
    """`equal` and `different`: predictions that are equal to the bit, command included,
    and those that are not."""
    uncertain: int = 0
    """Predictions and commands whose controls the log leaves open; not compared."""
    first: tuple[LoggedPrediction, LoggedPrediction] | None = None
    """The first that differs: as logged, and as computed."""

    def add(
        self, logged: LoggedPrediction, computed: LoggedPrediction, *, certain: bool
    ) -> None:
        # By their entries, as NaN differs from itself; telemetry does not publish the
        # flag `faulty`.
        if encoded(logged.prediction, logged.command) == encoded(
            computed.prediction, computed.command
        ):
            self.equal += 1
        elif not certain:
            self.uncertain += 1
        else:
            self.different += 1
            self.first = self.first or (logged, computed)


@dataclass(slots=True)
class Replay:
    """Runs the entries of a log; iterate over :meth:`steps` to the end."""

    entries: Iterable[LogEntry]
    change: Change = lambda settings: settings
    """Changes the settings of each process in it."""
    ceiling: float = 1.0
    """Upper limit for the ceiling recorded in the log."""
    comparison: Comparison = field(default_factory=Comparison)
    """With what was logged; complete when the steps have been computed."""
    role: str = ""
    complete: bool = True
    """Whether the log has its end; the writer of one without was killed, or its disk
    was full."""
    missed: Mapping[str, int] = field(default_factory=dict)
    """Bytes and predictions that the log lacks, because they were not read in time."""
    processes: int = 0
    gaps: int = 0
    """Gaps over `LONGEST_GAP` that were left out."""
    notes: list[str] = field(default_factory=list)
    lowered: bool = False
    """Whether a ceiling in the log was above the bound; the comparison then says
    nothing."""
    endpoint: LoggedEndpoint | None = None
    _logged: dict[int, deque[LoggedPrediction]] = field(
        default_factory=partial(defaultdict, deque)
    )
    _computed: dict[int, deque[tuple[LoggedPrediction, bool]]] = field(
        default_factory=partial(defaultdict, deque)
    )
    _offset: int = 0
    _end: int = 0

    def steps(self) -> Iterator[PipelineStep]:
        """Compute the run again; returns its steps on one time axis, through all its
        sessions.

        Raises `DatasetError` if the log holds no beginning of a run.
        """
        for item in wake_ups(self.entries):
            match item:
                case RunStart():
                    self._begin(item)
                case Controls() if self.endpoint:
                    self.endpoint.apply(item)
                case WakeUp():
                    yield from self._process(item)
                case LoggedPrediction():
                    self._logged[item.finger].append(item)
                case LogEnd(complete, missed):
                    self.complete = complete
                    self.missed = missed
            self._compare()
        if self.endpoint is None:
            raise DatasetError("the log holds no run: was it written by --record?")

    def _begin(self, run: RunStart) -> None:
        self.endpoint = LoggedEndpoint(run, self.change, ceiling=self.ceiling)
        self.lowered |= self.endpoint.lowered
        self.role = run.role
        self.processes = self.processes + 1
        self.notes += [note for note in self.endpoint.notes if note not in self.notes]
        # What a killed process had no time to publish has no counterpart.
        self._logged.clear()
        self._computed.clear()
        self._offset = self._end

    def _process(self, wake_up: WakeUp) -> Iterator[PipelineStep]:
        if self.endpoint is None:
            raise DatasetError(
                "the log begins within a run, and a replay needs its start: "
                "`tactophone feel` computes from its sound, and `--record` keeps a run "
                "from its start"
            )
        for step, certain in self.endpoint.process(wake_up):
            for number, prediction in enumerate(step.predictions):
                command = (
                    step.commands[number]
                    if step.commands
                    else HapticCommand(math.nan, math.nan, prediction.end)
                )
                logged = LoggedPrediction(prediction, command, step.finger)
                self._computed[step.finger].append((logged, certain))
            self._leave_out(
                step.block.start + self._offset - self._end, step.block.sample_rate
            )
            self._end = max(self._end, step.block.end + self._offset)
            yield _shifted(step, self._offset) if self._offset else step

    def _leave_out(self, gap: int, rate: int) -> None:
        """Move what follows a long gap to its beginning: time is an allocation too."""
        if gap <= LONGEST_GAP * rate:
            return
        self._offset -= gap
        self.gaps += 1
        if self.gaps <= MOST_NOTED:
            self.notes.append(
                f"{gap / rate:.0f} s without sound at {self._end / rate:.2f} s are "
                "left out"
            )
        elif self.gaps == MOST_NOTED + 1:
            self.notes.append("further long gaps are left out too")

    def _compare(self) -> None:
        # The robot's log holds the packets as sent and predictions from the sound
        # before: no counterparts.
        for finger, logged in self._logged.items() if self.role == "operator" else ():
            while logged and self._computed[finger]:
                computed, certain = self._computed[finger].popleft()
                self.comparison.add(logged.popleft(), computed, certain=certain)


@dataclass(frozen=True, slots=True)
class RenderedFinger:
    """What a replay wrote of one finger; its name is empty for the only one."""

    name: str
    summary: RunSummary
    files: dict[str, Path]


def write_replay(
    replay: Replay, folder: Path, stem: str, *, plot: bool = False
) -> list[RenderedFinger]:
    """Compute a log again and write vibration and timeline of each finger, as for a
    recording, and a figure if wanted.

    Raises `DatasetError` if nothing in the log can be rendered.
    """
    folder.mkdir(parents=True, exist_ok=True)
    steps = replay.steps()
    first = next(steps, None)
    if first is None or replay.endpoint is None:
        raise DatasetError(
            "the log holds no sound and no predictions: was a robot connected?"
        )
    names = names_of(replay.endpoint.settings)
    pipelines = replay.endpoint.endpoint.hand.pipelines
    stems = [f"{stem}-{name}" if name else stem for name in names]
    outputs = [OutputFiles.in_folder(folder, each) for each in stems]
    with ExitStack() as stack:
        renderers = [
            stack.enter_context(
                OfflineRenderer(
                    files, pipeline, channels=2, sample_rate=LIVE_SAMPLE_RATE
                )
            )
            for files, pipeline in zip(outputs, pipelines, strict=True)
        ]
        for step in itertools.chain([first], steps):
            renderers[step.finger].write(_complete(step))
        summaries = [renderer.finish(flush=False) for renderer in renderers]
    written = [
        {"vibration": files.waveform, "timeline": files.timeline} for files in outputs
    ]
    for name, pipeline, renderer, files in (
        zip(stems, pipelines, renderers, written, strict=True) if plot else ()
    ):
        files["figure"] = folder / f"{name}.replay.png"
        draw_recording(
            files["figure"],
            timeline=files["timeline"],
            microphones=renderer.microphones,
            vibration=renderer.vibration,
            title=(
                f"{name}, replayed; model {pipeline.detector.name}, profile "
                f"{pipeline.profile.name}"
            ),
        )
    return [
        RenderedFinger(*each) for each in zip(names, summaries, written, strict=True)
    ]


def _complete(step: PipelineStep) -> PipelineStep:
    """Give each prediction a command, silence where there was none, and each block two
    channels."""
    if step.block.channels == 1:
        block = step.block.select([CONTACT] * len(MICROPHONES))
        step = structs.replace(step, block=block)
    if len(step.commands) == len(step.predictions):
        return step
    silence = tuple(
        HapticCommand(0.0, Limits().lowest, prediction.end)
        for prediction in step.predictions
    )
    return structs.replace(step, commands=silence)


def _shifted(step: PipelineStep, offset: int) -> PipelineStep:
    """Return a step ``offset`` samples later: the processes of a run follow one
    another, each begins at 0."""
    shift = offset / step.block.sample_rate
    return PipelineStep(
        structs.replace(step.block, start=step.block.start + offset),
        tuple(
            structs.replace(each, start=each.start + shift, end=each.end + shift)
            for each in step.predictions
        ),
        tuple(structs.replace(each, time=each.time + shift) for each in step.commands),
        step.finger,
    )


@dataclass(frozen=True, slots=True)
class ReplayedLog:
    """A log computed again, and what was written of it."""

    replay: Replay
    fingers: list[RenderedFinger]
    files: dict[str, Path]
    """Each file by what it holds."""


def replay_log(
    log: Path,
    changes: Sequence[str] = (),
    *,
    out: Path | None = None,
    bag: Path | None = None,
    audio: Path | None = None,
    plot: bool = False,
    follow: Callable[[Iterator[LogEntry]], Iterable[LogEntry]] = iter,
) -> ReplayedLog:
    """Compute a log again, compare it, and write what is wanted.

    - ``changes``: ``NAME=VALUE`` of settings of the detector and of rendering, for
      every finger.
    - ``out``: folder for vibration and timeline of each finger, and with ``plot`` a
      figure.
    - ``bag``: new folder for a ROS 2 bag, in place of ``out``.
    - ``audio``: file for a copy of the log with its sound.
    - ``follow``: is given the entries, and passes them on.

    A log is compared at its own ceiling; what is written keeps to this machine's,
    unless a change names another. Raises `DatasetError` if the log cannot be replayed,
    and `ConfigError` if a file cannot be written.
    """
    changed = changed_by(changes)
    ceiling = _ceiling(changes) if out or bag else 1.0
    replay = Replay(follow(read_log(log)), changed, ceiling)
    fingers: list[RenderedFinger] = []
    files: dict[str, Path] = {}
    if bag:
        files["bag"] = _write_bag(replay, log, bag)
    elif out:
        fingers = write_replay(replay, out, log.stem, plot=plot)
        for finger in fingers:
            files |= {
                f"{finger.name} {kind}".strip(): path
                for kind, path in finger.files.items()
            }
    else:
        deque(replay.steps(), maxlen=0)
    if replay.lowered:
        replay = Replay(read_log(log), changed)
        deque(replay.steps(), maxlen=0)
        replay.notes.append(
            f"the ceiling of the run was above {ceiling:g}, to which what is written "
            "is bounded: --ceiling raises that"
        )
    if audio:
        files["audio"] = add_sound(log, audio)
    return ReplayedLog(replay, fingers, files)


def changed_by(changes: Sequence[str]) -> Change:
    """Return what applies ``NAME=VALUE`` to settings, of every finger also where it has
    a value of its own."""
    names = [text.partition("=")[0] for text in changes]

    def changed(settings: Settings) -> Settings:
        fingers = (
            FingerSettings(
                each.name, tuple(own for own in each.settings if own[0] not in names)
            )
            for each in settings.fingers
        )
        return replace(change(settings, changes), fingers=tuple(fingers))

    return changed


def takes_of(
    log: Path, changes: Sequence[str], folder: Path
) -> list[PlayableRecording]:
    """Write the sound of each session to a folder; return takes with the settings and
    calibration of the replay."""
    run = next(entry for entry in read_log(log) if isinstance(entry, RunStart))
    endpoint = LoggedEndpoint(run, changed_by(changes), ceiling=_ceiling(changes))
    takes = []
    for _, group in itertools.groupby(
        write_sound(log, folder), key=lambda sound: sound.session
    ):
        paths = [sound.path for sound in group]
        pipelines = [
            endpoint.open(FileSource(path).channels, finger=finger)
            for finger, path in enumerate(paths)
        ]
        takes.append(
            PlayableRecording(
                log.name, paths, pipelines, fingers=names_of(endpoint.settings)
            )
        )
    return takes


def _ceiling(changes: Sequence[str]) -> float:
    """Return what bounds the ceiling of a log: this machine's usual one, unless another
    was chosen."""
    return (
        1.0
        if any(text.startswith("rendering.ceiling=") for text in changes)
        else DEFAULT_CEILING
    )


def _write_bag(replay: Replay, log: Path, path: Path) -> Path:
    """Write the steps as a bag whose time begins when the run did."""
    from tactophone.faces.bridges.ros import RosBag

    epoch = 0.0
    begun = 0.0
    names = ["index"]
    for entry in read_log(log):
        if isinstance(entry, RunStart):
            epoch = entry.epoch
            names = [finger["name"] or "index" for finger in entry.fingers]
        elif isinstance(entry, EventBatch):
            begun = entry.time
            break
    with RosBag(path, epoch=epoch + begun, fingers=names) as bag:
        for step in replay.steps():
            bag.write(step)
    return path
