"""What is new in a run, as messages for every bridge: the log, the live view and the buses read it the same way."""

import json
import math
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from typing import Any

from tactophone.bridges import protobuf, schemas
from tactophone.bridges.rtp_headers import RtpHeaders
from tactophone.bridges.schemas import Topic, of_finger
from tactophone.bridges.sound_messages import SoundMessages, read_sound_packet
from tactophone.telemetry import Controls, EventBatch, Record, RunStart, State, Watcher, prediction_of, read_records
from tactophone.types import HapticCommand, Prediction, Touch

HEALTH_INTERVAL = 2.0
"""Seconds between two messages with counters and gauges."""

LONGEST_BATCH = 0.5
"""Seconds of arrivals in a message: a reader looks one up in the time of one read of a chunk."""

_PACKET, _CONNECTED = 0, 2
_INFO, _WARNING = 2, 3


@dataclass(frozen=True, slots=True)
class Message:
    """A message of a topic; ``time`` in s since 1970."""

    topic: Topic
    time: float
    data: bytes


class RunReader:
    """Reads a run, and the processes that replace it, as messages.

    Parameters
    ----------
    name
        Of a run that exists already.

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
        self._follow(Watcher(name))

    def read(self) -> list[Message]:
        """Return all messages since the last call, oldest first within each topic."""
        successor = self.watcher.successor()
        now = time.time()
        messages = [*self._session(), *self._predictions(now), *self._state(now), *self._health(now)]
        if successor is not None:
            messages += self.flush()
            self._follow(successor)
        return messages

    def flush(self) -> list[Message]:
        """Return what was held back to be joined."""
        return [Message(*part) for part in self._sound.flush()]

    def _follow(self, watcher: Watcher) -> None:
        self.watcher, self.names = watcher, watcher.finger_names()
        self._log_count, self._prediction_counts = 0, [0] * watcher.fingers
        self._epoch = time.time() - time.monotonic()
        self._lead = math.inf
        self._sound = SoundMessages(self.names)
        self._partial: tuple[bytes, ...] = ()
        self._previous = self._settled = State()
        self._health_at = 0.0

    def _session(self) -> Iterator[Message]:
        log, count = self.watcher.log(self._log_count)
        if len(log) < count - self._log_count:
            self.missed["log"] += count - self._log_count
            log = b""
            yield self._event(time.time(), "part of the session was not read in time: no replay beyond", _WARNING)
        self._log_count = count
        yield from self._records(list(read_records(log)))

    def _records(self, records: list[Record]) -> Iterator[Message]:
        arrivals: list[EventBatch] = []
        for record in self._whole(records):
            if isinstance(record, EventBatch):
                if arrivals and record.time - arrivals[0].time > LONGEST_BATCH:
                    yield from self._packets(arrivals)
                    arrivals = []
                arrivals.append(record)
                continue
            # Packets and controls keep their order in the file, as their order decides about the replay.
            yield from self._packets(arrivals)
            arrivals = []
            yield self._record(record)
        yield from self._packets(arrivals)

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
            return Message(schemas.RUN, time.time(), data)
        return Message(schemas.CONTROLS, time.time(), data)

    def _packets(self, arrivals: list[EventBatch]) -> Iterator[Message]:
        if not arrivals:
            return
        base, headers = round(arrivals[0].time * 1e9), RtpHeaders()
        data = b"".join(protobuf.octets(1, encode_arrival(arrival, base, headers)) for arrival in arrivals)
        data += protobuf.integer(2, max(base, 0))
        yield Message(schemas.PACKETS, self._epoch + arrivals[-1].time, data)
        for arrival in arrivals:
            for event in arrival.events:
                if event[:1] == bytes([_CONNECTED]):
                    yield from self.flush()
                    self._sound.reset()
                elif event[:1] == bytes([_PACKET]) and (packet := read_sound_packet(event[1:])):
                    yield from (Message(*part) for part in self._sound.push(packet, arrival=self._epoch + arrival.time))

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
            self._lead = min(self._lead, now - float(rows["end"][-1]))
        for row in rows:
            entries = prediction_entries(*prediction_of(row))
            yield Message(topic, self._lead + entries["window_end"], json.dumps(entries).encode())

    def _state(self, now: float) -> Iterator[Message]:
        # The noise floor moves all the time; it is part of the next state that changes otherwise.
        state = self.watcher.state()
        fingers = tuple(replace(finger, noise_floor_dbfs=0.0) for finger in state.fingers)
        settled = replace(state, noise_floor_dbfs=0.0, fingers=fingers)
        if settled == self._settled:
            return
        self._settled = settled
        yield Message(schemas.STATE, now, json.dumps(_finite(asdict(state))).encode())
        before = {fault.code: fault.text for fault in self._previous.faults}
        for finger, name in enumerate(self.names):
            of = f"{name}: " if name else ""
            for text in _changes(self._previous.of_finger(finger), state.of_finger(finger)):
                yield self._event(now, f"{of}{text}", _INFO)
        if self._previous.link != state.link:
            yield self._event(now, f"link: {state.link}", _INFO)
        for fault in state.faults:
            if before.get(fault.code) != fault.text:
                yield self._event(now, fault.text, _WARNING)
        self._previous = state

    def _health(self, now: float) -> Iterator[Message]:
        if now - self._health_at < HEALTH_INTERVAL:
            return
        self._health_at = now
        counters, gauges = self.watcher.totals()
        yield Message(schemas.HEALTH, now, json.dumps({"counters": counters, "gauges": _finite(gauges)}).encode())

    def _event(self, now: float, text: str, level: int) -> Message:
        stamp = {"sec": int(now), "nsec": int(now % 1 * 1e9)}
        entries = {"timestamp": stamp, "level": level, "message": text, "name": self.name, "file": "", "line": 0}
        return Message(schemas.EVENTS, now, json.dumps(entries).encode())


def encode_arrival(arrival: EventBatch, base: int, headers: RtpHeaders) -> bytes:
    """Encode an arrival as the message ``tactophone.EventBatch``; ``base`` in ns, ``headers`` those of its message.

    A time read from the clock is a whole number of ns. It is then written as such, after ``base``: three bytes in place
    of nine. Any other time is written as it is, for a replay needs its last bit.
    """
    nanoseconds = round(arrival.time * 1e9)
    if nanoseconds / 1e9 == arrival.time and nanoseconds >= base >= 0:
        encoded = protobuf.integer(4, nanoseconds - base)
    else:
        encoded = protobuf.double(1, arrival.time)
    encoded += protobuf.integer(2, arrival.polled) * arrival.polled
    return encoded + b"".join(protobuf.octets(3, headers.shorten(event)) for event in arrival.events)


def prediction_entries(prediction: Prediction, command: HapticCommand) -> dict[str, Any]:
    """Return a prediction and its command by name; JSON has no NaN and no infinity, so those are ``None``."""
    none, smooth, rough = prediction.probabilities
    touch, end = prediction.touch, prediction.end
    entries = {
        "window_end": end, **_difference("window_start", prediction.start, "window", end),
        **_difference("time", command.time, "delay", end),
        "none": none, "smooth": smooth, "rough": rough, "touch": touch.name.lower(),
        "contact": int(touch is not Touch.NONE), "level_dbfs": prediction.level_dbfs,
        "roughness": prediction.roughness, "frequency": command.frequency, "amplitude": command.amplitude,
    }  # fmt: skip
    for event in prediction.events:
        entries |= {"event": event.kind, "event_time": event.time}
    return _finite(entries)


def _difference(name: str, value: float, short: str, end: float) -> dict[str, float]:
    """Return a time as its distance from the window's end, in as few digits as lose no bit."""
    sign = -1 if short == "window" else 1
    distance = sign * (value - end)
    # A distance is the same at each prediction but for its last digits, which are those of the subtraction.
    shortest = next((each for each in (round(distance, 9), distance) if end + sign * each == value), None)
    return {name: value} if shortest is None else {short: shortest}


def _finite(entries: dict[str, Any]) -> dict[str, Any]:
    return {name: _finite_value(value) for name, value in entries.items()}


def _finite_value(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_finite(each) if isinstance(each, dict) else each for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _changes(before: State, after: State) -> Iterator[str]:
    """Say what changed between two states, in one line for each subject."""
    if before.muted_because != after.muted_because or before.armed != after.armed:
        yield f"muted: {after.muted_because}" if after.muted_because else "armed" if after.armed else "not armed"
    for name in ("profile", "ceiling", "output_level", "threshold_dbfs"):
        if getattr(before, name) != getattr(after, name):
            yield f"{name}: {getattr(after, name)}"
