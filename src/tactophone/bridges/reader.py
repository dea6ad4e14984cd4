"""What is new in a run: as messages for a log and a live view, or the newest prediction for buses and middleware."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import msgspec

from tactophone.bridges import topics
from tactophone.bridges.topics import Message, of_finger
from tactophone.telemetry.layout import FingerState, State
from tactophone.telemetry.records import EventBatch, RunStart, read_records
from tactophone.telemetry.watcher import Watcher
from tactophone.types import PREDICTION_FIELDS, HapticCommand, Prediction, Touch, prediction_of

HEALTH_INTERVAL = 5.0
"""Seconds between two messages with counters and gauges."""

SETTLED_DB = 1.0
"""Less than this is no change of a threshold's."""

SILENCE = 0.1
"""Seconds without a new prediction after which a finger counts as silent: a run that ends leaves nothing vibrating."""

_INFO, _WARNING = 2, 3


def entries_of(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return a prediction and its command by name, exactly; ``None`` for NaN and infinity, which JSON does not have."""
    numbers = {field.name: field.of(prediction, command) for field in PREDICTION_FIELDS}
    entries: dict[str, Any] = {name: value if math.isfinite(value) else None for name, value in numbers.items()}
    event = prediction.events[-1].kind if prediction.events else ""
    return entries | {"touch": prediction.touch.name.lower(), "contact": int(entries["contact"]), "event": event}


class RunReader:
    """Reads a run, and the processes that replace it, as messages.

    Attributes
    ----------
    missed
        Predictions and bytes of the session log that were overwritten before they were read.
    names
        Of the fingers of a hand; one empty name where there is no hand.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.missed = {"predictions": 0, "log": 0}
        self.watcher = Watcher(name)
        self._begin()

    def read(self) -> list[Message]:
        """Return all messages since the last call, oldest first within each topic."""
        if self.watcher.follow():
            self._begin()
        now = self._now()
        return [*self._session(), *self._predictions(now), *self._state(now), *self._health(now)]

    def _begin(self) -> None:
        """Read a process from its beginning."""
        watcher = self.watcher
        self.names = watcher.finger_names()
        self._log_count, self._prediction_counts = 0, [0] * watcher.fingers
        self._epoch = time.time() - time.monotonic()
        self._lead = math.inf
        self._partial: tuple[bytes, ...] = ()
        self._settled = State(fingers=(FingerState(),) * watcher.fingers)
        self._health_at = 0.0

    def _now(self) -> float:
        """Return the time of the day, in s, by a clock that is never set: the one that stamps the packets."""
        return self._epoch + time.monotonic()

    def _session(self) -> Iterator[Message]:
        log, count = self.watcher.log(self._log_count)
        if len(log) < count - self._log_count:
            self.missed["log"] += count - self._log_count
            log = b""
            yield self._event(self._now(), "part of the session was not read in time: no replay beyond", _WARNING)
        self._log_count = count
        arrivals: list[EventBatch] = []
        for record in read_records(log):
            if isinstance(record, EventBatch):
                # Arrivals that were too long for one record are put together.
                events = self._partial + record.events
                self._partial = events if record.more else ()
                if not record.more:
                    arrivals.append(replace(record, events=events))
                continue
            # Packets and controls keep their order in the file, as their order decides about the replay.
            yield from self._packets(arrivals)
            arrivals = []
            if isinstance(record, RunStart):
                self._epoch = record.epoch
            topic = topics.RUN if isinstance(record, RunStart) else topics.CONTROLS
            yield Message(topic, self._now(), msgspec.json.encode(record))
        yield from self._packets(arrivals)

    def _packets(self, arrivals: list[EventBatch]) -> Iterator[Message]:
        if arrivals:
            data = msgspec.json.encode(topics.Packets(arrivals))
            yield Message(topics.PACKETS, self._epoch + arrivals[-1].time, data)

    def _predictions(self, now: float) -> Iterator[Message]:
        for finger, name in enumerate(self.names):
            topic = of_finger(topics.PREDICTION, finger, name)
            rows, count = self.watcher.predictions(self._prediction_counts[finger], finger=finger)
            missed = count - self._prediction_counts[finger] - len(rows)
            if missed > 0:
                self.missed["predictions"] += missed
                yield self._event(now, f"{missed} predictions were not read in time", _WARNING)
            self._prediction_counts[finger] = count
            if len(rows):
                # A prediction carries the time of its stream. The least delay seen until it was read turns that into
                # the time of the day, evenly, where the time of reading would be a staircase.
                self._lead = min(self._lead, now - float(rows["window_end"][-1]))
            for row in rows:
                prediction, command = prediction_of(row)
                data = msgspec.json.encode(entries_of(prediction, command))
                yield Message(topic, self._lead + prediction.end, data)

    def _state(self, now: float) -> Iterator[Message]:
        state, before = self.watcher.state(), self._settled
        if len(state.fingers) != len(before.fingers):  # none is published yet
            return
        fingers = zip(state.fingers, before.fingers, strict=True)
        settled = replace(state, fingers=tuple(_settle(*finger) for finger in fingers))
        if settled == before:
            return
        self._settled = settled
        entries = {**msgspec.to_builtins(state), "armed": state.armed, "muted_because": state.muted_because}
        yield Message(topics.STATE, now, msgspec.json.encode(entries))
        for name, *own in zip(self.names, before.fingers, settled.fingers, strict=True):
            of = f"{name}: " if name else ""
            for text in _changes(*own):
                yield self._event(now, f"{of}{text}", _INFO)
        if before.link != state.link:
            yield self._event(now, f"link: {state.link}", _INFO)
        known = {fault.code: fault.text for fault in before.faults}
        for fault in state.faults:
            if known.get(fault.code) != fault.text:
                yield self._event(now, fault.text, _WARNING)

    def _health(self, now: float) -> Iterator[Message]:
        if now - self._health_at >= HEALTH_INTERVAL:
            self._health_at = now
            yield Message(topics.HEALTH, now, msgspec.json.encode(topics.Totals(*self.watcher.totals())))

    def _event(self, now: float, text: str, level: int) -> Message:
        stamp = topics.Stamp(int(now), int(now % 1 * 1e9))
        return Message(topics.EVENTS, now, msgspec.json.encode(topics.Event(stamp, level, text, self.name)))


def _settle(now: FingerState, before: FingerState) -> FingerState:
    """Leave out what moves all the time: the noise floor, and a threshold that follows it."""
    near = abs(now.threshold_dbfs - before.threshold_dbfs) < SETTLED_DB
    return replace(now, noise_floor_dbfs=0.0, threshold_dbfs=before.threshold_dbfs if near else now.threshold_dbfs)


def _changes(before: FingerState, after: FingerState) -> Iterator[str]:
    """Say what changed between two states, in one line for each subject."""
    if before.muted_because != after.muted_because or before.armed != after.armed:
        yield f"muted: {after.muted_because}" if after.muted_because else "armed" if after.armed else "not armed"
    for name in ("profile", "ceiling", "output_level", "threshold_dbfs"):
        if getattr(before, name) != getattr(after, name):
            yield f"{name}: {getattr(after, name)}"


@dataclass(frozen=True, slots=True)
class Newest:
    """The newest prediction of a finger and its command *as limited*; amplitude 0 where nothing vibrates."""

    prediction: Prediction
    command: HapticCommand

    @property
    def contact(self) -> bool:
        """Whether the finger touches."""
        return self.prediction.touch is not Touch.NONE

    @property
    def roughness(self) -> float:
        """Of what it touches, 0 to 1; 0 without contact."""
        return self.prediction.roughness if self.contact else 0.0

    def ended(self) -> "Newest":
        """Return the same without contact and vibration: what holds once predictions no longer come."""
        command = self.command
        return Newest(replace(self.prediction, touch=Touch.NONE), HapticCommand(0.0, command.frequency, command.time))


class NewestReader:
    """Reads a run, and the processes that replace it.

    ``finger`` names the finger of a run that has a single one; those of a hand have names.

    Attributes
    ----------
    fingers
        Names of all fingers, in order.
    """

    def __init__(self, name: str, *, finger: str = "index") -> None:
        self.watcher = Watcher(name)
        names = self.watcher.finger_names()
        self.fingers = names if all(names) else [finger]
        self._counts = [0] * len(self.fingers)
        self._last: dict[str, tuple[float, Newest]] = {}
        # What a run did before, perhaps long ago, is not the present.
        self._read()

    def read(self) -> dict[str, Newest]:
        """Return the newest prediction of each finger that has a new one since the last call, by its name.

        A finger without one for `SILENCE` is returned once more, without contact and with amplitude 0.
        """
        now = time.monotonic()
        found = self._read()
        self._last |= {finger: (now, newest) for finger, newest in found.items()}
        return found | self.silenced(before=now - SILENCE)

    def silenced(self, *, before: float = math.inf) -> dict[str, Newest]:
        """Return each finger that touches or vibrates since its last prediction, read ``before`` a time, as silent."""
        ended = {
            finger: newest.ended()
            for finger, (read_at, newest) in self._last.items()
            if read_at < before and (newest.contact or newest.command.amplitude)
        }
        self._last |= {finger: (before, newest) for finger, newest in ended.items()}
        return ended

    def _read(self) -> dict[str, Newest]:
        found: dict[str, Newest] = {}
        if self.watcher.follow():
            self._counts = [0] * len(self.fingers)
        for place, finger in enumerate(self.fingers):
            rows, self._counts[place] = self.watcher.predictions(self._counts[place], finger=place)
            if len(rows):
                prediction, command = prediction_of(rows[-1])
                if not (math.isfinite(command.amplitude) and math.isfinite(command.frequency)):
                    command = HapticCommand(0.0, 0.0, command.time)
                found[finger] = Newest(prediction, command)
        return found
