"""What is new in a run, as messages for every bridge: the log, the live view and the buses read it the same way."""

import json
import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from typing import TypeVar

from tactophone.bridges import schemas
from tactophone.bridges.packet_coding import PacketWriter
from tactophone.bridges.prediction_rows import entries_of, write_columns
from tactophone.bridges.schemas import Topic, of_finger
from tactophone.bridges.sound_messages import SoundMessages
from tactophone.json_numbers import finite
from tactophone.telemetry import (
    Controls,
    EventBatch,
    FingerState,
    Record,
    RunStart,
    State,
    Watcher,
    read_records,
)
from tactophone.types import HapticCommand, Prediction, Touch, prediction_of

HEALTH_INTERVAL = 5.0
"""Seconds between two messages with counters and gauges."""

LONGEST_BATCH = 1.0
"""Seconds of arrivals in a message, where `RunReader.flush` does not end it before."""

SHOWN_INTERVALS = {Touch.NONE: 1.0, Touch.SMOOTH: 0.2, Touch.ROUGH: 0.2}
"""Seconds between two predictions to look at while the touch stays the same, where all of them are in columns."""

SETTLED_DB = 1.0
"""Less than this is no change of a threshold's."""

_PACKET, _CONNECTED = 0, 2
_INFO, _WARNING = 2, 3

_Totals = Mapping[str, Mapping[str, float | None]]
_AnyState = TypeVar("_AnyState", State, FingerState)


@dataclass(frozen=True, slots=True)
class Message:
    """A message of a topic; ``time`` in s since 1970."""

    topic: Topic
    time: float
    data: bytes


