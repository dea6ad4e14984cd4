"""Replay of a log: the run again, compared with what was logged, or with another model or profile."""

import itertools
import math
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from tactophone.bridges import LogEnd, LogEntry, LoggedPrediction
from tactophone.bridges.reader import entries_of
from tactophone.errors import DatasetError
from tactophone.hand import names_of
from tactophone.haptics import Limits
from tactophone.offline.plots import draw_recording
from tactophone.offline.process_recording import OfflineRenderer, OutputFiles, RunSummary
from tactophone.offline.replay.logged_run import Change, LoggedEndpoint, ReplayedStep, WakeUp, wake_ups
from tactophone.telemetry import Controls, RunStart
from tactophone.types import LIVE_SAMPLE_RATE, HapticCommand, PipelineStep


@dataclass(slots=True)
class Comparison:
    """How the predictions and commands of a replay compare with those in the log, one by one.

    Attributes
    ----------
    equal, different
        Predictions that are equal to the bit, command included, and those that are not.
    uncertain
        Of which the log cannot say which controls held; not compared.
    first
        The first that differs: as logged, and as computed.
    """

    equal: int = 0
    different: int = 0
    uncertain: int = 0
    first: tuple[LoggedPrediction, LoggedPrediction] | None = None

    def add(self, logged: LoggedPrediction, computed: LoggedPrediction, *, certain: bool) -> None:
        """Compare one."""
        # By their entries, as NaN differs from itself; telemetry does not publish the flag `faulty`.
        if entries_of(logged.prediction, logged.command) == entries_of(computed.prediction, computed.command):
            self.equal += 1
        elif not certain:
            self.uncertain += 1
        else:
            self.different += 1
            self.first = self.first or (logged, computed)


@dataclass(slots=True)
class Replay:
    """Runs the entries of a log; iterate over :meth:`steps` to the end.

    Attributes
    ----------
    comparison
        With what was logged; complete when the steps have been computed.
    complete
        Whether the log has its end; the writer of one without was killed, or its disk was full.
    missed
        Bytes and predictions that the log lacks, because they were not read in time.
    """

    entries: Iterable[LogEntry]
    change: Change = lambda settings: settings
    """Changes the settings of each process in it."""
    comparison: Comparison = field(default_factory=Comparison)
    role: str = ""
    complete: bool = True
    missed: int = 0
    processes: int = 0
    notes: list[str] = field(default_factory=list)
    endpoint: LoggedEndpoint | None = None
    _logged: dict[int, deque[LoggedPrediction]] = field(default_factory=partial(defaultdict, deque))
    _computed: dict[int, deque[tuple[LoggedPrediction, bool]]] = field(default_factory=partial(defaultdict, deque))

    def steps(self) -> Iterator[PipelineStep]:
        """Compute the run again; returns its steps on one time axis, through all its sessions.

        Raises `DatasetError` if the log holds no beginning of a run.
        """
        axis = _TimeAxis()
        for item in wake_ups(self.entries):
            match item:
                case RunStart():
                    self._begin(item)
                    axis.restart()
                case Controls() if self.endpoint:
                    self.endpoint.apply(item)
                case WakeUp():
                    for replayed in self._process(item):
                        yield axis.place(replayed)
                case LoggedPrediction():
                    self._logged[item.finger].append(item)
                case LogEnd(complete, missed):
                    self.complete, self.missed = complete, missed
            self._compare()
        if self.endpoint is None:
            raise DatasetError("the log holds no run: was it written by --record?")

    def _begin(self, run: RunStart) -> None:
        self.endpoint = LoggedEndpoint(run, self.change)
        self.role, self.processes = run.role, self.processes + 1
        self.notes += [note for note in self.endpoint.notes if note not in self.notes]
        # What a killed process had no time to publish has no counterpart.
        self._logged.clear()
        self._computed.clear()

    def _process(self, wake_up: WakeUp) -> Iterator[ReplayedStep]:
        if self.endpoint is None:
            raise DatasetError("the log begins within a run: packets before its start cannot be replayed")
        for replayed in self.endpoint.process(wake_up):
            step = replayed.step
            for number, prediction in enumerate(step.predictions):
                command = step.commands[number] if step.commands else HapticCommand(math.nan, math.nan, prediction.end)
                logged = LoggedPrediction(prediction, command, step.finger)
                self._computed[step.finger].append((logged, replayed.certain))
            yield replayed

    def _compare(self) -> None:
        # The robot's log holds the packets as sent and predictions from the sound before: no counterparts.
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


def write_replay(replay: Replay, folder: Path, stem: str, *, plot: bool = False) -> list[RenderedFinger]:
    """Compute a log again and write vibration and timeline of each finger, as for a recording, and a figure if wanted.

    Raises `DatasetError` if nothing in the log can be rendered.
    """
    folder.mkdir(parents=True, exist_ok=True)
    steps = replay.steps()
    first = next(steps, None)
    if first is None or replay.endpoint is None:
        raise DatasetError("the log holds no sound and no predictions: was a robot connected?")
    names, pipelines = names_of(replay.endpoint.settings), replay.endpoint.endpoint.hand.pipelines
    stems = [f"{stem}-{name}" if name else stem for name in names]
    outputs = [OutputFiles.in_folder(folder, each) for each in stems]
    with ExitStack() as stack:
        renderers = [
            stack.enter_context(OfflineRenderer(files, pipeline, channels=2, sample_rate=LIVE_SAMPLE_RATE))
            for files, pipeline in zip(outputs, pipelines, strict=True)
        ]
        for step in itertools.chain([first], steps):
            renderers[step.finger].write(_complete(step))
        summaries = [renderer.finish(flush=False) for renderer in renderers]
    written = [{"vibration": files.waveform, "timeline": files.timeline} for files in outputs]
    for name, pipeline, renderer, files in zip(stems, pipelines, renderers, written, strict=True) if plot else ():
        files["figure"] = folder / f"{name}.replay.png"
        draw_recording(
            files["figure"],
            timeline=files["timeline"],
            microphones=renderer.microphones,
            vibration=renderer.vibration,
            title=f"{name}, replayed; model {pipeline.detector_name}, profile {pipeline.profile.name}",
        )
    return [RenderedFinger(*each) for each in zip(names, summaries, written, strict=True)]


def _complete(step: PipelineStep) -> PipelineStep:
    """Give each prediction a command, silence where there was none, and each block two channels."""
    samples = step.block.samples
    if samples.shape[1] == 1:
        step = replace(step, block=replace(step.block, samples=np.repeat(samples, 2, axis=1)))
    if len(step.commands) == len(step.predictions):
        return step
    silence = tuple(HapticCommand(0.0, Limits().lowest, prediction.end) for prediction in step.predictions)
    return replace(step, commands=silence)


class _TimeAxis:
    """Places the processes of a run after one another: each begins at 0 by its own count."""

    def __init__(self) -> None:
        self._offset = self._end = 0

    def restart(self) -> None:
        self._offset = self._end

    def place(self, replayed: ReplayedStep) -> PipelineStep:
        step, offset = replayed.step, self._offset
        shift = offset / step.block.sample_rate
        self._end = max(self._end, step.block.end + offset)
        if not offset:
            return step
        return PipelineStep(
            replace(step.block, start=step.block.start + offset),
            tuple(replace(each, start=each.start + shift, end=each.end + shift) for each in step.predictions),
            tuple(replace(each, time=each.time + shift) for each in step.commands),
            step.finger,
        )
