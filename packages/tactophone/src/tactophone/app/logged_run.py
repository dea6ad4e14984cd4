"""The run in a log: its settings, what its operator's end processed at each moment,
that end opened again, its sound.

The same endpoint gets the same packets at the same times, without network or clock.
Needs the link's libraries.
"""

import hashlib
import itertools
import json
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.hand import channels_of, each_finger, names_of, of_finger
from tactophone.core.processes import atomic_write, make_private
from tactophone.core.recordings.sound_file import create_long_wav
from tactophone.core.settings import FingerSettings, Settings, change, set_value
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray, PipelineStep
from tactophone.live.log.log_topics import topics_of
from tactophone.live.log.mcap import (
    LogEnd,
    LogEntry,
    LoggedPrediction,
    copied_log,
    read_log,
    read_messages,
)
from tactophone.live.log.sound import SoundMessages
from tactophone.live.runtime.output_gate import FingerOutput
from tactophone.live.telemetry.layout import Request
from tactophone.live.telemetry.records import Controls, EventBatch, RunStart
from tactophone.net.endpoints import OperatorEndpoint
from tactophone.net.link.events import Connected, LoggedSession
from tactophone.net.link.packet import Address
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.stream import DecodedAudio
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.perception.models import (
    default_model,
    model_path,
    shipped_models,
)
from tactophone.signal.pipeline import Hand, Pipeline, open_pipeline_for

Change = Callable[[Settings], Settings]

LONGEST_GAP = 1.0
"""Seconds without sound that are rendered as silence; a longer gap, such as a night, is
noted and left out."""

_NOWHERE: Address = ("", 0)
"""Where the datagrams of a log come from: a replay has no network."""

# Settings that a replay treats apart, by their dotted names.
_CALIBRATION = "detector.calibration"
_MODEL = "detector.model"
_CEILING = "rendering.ceiling"


@dataclass(slots=True)
class WakeUp:
    """What the end processed at one moment, and what was changed while it did."""

    time: float
    received: tuple[bytes, ...] = ()
    polled: tuple[bytes, ...] = ()
    changes: list[Controls] = field(default_factory=list)


LoggedItem = RunStart | Controls | WakeUp | LoggedPrediction | LogEnd


def wake_ups(entries: Iterable[LogEntry]) -> Iterator[LoggedItem]:
    """Put together the arrivals of each moment, and the changes during them; pass on
    everything else."""
    pending: WakeUp | None = None
    for entry in entries:
        match entry:
            case LoggedPrediction():
                yield entry  # written after what it was made of, so it ends nothing
            case Controls(step=step) if step and pending:
                pending.changes.append(entry)
            case EventBatch(time, events, polled=True) if (
                pending and time == pending.time and not pending.changes
            ):
                pending.polled = events
            case _:
                if pending:
                    yield pending
                    pending = None
                if isinstance(entry, EventBatch):
                    pending = WakeUp(
                        entry.time,
                        *((), entry.events) if entry.polled else (entry.events,),
                    )
                else:
                    yield entry
    if pending:
        yield pending


def _open_session() -> tuple[LoggedSession, ReceiveSession]:
    logged = LoggedSession()
    return logged, ReceiveSession(logged)