class RunReader:
    """Reads a run, and the processes that replace it, as messages.

    With ``in_columns`` all predictions are returned by `flush`, in columns, and at once each that changes the touch,
    and one in `SHOWN_INTERVALS`.

    Attributes
    ----------
    missed
        Predictions and bytes of the session log that were overwritten before they were read.
    names
        Of the fingers of a hand; one empty name where there is no hand.
    """

    def __init__(self, name: str, *, in_columns: bool = False) -> None:
        self.name, self._in_columns = name, in_columns
        self._packet_writer = PacketWriter()
        self.missed = {"predictions": 0, "log": 0}
        self._follow(Watcher(name))

    def read(self) -> list[Message]:
        """Return all messages since the last call, oldest first within each topic."""
        successor = self.watcher.successor()
        now = self._now()
        messages = [*self._session(), *self._predictions(now), *self._state(now), *self._health(now)]
        if successor is not None:
            messages += self.flush()
            self._follow(successor)
        return messages

    def flush(self) -> list[Message]:
        """Return what was held back to be joined."""
        messages = [*(Message(*part) for part in self._sound.flush()), *self._packets()]
        for finger, (name, rows) in enumerate(zip(self.names, self._rows, strict=True)):
            if rows:
                topic = of_finger(schemas.PREDICTIONS, finger, name)
                messages.append(Message(topic, self._lead + rows[-1][0].end, write_columns(rows)))
                rows.clear()
        return messages

    def _follow(self, watcher: Watcher) -> None:
        self.watcher, self.names = watcher, watcher.finger_names()
        self._log_count, self._prediction_counts = 0, [0] * watcher.fingers
        self._epoch = time.time() - time.monotonic()
        self._lead = math.inf
        self._sound = SoundMessages(self.names)
        self._rows: list[list[tuple[Prediction, HapticCommand]]] = [[] for _ in self.names]
        self._shown = [(Touch.NONE, -math.inf)] * len(self.names)
        self._partial: tuple[bytes, ...] = ()
        self._arrivals: list[tuple[EventBatch, list[bool]]] = []
        self._settled = State()
        self._health_at = 0.0
        self._totals: _Totals = {}

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
        yield from self._records(list(read_records(log)))

    def _records(self, records: list[Record]) -> Iterator[Message]:
        for record in self._whole(records):
            if isinstance(record, EventBatch):
                if self._arrivals and record.time - self._arrivals[0][0].time > LONGEST_BATCH:
                    yield from self._packets()
                yield from self._sound_of(record)
            else:
                # Packets and controls keep their order in the file, as their order decides about the replay.
                yield from self._packets()
                yield self._record(record)

    def _whole(self, records: list[Record]) -> Iterator[Record]:
        """Put arrivals together that were too long for one record."""
        for record in records:
            if not isinstance(record, EventBatch):
                yield record
                continue
            events = self._partial + record.events
            self._partial = events if record.more else ()
            if not record.more:
                yield replace(record, events=events)

    def _record(self, record: RunStart | Controls) -> Message:
        data = json.dumps(asdict(record)).encode()
        if isinstance(record, RunStart):
            self._epoch = record.epoch
            return Message(schemas.RUN, self._now(), data)
        return Message(schemas.CONTROLS, self._now(), data)

    def _sound_of(self, arrival: EventBatch) -> Iterator[Message]:
        with_sound = []
        for event in arrival.events:
            parts = None
            if event[:1] == bytes([_CONNECTED]):
                yield from (Message(*part) for part in self._sound.flush())
                self._sound.reset()
            elif event[:1] == bytes([_PACKET]):
                parts = self._sound.push(event[1:], arrival=self._epoch + arrival.time)
                yield from (Message(*part) for part in parts or ())
            with_sound.append(parts is not None)
        self._arrivals.append((arrival, with_sound))

    def _packets(self) -> Iterator[Message]:
        if self._arrivals:
            time = self._epoch + self._arrivals[-1][0].time
            yield Message(schemas.PACKETS, time, self._packet_writer.encode(self._arrivals))
            self._arrivals = []

    def _predictions(self, now: float) -> Iterator[Message]:
        for finger, name in enumerate(self.names):
            yield from self._predictions_of(finger, of_finger(schemas.PREDICTION, finger, name), now)

    def _predictions_of(self, finger: int, topic: Topic, now: float) -> Iterator[Message]:
        rows, count = self.watcher.predictions(self._prediction_counts[finger], finger=finger)
        missed = count - self._prediction_counts[finger] - len(rows)
        if missed > 0:
            self.missed["predictions"] += missed
            yield self._event(now, f"{missed} predictions were not read in time", _WARNING)
        self._prediction_counts[finger] = count
        if len(rows):
            # A prediction carries the time of its stream. The least delay seen until it was read turns that into the
            # time of the day, evenly, where the time of reading would be a staircase.
            self._lead = min(self._lead, now - float(rows["window_end"][-1]))
        for row in rows:
            prediction, command = prediction_of(row)
            if self._in_columns:
                self._rows[finger].append((prediction, command))
                touch, shown = self._shown[finger]
                due = prediction.touch is not touch or prediction.end >= shown + SHOWN_INTERVALS[touch]
                if not due and not prediction.events:
                    continue
                self._shown[finger] = prediction.touch, prediction.end
            yield Message(topic, self._lead + prediction.end, json.dumps(entries_of(prediction, command)).encode())

    def _state(self, now: float) -> Iterator[Message]:
        state, before = self.watcher.state(), self._settled
        fingers = zip(state.fingers, before.fingers or state.fingers, strict=True)
        settled = replace(_settle(state, before), fingers=tuple(_settle(*finger) for finger in fingers))
        if settled == before:
            return
        self._settled = settled
        yield Message(schemas.STATE, now, json.dumps(finite(asdict(state))).encode())
        for finger, name in enumerate(self.names):
            of = f"{name}: " if name else ""
            for text in _changes(before.of_finger(finger), settled.of_finger(finger)):
                yield self._event(now, f"{of}{text}", _INFO)
        if before.link != state.link:
            yield self._event(now, f"link: {state.link}", _INFO)
        known = {fault.code: fault.text for fault in before.faults}
        for fault in state.faults:
            if known.get(fault.code) != fault.text:
                yield self._event(now, fault.text, _WARNING)

    def _health(self, now: float) -> Iterator[Message]:
        if now - self._health_at < HEALTH_INTERVAL:
            return
        self._health_at = now
        counters, gauges = self.watcher.totals()
        parts: _Totals = {"counters": counters, "gauges": {name: _significant(value) for name, value in gauges.items()}}
        # A viewer may begin at any time, but a log is read from its beginning: what has not changed is left out.
        before, self._totals = self._totals, parts if self._in_columns else {}
        health = {
            part: {name: value for name, value in values.items() if value != before.get(part, {}).get(name, "")}
            for part, values in parts.items()
        }
        yield Message(schemas.HEALTH, now, json.dumps(health).encode())

    def _event(self, now: float, text: str, level: int) -> Message:
        stamp = {"sec": int(now), "nsec": int(now % 1 * 1e9)}
        entries = {"timestamp": stamp, "level": level, "message": text, "name": self.name, "file": "", "line": 0}
        return Message(schemas.EVENTS, now, json.dumps(entries).encode())


def _significant(value: float) -> float | None:
    return float(f"{value:.4g}") if math.isfinite(value) else None


def _settle(now: _AnyState, before: _AnyState) -> _AnyState:
    """Leave out what moves all the time: the noise floor, and a threshold that follows it."""
    near = abs(now.threshold_dbfs - before.threshold_dbfs) < SETTLED_DB
    return replace(now, noise_floor_dbfs=0.0, threshold_dbfs=before.threshold_dbfs if near else now.threshold_dbfs)


def _changes(before: State, after: State) -> Iterator[str]:
    """Say what changed between two states, in one line for each subject."""
    if before.muted_because != after.muted_because or before.armed != after.armed:
        yield f"muted: {after.muted_because}" if after.muted_because else "armed" if after.armed else "not armed"
    for name in ("profile", "ceiling", "output_level", "threshold_dbfs"):
        if getattr(before, name) != getattr(after, name):
            yield f"{name}: {getattr(after, name)}"
