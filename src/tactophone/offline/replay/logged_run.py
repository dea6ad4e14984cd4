"""A logged run, once more: the same endpoint from the same packets at the same times, without network or clock."""

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import cast

from tactophone import config
from tactophone.bridges import LogEnd, LogEntry, LoggedPrediction
from tactophone.config import Settings
from tactophone.endpoints import OperatorEndpoint
from tactophone.errors import DatasetError
from tactophone.haptics import PASSTHROUGH, GateProfile, open_profile
from tactophone.link import Address, LoggedSession, ReceiveEvent, ReceiveSession, Session
from tactophone.perception import model_path
from tactophone.pipeline import Pipeline
from tactophone.runtime import OutputGate, open_pipeline_for
from tactophone.telemetry import Controls, EventBatch, RunStart
from tactophone.types import PipelineStep

_NOWHERE: Address = ("", 0)

Change = Callable[[Settings], Settings]


@dataclass(frozen=True, slots=True)
class WakeUp:
    """What the end processed at one moment, and what was changed while it did."""

    time: float
    received: tuple[bytes, ...] = ()
    polled: tuple[bytes, ...] = ()
    changes: tuple[Controls, ...] = ()


@dataclass(frozen=True, slots=True)
class ReplayedStep:
    """A step computed again, its commands as limited and gated.

    ``certain`` is false where a control changed while the step was computed: before or after its command, the log
    cannot say.
    """

    event: ReceiveEvent
    step: PipelineStep
    certain: bool = True


LoggedItem = RunStart | Controls | WakeUp | LoggedPrediction | LogEnd


def wake_ups(entries: Iterable[LogEntry]) -> Iterator[LoggedItem]:
    """Put together the arrivals of each moment, and the changes during them; pass on everything else."""
    pending: WakeUp | None = None
    for entry in entries:
        match entry:
            case EventBatch(time, events, polled):
                joins = pending is not None and polled and time == pending.time and not pending.changes
                if pending is not None and not joins:
                    yield pending
                    pending = None
                pending = pending or WakeUp(time)
                pending = replace(pending, polled=events) if polled else replace(pending, received=events)
            case Controls(step=step) if step and pending is not None:
                pending = replace(pending, changes=(*pending.changes, entry))
            case _:
                # Predictions are written after what they were made of, so they end nothing.
                if pending is not None and not isinstance(entry, LoggedPrediction):
                    yield pending
                    pending = None
                yield entry
    if pending is not None:
        yield pending


@dataclass
class LoggedEndpoint:
    """The operator's end of one logged process.

    Parameters
    ----------
    run
        How it was started.
    change
        Changes its settings: another model, another profile. Controls in the log then no longer set the profile.
    """

    run: RunStart
    change: Change = lambda settings: settings
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        if self.run.fingers:
            raise DatasetError(
                f"a log of a hand of {len(self.run.fingers)} fingers, but replay computes runs of one finger only; "
                "its packets, settings and events are in the file"
            )
        logged = settings_of(self.run)
        self.settings = self.change(logged)
        self._fixed_profile = self.settings.rendering.profile != logged.rendering.profile
        self._fixed_detector = self.settings.detector != logged.detector
        self._fixed_ceiling = self.settings.rendering.ceiling != logged.rendering.ceiling
        self._session = LoggedSession()
        rendering = self.settings.rendering
        self.gate = OutputGate(ceiling=rendering.ceiling, output_level=rendering.output_level)
        self.endpoint = OperatorEndpoint(ReceiveSession(cast(Session, self._session)), self._open(2), reopen=self._open)
        self._check_models(logged)

    def process(self, wake_up: WakeUp) -> Iterator[ReplayedStep]:
        """Process one moment again; returns its steps."""
        datagrams = [(content, _NOWHERE) for content in wake_up.received]
        self._session.polled = list(wake_up.polled)
        steps = itertools.chain(self.endpoint.receive(datagrams, now=wake_up.time), self.endpoint.poll(wake_up.time))
        for number, (event, step) in enumerate(steps, 1):
            changes = [controls for controls in wake_up.changes if controls.step == number]
            if step is not None:
                bounded = tuple(
                    replace(command, amplitude=self.gate.bound(command.amplitude)) for command in step.commands
                )
                yield ReplayedStep(event, replace(step, commands=bounded), certain=not changes)
            for controls in changes:
                self.apply(controls)

    def apply(self, controls: Controls) -> None:
        """Set what somebody changed during the run; what was chosen for the replay stays."""
        gate, pipeline = self.gate, self.endpoint.pipeline
        # A replay moves nothing but numbers, so it may be armed without anyone at the machine.
        gate.muted_because = "" if controls.armed else "muted in the log"
        gate.output_level = controls.output_level
        if not self._fixed_ceiling:
            gate.ceiling = controls.ceiling
            if pipeline.limits.ceiling != controls.limit:
                pipeline.limits = replace(pipeline.limits, ceiling=controls.limit)
        if not self._fixed_profile and pipeline.profile.name != controls.profile:
            pipeline.profile = (
                GateProfile(controls.profile) if controls.profile in PASSTHROUGH else open_profile(controls.profile)
            )
        # Without a threshold in the log the pipeline follows the noise floor, as it did in the run; to assign one would
        # end that.
        threshold_dbfs = controls.threshold_dbfs
        if not self._fixed_detector and threshold_dbfs is not None and pipeline.threshold_dbfs != threshold_dbfs:
            pipeline.threshold_dbfs = threshold_dbfs

    def _open(self, channels: int) -> Pipeline:
        if not self.run.calibration:
            return open_pipeline_for(self.settings, channels=channels)
        with TemporaryDirectory(prefix="tactophone-") as folder:
            path = Path(folder, "calibration.json")
            path.write_text(self.run.calibration)
            return open_pipeline_for(config.change(self.settings, [f"detector.calibration={path}"]), channels=channels)

    def _check_models(self, logged: Settings) -> None:
        if self.settings.detector.model != logged.detector.model:
            return
        for name, digest in self.run.models.items():
            if hashlib.sha256(model_path(name).read_bytes()).hexdigest() != digest:
                self.notes.append(f"the model {name} here is not the one that the run used")


def settings_of(run: RunStart) -> Settings:
    """Return the settings of a logged process.

    Raises
    ------
    ConfigError
        If they name what this version does not know.
    """
    settings = Settings()
    for section, table in run.settings.items():
        for name, value in table.items():
            # None stands for NaN, which is the default where it may occur.
            if value is not None and name != "calibration":
                settings = config.replace(settings, f"{section}.{name}", value, where="the log")
    return settings