class LoggedEndpoint:
    """The operator's end of one logged process.

    ``change`` changes its settings: another model, another profile. Controls in the log
    then no longer set them. ``ceiling`` is the upper limit for the ceiling recorded in
    the log, because the log may come from a machine that allows more, or from anybody;
    ``lowered`` says whether the recorded ceiling was higher.
    ``notes`` say what differs here from the machine of the run.
    """

    def __init__(self, run: RunStart, change: Change, *, ceiling: float = 1.0) -> None:
        logged = settings_of(run)
        settings = change(logged)
        self.notes = list[str]()
        # What was chosen for the replay, finger by finger, stays as it is.
        self._chosen = [
            _differences(*pair)
            for pair in zip(each_finger(settings), each_finger(logged), strict=True)
        ]
        self.settings = _bounded(settings, ceiling)
        self.lowered = self.settings != settings
        own = each_finger(self.settings)
        names = dict.fromkeys(
            each.detector.model or default_model(each.capture.tip) for each in own
        )
        for name in names if settings.detector.model == logged.detector.model else ():
            with model_path(name).open("rb") as file:
                if hashlib.file_digest(file, "sha256").hexdigest() != run.models.get(
                    name
                ):
                    self.notes.append(
                        f"the model {name} here is not the one that the run used"
                    )
        self._calibrations = [finger["calibration"] for finger in run.fingers] or [""]
        self._session, session = _open_session()
        channels = channels_of(self.settings, alone=2)
        hand = Hand(
            [self.open(count, finger=finger) for finger, count in enumerate(channels)],
            channels=channels,
        )
        self.endpoint = OperatorEndpoint(
            session, hand, reopen=None if self.settings.is_hand else self.open
        )
        # The renderers stand for actuators: a replay moves nothing but numbers.
        self._outputs = [
            FingerOutput(
                each,
                Oscillator(Limits(ceiling=each.rendering.ceiling)),
                self.endpoint,
                index=index,
            )
            for index, each in enumerate(own)
        ]

    def open(self, channels: int, *, finger: int = 0) -> Pipeline:
        """Open the pipeline of a finger for this number of channels, with the
        calibration that the log holds."""
        settings = of_finger(self.settings, finger)
        with TemporaryDirectory(prefix="tactophone-") as folder:
            if self._calibrations[finger]:
                path = Path(folder, "calibration.json")
                path.write_text(self._calibrations[finger], encoding="utf-8")
                settings = change(settings, [f"{_CALIBRATION}={path}"])
            return open_pipeline_for(settings, channels=channels)

    def process(self, wake_up: WakeUp) -> Iterator[tuple[PipelineStep, bool]]:
        """Process one moment again; returns its steps, with commands as limited and
        gated.

        Beside each, whether it is certain: where a control changed while a step was
        computed, the log cannot say whether that was before its command or after.
        """
        datagrams = [(content, _NOWHERE) for content in wake_up.received]
        self._session.polled = list(wake_up.polled)
        steps = itertools.chain(
            self.endpoint.receive(datagrams, now=wake_up.time),
            self.endpoint.poll(wake_up.time),
        )
        for number, (_, step) in enumerate(steps, 1):
            changes = [
                controls for controls in wake_up.changes if controls.step == number
            ]
            if step is not None:
                yield self._outputs[step.finger].submit(step), not changes
            for controls in changes:
                self.apply(controls)

    def apply(self, controls: Controls) -> None:
        """Set what somebody changed during the run; what was chosen for the replay
        stays.

        Raises `DatasetError` if the run does not have that finger.
        """
        if not 0 <= controls.finger < len(self._outputs):
            raise DatasetError(
                f"controls of finger {controls.finger}, but the run has "
                f"{len(self._outputs)}: a changed log"
            )
        output = self._outputs[controls.finger]
        chosen = self._chosen[controls.finger]
        requests = [
            Request("arm" if controls.armed else "mute"),
            Request("output_level", controls.output_level),
        ]
        if "ceiling" not in chosen:
            requests.append(
                Request("ceiling", min(controls.ceiling, output.gate.local_ceiling))
            )
        if "profile" not in chosen and output.pipeline.profile.name != controls.profile:
            requests.append(Request("profile", text=controls.profile))
        # Without a threshold in the log the pipeline follows the noise floor, as it did
        # in the run; to assign one would end that.
        threshold_dbfs = controls.threshold_dbfs
        if "detector" not in chosen and threshold_dbfs not in (
            None,
            output.pipeline.detector.threshold.dbfs,
        ):
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
    """Return the settings of a logged process; raises `ConfigError` if they name what
    this version does not know."""
    tables = {
        f"{section}.{name}": value
        for section, table in run.settings.items()
        for name, value in table.items()
    }
    settings = _with(Settings(), tables)
    fingers: list[FingerSettings] = []
    for finger in run.fingers:
        own = {
            name: value
            for name, value in finger["settings"].items()
            if name != _CALIBRATION and value is not None
        }
        _with(settings, own)  # checked here, where the log can be named
        fingers.append(FingerSettings(finger["name"], tuple(own.items())))
    return replace(settings, fingers=tuple(fingers) or settings.fingers)


