"""A logged run, once more: the same endpoint from the same packets at the same times, without network or clock."""

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

from tactophone.bridges import LogEnd, LogEntry, LoggedPrediction
from tactophone.endpoints import OperatorEndpoint
from tactophone.errors import DatasetError
from tactophone.hand import channels_of, each_finger
from tactophone.haptics import PASSTHROUGH, GateProfile, open_profile
from tactophone.link import Address, LoggedSession, ReceiveEvent, ReceiveSession, Session
from tactophone.perception import model_path
from tactophone.pipeline import Hand, Pipeline
from tactophone.runtime import OutputGate, open_pipeline_for
from tactophone.settings import Finger, Settings, change, set_value
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
    """The operator's end of one logged process."""

    run: RunStart
    """How it was started."""
    change: Change = lambda settings: settings
    """Changes its settings: another model, another profile. Controls in the log then no longer set the profile."""
    notes: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        logged = settings_of(self.run)
        self.settings = self.change(logged)
        self._check_models(logged)
        calibrations = [finger["calibration"] for finger in self.run.fingers] or [self.run.calibration]
        fingers = zip(each_finger(self.settings), each_finger(logged), calibrations, strict=True)
        self.fingers = [_LoggedFinger(own, before, calibration) for own, before, calibration in fingers]
        self._session = LoggedSession()
        session = ReceiveSession(cast(Session, self._session))
        if self.settings.fingers:
            channels = channels_of(self.settings, alone=2)
            pipelines = [finger.open(count) for finger, count in zip(self.fingers, channels, strict=True)]
            self.endpoint = OperatorEndpoint(session, Hand(pipelines, channels=channels))
        else:
            only = self.fingers[0]
            self.endpoint = OperatorEndpoint(session, only.open(2), reopen=only.open)

    def process(self, wake_up: WakeUp) -> Iterator[ReplayedStep]:
        """Process one moment again; returns its steps."""
        datagrams = [(content, _NOWHERE) for content in wake_up.received]
        self._session.polled = list(wake_up.polled)
        steps = itertools.chain(self.endpoint.receive(datagrams, now=wake_up.time), self.endpoint.poll(wake_up.time))
        for number, (event, step) in enumerate(steps, 1):
            changes = [controls for controls in wake_up.changes if controls.step == number]
            if step is not None:
                bound = self.fingers[step.finger].gate.bound
                bounded = tuple(replace(command, amplitude=bound(command.amplitude)) for command in step.commands)
                yield ReplayedStep(event, replace(step, commands=bounded), certain=not changes)
            for controls in changes:
                self.apply(controls)

    def apply(self, controls: Controls) -> None:
        """Set what somebody changed during the run; what was chosen for the replay stays.

        Raises `DatasetError` if they are of a finger that the run does not have.
        """
        if not 0 <= controls.finger < len(self.fingers):
            raise DatasetError(
                f"controls of finger {controls.finger}, but the run has {len(self.fingers)}: a changed log"
            )
        self.fingers[controls.finger].apply(controls, self.endpoint.hand.pipelines[controls.finger])

    def _check_models(self, logged: Settings) -> None:
        if self.settings.detector.model != logged.detector.model:
            return
        for name, digest in self.run.models.items():
            if hashlib.sha256(model_path(name).read_bytes()).hexdigest() != digest:
                self.notes.append(f"the model {name} here is not the one that the run used")


class _LoggedFinger:
    """One finger, or the only one: its gate, and which of its settings were chosen for the replay."""

    def __init__(self, settings: Settings, logged: Settings, calibration: str) -> None:
        self._settings, self._calibration = settings, calibration
        rendering = settings.rendering
        self.gate = OutputGate(ceiling=rendering.ceiling, output_level=rendering.output_level)
        self._fixed_profile = rendering.profile != logged.rendering.profile
        self._fixed_detector = settings.detector != logged.detector
        self._fixed_ceiling = rendering.ceiling != logged.rendering.ceiling

    def open(self, channels: int) -> Pipeline:
        """Open its pipeline, with the calibration that the log holds."""
        if not self._calibration:
            return open_pipeline_for(self._settings, channels=channels)
        with TemporaryDirectory(prefix="tactophone-") as folder:
            path = Path(folder, "calibration.json")
            path.write_text(self._calibration)
            settings = change(self._settings, [f"detector.calibration={path}"])
            return open_pipeline_for(settings, channels=channels)

    def apply(self, controls: Controls, pipeline: Pipeline) -> None:
        """Set what somebody changed, as far as it was not chosen for the replay."""
        gate = self.gate
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


def settings_of(run: RunStart) -> Settings:
    """Return the settings of a logged process; raises `ConfigError` if they name what this version does not know."""
    settings = Settings()
    for section, table in run.settings.items():
        for name, value in table.items():
            settings = _with(settings, f"{section}.{name}", value)
    fingers = []
    for finger in run.fingers:
        own = {name: value for name, value in finger["settings"].items() if name != _CALIBRATION and value is not None}
        for name, value in own.items():
            _with(settings, name, value)  # checked here, where the log can be named
        fingers.append(Finger(finger["name"], tuple(own.items())))
    return replace(settings, fingers=tuple(fingers))


_CALIBRATION = "detector.calibration"


def _with(settings: Settings, name: str, value: Any) -> Settings:
    # None stands for NaN, which is the default where it may occur; the text of the calibration is in the log.
    if value is None or name == _CALIBRATION:
        return settings
    return set_value(settings, name, value, where="the log")
