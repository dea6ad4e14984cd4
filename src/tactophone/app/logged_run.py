"""The run in a log: its settings, what its operator's end processed at each moment, and that end, opened again.

The same endpoint gets the same packets at the same times, without network or clock. Needs the link's libraries.
"""

import hashlib
import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, cast

from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.hand import channels_of, each_finger, of_finger
from tactophone.core.settings import Finger, Settings, change, set_value
from tactophone.core.types import PipelineStep
from tactophone.live.log.mcap import LogEnd, LogEntry, LoggedPrediction
from tactophone.live.runtime.output_gate import FingerOutput
from tactophone.live.runtime.wiring import open_pipeline_for
from tactophone.live.telemetry.layout import Request
from tactophone.live.telemetry.records import Controls, EventBatch, RunStart
from tactophone.net.endpoints import OperatorEndpoint
from tactophone.net.link.events import LoggedSession
from tactophone.net.link.packet import Address
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.session import Session
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.perception.models import default_model, model_path, shipped_models
from tactophone.signal.pipeline import Hand, Pipeline

Change = Callable[[Settings], Settings]

NOWHERE: Address = ("", 0)
"""Where the packets of a log come from."""

_CALIBRATION, _MODEL, _CEILING = "detector.calibration", "detector.model", "rendering.ceiling"


@dataclass(slots=True)
class WakeUp:
    """What the end processed at one moment, and what was changed while it did."""

    time: float
    received: tuple[bytes, ...] = ()
    polled: tuple[bytes, ...] = ()
    changes: list[Controls] = field(default_factory=list)


LoggedItem = RunStart | Controls | WakeUp | LoggedPrediction | LogEnd


def wake_ups(entries: Iterable[LogEntry]) -> Iterator[LoggedItem]:
    """Put together the arrivals of each moment, and the changes during them; pass on everything else."""
    pending: WakeUp | None = None
    for entry in entries:
        match entry:
            case LoggedPrediction():
                yield entry  # written after what it was made of, so it ends nothing
            case Controls(step=step) if step and pending:
                pending.changes.append(entry)
            case EventBatch(time, events, polled=True) if pending and time == pending.time and not pending.changes:
                pending.polled = events
            case _:
                if pending:
                    yield pending
                    pending = None
                if isinstance(entry, EventBatch):
                    pending = WakeUp(entry.time, *((), entry.events) if entry.polled else (entry.events,))
                else:
                    yield entry
    if pending:
        yield pending


def open_session() -> tuple[LoggedSession, ReceiveSession]:
    logged = LoggedSession()
    return logged, ReceiveSession(cast(Session, logged))