def _with(settings: Settings, values: dict[str, Any]) -> Settings:
    for name, value in values.items():
        # None stands for NaN, which is the default where it may occur; the text of the
        # calibration is in the log.
        if value is None or name == _CALIBRATION:
            continue
        if isinstance(value, str):
            _check_text(name, value)
        settings = set_value(settings, name, value, where="the log")
    return settings


def _check_text(name: str, value: str) -> None:
    """Raise `ConfigError` for a text that no run has as a setting: whatever is not of
    the setting's type, the setting itself refuses."""
    if not value.isprintable():
        raise ConfigError(
            f"the log: {name} = {value!r} holds what is no text; was the log changed?"
        )
    known = ("", *shipped_models())
    if name == _MODEL and value not in known and Path(value).suffix != ".onnx":
        raise ConfigError(
            f"the log: {name} = {value!r}, but a model is shipped or a file that "
            "ends in .onnx"
        )


def _bounded(settings: Settings, ceiling: float) -> Settings:
    """Return settings with no ceiling above this one."""
    rendering = replace(
        settings.rendering, ceiling=min(settings.rendering.ceiling, ceiling)
    )
    fingers = (
        FingerSettings(
            each.name,
            tuple(
                (name, min(own, ceiling) if name == _CEILING else own)
                for name, own in each.settings
            ),
        )
        for each in settings.fingers
    )
    return replace(settings, rendering=rendering, fingers=tuple(fingers))


class SoundDecoder:
    """Decodes the sound of a log as it comes: ``push`` takes its next entries."""

    def __init__(self) -> None:
        self._logged, self._session = _open_session()

    def push(self, entries: Iterable[LogEntry]) -> Iterator[AudioBlock | Connected]:
        """Yield the blocks of sound, and where another session begins."""
        for item in wake_ups(entries):
            if isinstance(item, RunStart):
                self._logged, self._session = _open_session()
            if not isinstance(item, WakeUp):
                continue
            self._logged.polled = list(item.polled)
            events = self._session.receive(
                [(content, _NOWHERE) for content in item.received], now=item.time
            )
            for event in [*events, *self._session.poll(item.time)]:
                match event:
                    case DecodedAudio(block):
                        yield block
                    case Connected():
                        yield event


def decoded_blocks(entries: Iterable[LogEntry]) -> Iterator[tuple[int, AudioBlock]]:
    """Yield the blocks of sound in a log, each with the number of its session; a gap
    over `LONGEST_GAP` begins one."""
    number = 0
    reached = None
    for item in SoundDecoder().push(entries):
        if not isinstance(item, AudioBlock):
            reached = None
            continue
        if (
            reached is None
            or not 0 <= item.start - reached <= LONGEST_GAP * LIVE_SAMPLE_RATE
        ):
            number += 1
        reached = item.end
        yield number, item


@dataclass(frozen=True, slots=True)
class SessionSound:
    """The sound of one session of a log, counted from 1, at one finger; its name is
    empty for the only one."""

    path: Path
    session: int
    finger: str = ""


def write_sound(log: Path, folder: Path, *, finger: str = "") -> list[SessionSound]:
    """Write the sound of each session and finger, or of one, as WAV with 32-bit floats,
    which hold it exactly.

    Gaps too long to be concealed are silence; over `LONGEST_GAP` another file begins.
    Raises `DatasetError` if the log has no such finger or no sound: a link may carry
    predictions only.
    """
    start = next(
        (entry for entry in read_log(log) if isinstance(entry, RunStart)),
        RunStart(role=""),
    )
    settings = settings_of(start)
    names = names_of(settings)
    channels = channels_of(settings, alone=2)
    if finger and finger not in names:
        known = (
            f"there are {', '.join(names)}"
            if any(names)
            else "it has a single, unnamed finger"
        )
        raise DatasetError(f"{log}: no finger {finger!r} in this log; {known}")
    written: list[SessionSound] = []
    for number, group in itertools.groupby(
        decoded_blocks(read_log(log)), key=lambda each: each[0]
    ):
        blocks = (block for _, block in group)
        first = next(blocks)
        if max(1, first.channels // 2) != len(names):
            # The sound of a robot with another number of fingers, which the operator
            # refused.
            continue
        with ExitStack() as stack:
            files = []
            for place, (name, count) in enumerate(zip(names, channels, strict=True)):
                if finger in ("", name):
                    parts = (log.stem, name, "" if number == 1 else str(number))
                    path = folder / f"{'-'.join(filter(None, parts))}.wav"
                    columns = slice(2 * place, min(2 * place + count, first.channels))
                    size = columns.stop - columns.start
                    unfinished = stack.enter_context(atomic_write(path))
                    make_private(unfinished)  # as the log is
                    file = create_long_wav(
                        unfinished,
                        sample_rate=LIVE_SAMPLE_RATE,
                        channels=size,
                        subtype="FLOAT",
                    )
                    files.append((stack.enter_context(file), columns))
                    written.append(SessionSound(path, number, name))
            for samples in _without_gaps(itertools.chain([first], blocks)):
                for file, columns in files:
                    file.write(samples[:, columns])
    if not written:
        raise DatasetError(
            f"{log}: no sound in it; was it recorded with predictions sent in place of "
            "sound?"
        )
    return written


def _without_gaps(blocks: Iterable[AudioBlock]) -> Iterator[FloatArray]:
    """Yield the samples of blocks with silence between them where some are missing, all
    with as many channels."""
    reached = channels = 0
    for block in blocks:
        channels = channels or block.channels
        if reached and block.start > reached:
            yield np.zeros((block.start - reached, channels), np.float32)
        reached = block.end
        yield (
            block.samples
            if block.channels == channels
            else np.repeat(block.samples, channels, axis=1)[:, :channels]
        )


def add_sound(log: Path, path: Path) -> Path:
    """Copy a log and add its sound as topics that Foxglove plays: Opus as it came, or
    samples of 16 bits.

    Raises `DatasetError` if the log cannot be read, and `ConfigError` if the copy
    cannot be written.
    """
    start = next(
        (entry for entry in read_log(log) if isinstance(entry, RunStart)),
        RunStart(role=""),
    )
    names = names_of(settings_of(start))
    if path.exists() and path.samefile(log):
        raise ConfigError(f"{path}: the log itself; name another file")
    sound = SoundMessages(names)
    try:
        with copied_log(path, topics_of(names, sound=True)) as copy:
            for message in read_messages(log):
                if isinstance(message, LogEnd):
                    added = sound.flush()
                else:
                    added = sound.push(message.topic.name, message.data)
                    copy.write(message)
                for each in added:
                    copy.write(each)
    except ValueError as error:
        raise DatasetError(
            f"{log}: a message cannot be read ({error}); was the file changed?"
        ) from error
    except OSError as error:
        raise ConfigError(
            f"cannot write {path} ({error.strerror}): choose another file for --audio"
        ) from error
    return path


def repair_log(log: Path, path: Path) -> int:
    """Copy what can be read of a log whose recorder was killed to a file with an index
    and an end, as other programs ask for; return the number of messages.

    Raises `DatasetError` if the log cannot be read, and `ConfigError` if the copy
    cannot be written, or would overwrite the log.
    """
    if path.exists() and path.samefile(log):
        raise ConfigError(f"--repair {path}: the log itself; name another file")
    # Read twice, as the writer asks for all topics before the first message.
    topics = {
        message.topic.name: message.topic
        for message in read_messages(log)
        if not isinstance(message, LogEnd)
    }
    count = 0
    try:
        with copied_log(path, list(topics.values())) as copy:
            for message in read_messages(log):
                if isinstance(message, LogEnd):
                    copy.metadata["missed"] = json.dumps(dict(message.missed))
                else:
                    copy.write(message)
                    count += 1
    except OSError as error:
        raise ConfigError(
            f"cannot write {path} ({error.strerror}): choose another file for --repair"
        ) from error
    return count