class LoggedEndpoint:
    """The operator's end of one logged process.

    ``change`` changes its settings: another model, another profile. Controls in the log then no longer set them.
    ``ceiling`` bounds that of the log, which may come from a machine that allows more, or from anybody; ``lowered``
    says whether it did. ``notes`` say what differs here from the machine of the run.
    """

    def __init__(self, run: RunStart, change: Change, *, ceiling: float = 1.0) -> None:
        logged = settings_of(run)
        settings, self.notes = change(logged), list[str]()
        # What was chosen for the replay, finger by finger, stays as it is.
        self._chosen = [_differences(*pair) for pair in zip(each_finger(settings), each_finger(logged), strict=True)]
        self.settings = _bounded(settings, ceiling)
        self.lowered = self.settings != settings
        own = each_finger(self.settings)
        names = dict.fromkeys(each.detector.model or default_model(each.capture.tip) for each in own)
        for name in names if settings.detector.model == logged.detector.model else ():
            with model_path(name).open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != run.models.get(name):
                    self.notes.append(f"the model {name} here is not the one that the run used")
        self._calibrations = [finger["calibration"] for finger in run.fingers] or [""]
        self._session, session = open_session()
        channels = channels_of(self.settings, alone=2)
        hand = Hand([self.open(count, finger=finger) for finger, count in enumerate(channels)], channels=channels)
        self.endpoint = OperatorEndpoint(session, hand, reopen=None if self.settings.is_hand else self.open)
        # The renderers stand for actuators: a replay moves nothing but numbers.
        self._outputs = [
            FingerOutput(each, Oscillator(Limits(ceiling=each.rendering.ceiling)), self.endpoint, index=index)
            for index, each in enumerate(own)
        ]

    def open(self, channels: int, *, finger: int = 0) -> Pipeline:
        """Open the pipeline of a finger for this number of channels, with the calibration that the log holds."""
        settings = of_finger(self.settings, finger)
        with TemporaryDirectory(prefix="tactophone-") as folder:
            if self._calibrations[finger]:
                path = Path(folder, "calibration.json")
                path.write_text(self._calibrations[finger], encoding="utf-8")
                settings = change(settings, [f"{_CALIBRATION}={path}"])
            return open_pipeline_for(settings, channels=channels)

    def process(self, wake_up: WakeUp) -> Iterator[tuple[PipelineStep, bool]]:
        """Process one moment again; returns its steps, with commands as limited and gated.

        Beside each, whether it is certain: where a control changed while a step was computed, the log cannot say
        whether that was before its command or after.
        """
        datagrams = [(content, NOWHERE) for content in wake_up.received]
        self._session.polled = list(wake_up.polled)
        steps = itertools.chain(self.endpoint.receive(datagrams, now=wake_up.time), self.endpoint.poll(wake_up.time))
        for number, (_, step) in enumerate(steps, 1):
            changes = [controls for controls in wake_up.changes if controls.step == number]
            if step is not None:
                yield self._outputs[step.finger].submit(step), not changes
            for controls in changes:
                self.apply(controls)

    def apply(self, controls: Controls) -> None:
        """Set what somebody changed during the run; what was chosen for the replay stays.

        Raises `DatasetError` if they are of a finger that the run does not have.
        """
        if not 0 <= controls.finger < len(self._outputs):
            raise DatasetError(
                f"controls of finger {controls.finger}, but the run has {len(self._outputs)}: a changed log"
            )
        output, chosen = self._outputs[controls.finger], self._chosen[controls.finger]
        requests = [Request("arm" if controls.armed else "mute"), Request("output_level", controls.output_level)]
        if "ceiling" not in chosen:
            requests.append(Request("ceiling", min(controls.ceiling, output.gate.local_ceiling)))
        if "profile" not in chosen and output.pipeline.profile.name != controls.profile:
            requests.append(Request("profile", text=controls.profile))
        # Without a threshold in the log the pipeline follows the noise floor, as it did in the run; to assign one would
        # end that.
        threshold_dbfs = controls.threshold_dbfs
        if "detector" not in chosen and threshold_dbfs not in (None, output.pipeline.detector.threshold.dbfs):
            requests.append(Request("threshold_dbfs", threshold_dbfs))
        output.apply(requests)


def _differences(settings: Settings, logged: Settings) -> set[str]:
    pairs = {
        "ceiling": (settings.rendering.ceiling, logged.rendering.ceiling),
        "profile": (settings.rendering.profile, logged.rendering.profile),
        "detector": (settings.detector, logged.detector),
    }
    return {name for name, (chosen, before) in pairs.items() if chosen != before}


def settings_of(run: RunStart) -> Settings:
    """Return the settings of a logged process; raises `ConfigError` if they name what this version does not know."""
    tables = {f"{section}.{name}": value for section, table in run.settings.items() for name, value in table.items()}
    settings = _with(Settings(), tables)
    fingers: list[Finger] = []
    for finger in run.fingers:
        own = {name: value for name, value in finger["settings"].items() if name != _CALIBRATION and value is not None}
        _with(settings, own)  # checked here, where the log can be named
        fingers.append(Finger(finger["name"], tuple(own.items())))
    return replace(settings, fingers=tuple(fingers) or settings.fingers)


def _with(settings: Settings, values: dict[str, Any]) -> Settings:
    for name, value in values.items():
        # None stands for NaN, which is the default where it may occur; the text of the calibration is in the log.
        if value is None or name == _CALIBRATION:
            continue
        if isinstance(value, str) and not value.isprintable():
            raise ConfigError(f"the log: {name} = {value!r} holds what is no text; was the log changed?")
        if name == _MODEL and value and value not in shipped_models() and Path(value).suffix != ".onnx":
            raise ConfigError(f"the log: {name} = {value!r}, but a model is shipped or a file that ends in .onnx")
        settings = set_value(settings, name, value, where="the log")
    return settings


def _bounded(settings: Settings, ceiling: float) -> Settings:
    """Return settings with no ceiling above this one."""
    rendering = replace(settings.rendering, ceiling=min(settings.rendering.ceiling, ceiling))
    fingers = (
        Finger(each.name, tuple((name, min(own, ceiling) if name == _CEILING else own) for name, own in each.settings))
        for each in settings.fingers
    )
    return replace(settings, rendering=rendering, fingers=tuple(fingers))
