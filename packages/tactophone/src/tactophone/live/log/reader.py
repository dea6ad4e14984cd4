"""What is new in a run: as messages for a log and a live view, or every prediction for
buses and middleware."""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import msgspec
from msgspec import structs

from tactophone.core.prediction_fields import entries_of, prediction_of
from tactophone.core.types import HapticCommand, Prediction, Touch
from tactophone.live.log import log_topics
from tactophone.live.log.log_topics import Message, of_finger
from tactophone.live.telemetry.layout import FingerState, RunState, ended_faults
from tactophone.live.telemetry.records import EventBatch, RunStart, read_records
from tactophone.live.telemetry.watcher import Watcher

HEALTH_INTERVAL = 5.0
"""Seconds between two messages with counters and gauges."""

SETTLED_DB = 1.0
"""Threshold changes below this (dB) are not reported."""

READER_SILENCE = 0.1
"""Seconds without a new prediction after which a finger counts as silent: a run that
ends leaves nothing vibrating."""

READER_BACKLOG = 100
"""Predictions of a finger that may wait for their reader, about a second; a device has
no use for older ones."""

SET_CLOCK = 0.05
"""Seconds by which the time of day and the monotonic clock must part before the clock
counts as set: reading both takes less, even where the machine is busy in between. A
clock that is slewed takes the monotonic one along (Linux)."""

FASTEST_DRIFT = 1e-4
"""Largest relative drift between the microphone's clock and ours: cheap quartzes stay
within 100 ppm."""

LONGEST_DELAY = 10.0
"""Seconds after the sound's end in which its prediction comes at the latest, even when
a machine stood still: one that seems later is of a stream that began anew."""

_INFO = 2
"""Level of a message for information (``foxglove.Log``)."""

_WARNING = 3
"""Level of a message with a warning (``foxglove.Log``)."""


def encoded(prediction: Prediction, command: HapticCommand) -> bytes:
    """Return a prediction and its command as JSON, exactly; what is NaN or infinite is
    left out."""
    return _fitting(entries_of(prediction, command))


def _fitting(entries: dict[str, Any]) -> bytes:
    """Encode what fits the schema of a topic, which knows no null: JSON has neither NaN
    nor infinity."""
    return msgspec.json.encode(
        {name: value for name, value in entries.items() if _is_known(value)}
    )


def _is_known(value: Any) -> bool:
    return value is not None and not (
        isinstance(value, float) and not math.isfinite(value)
    )


class RunReader:
    """Reads a run, and the processes that replace it, as messages.

    - ``missed``: predictions and bytes of the session log that were overwritten before
      they were read.
    - ``within``: whether the run had gone on for so long that its start is gone: what
      was before this reader then counts as nobody's, and no replay is possible.
    - ``names``: names of a hand's fingers; one empty name where there is no hand.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.missed = {"predictions": 0, "log": 0}
        self.watcher = Watcher(name)
        self._begin()
        self.within = not self.watcher.knows_its_start
        if self.within:
            self._begin_here()

    def read(self) -> list[Message]:
        """Return all messages since the last call, oldest first within each topic."""
        if self.watcher.follow():
            self._begin()
        now = self._now()
        return [
            *self._clock(now),
            *self._session(),
            *self._predictions(now),
            *self._state(now),
            *self._health(now),
        ]

    def _begin(self) -> None:
        watcher = self.watcher
        self.names = watcher.finger_names()
        self._log_count = 0
        self._epoch = time_of_day()
        self._set_to = self._epoch
        self._clocks = [StreamClock() for _ in self.names]
        self._partial: tuple[bytes, ...] = ()
        self._settled = RunState(fingers=(FingerState(),) * watcher.fingers)
        self._health_at = 0.0

    def _begin_here(self) -> None:
        """Leave out what the run did before this reader, perhaps for hours."""
        _, self._log_count = self.watcher.log(self.watcher.log_length)
        for finger in range(len(self.names)):
            self.watcher.new_predictions(finger=finger)

    def _now(self) -> float:
        """Return the time of the day, in s, by a clock that is never set: the one that
        stamps the packets."""
        return self._epoch + time.monotonic()

    def _clock(self, now: float) -> Iterator[Message]:
        """Say when the time of day was set: from then on, the times here are no longer
        those of other programs."""
        if was_set(self._set_to):
            self._set_to = time_of_day()
            apart = self._set_to - self._epoch
            yield self._event(
                now,
                f"this machine's clock was set: it is {apart:+.1f} s from the times of "
                "this log, which go on as they began",
                _WARNING,
            )

    def _session(self) -> Iterator[Message]:
        log, count = self.watcher.log(self._log_count)
        if len(log) < count - self._log_count:
            self.missed["log"] += count - self._log_count
            yield self._event(
                self._now(),
                "part of the session was not read in time: no replay beyond",
                _WARNING,
            )
        self._log_count = count
        arrivals: list[EventBatch] = []
        for record in read_records(log):
            if isinstance(record, EventBatch):
                # Arrivals that were too long for one record are put together.
                events = self._partial + record.events
                self._partial = events if record.more else ()
                if not record.more:
                    arrivals.append(structs.replace(record, events=events))
                continue
            # Packets and controls keep their order in the file, as their order decides
            # about the replay.
            yield from self._packets(arrivals)
            arrivals = []
            if isinstance(record, RunStart):
                self._epoch = record.epoch
            topic = (
                log_topics.RUN if isinstance(record, RunStart) else log_topics.CONTROLS
            )
            yield Message(topic, self._now(), _fitting(msgspec.to_builtins(record)))
        yield from self._packets(arrivals)

    def _packets(self, arrivals: list[EventBatch]) -> Iterator[Message]:
        if arrivals:
            data = msgspec.json.encode(log_topics.Packets(arrivals))
            yield Message(log_topics.PACKETS, self._epoch + arrivals[-1].time, data)

    def _predictions(self, now: float) -> Iterator[Message]:
        for finger, name in enumerate(self.names):
            topic = of_finger(log_topics.PREDICTION_TOPIC, finger, name)
            rows, missed = self.watcher.new_predictions(finger=finger)
            if missed:
                self.missed["predictions"] += missed
                yield self._event(
                    now, f"{missed} predictions were not read in time", _WARNING
                )
            for row in rows:
                prediction, command = prediction_of(row)
                # A prediction carries the time of its stream, which is even; the time
                # of reading is a staircase.
                self._clocks[finger].follow(
                    self._epoch + float(row["made"]), prediction.end
                )
                yield Message(
                    topic,
                    self._clocks[finger].time(prediction.end),
                    encoded(prediction, command),
                )

    def _state(self, now: float) -> Iterator[Message]:
        state = self.watcher.state()
        before = self._settled
        if len(state.fingers) != len(before.fingers):  # none is published yet
            return
        fingers = zip(state.fingers, before.fingers, strict=True)
        settled = replace(state, fingers=tuple(_settle(*finger) for finger in fingers))
        if settled == before:
            return
        self._settled = settled
        entries = {
            **msgspec.to_builtins(state),
            "armed": state.armed,
            "muted_because": state.muted_because,
        }
        entries["fingers"] = [
            {k: v for k, v in finger.items() if _is_known(v)}
            for finger in entries["fingers"]
        ]
        yield Message(log_topics.STATE_TOPIC, now, _fitting(entries))
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
        for fault in ended_faults(before.faults, state.faults):
            yield self._event(now, fault.end, _INFO)

    def _health(self, now: float) -> Iterator[Message]:
        if now - self._health_at >= HEALTH_INTERVAL:
            self._health_at = now
            yield Message(
                log_topics.HEALTH,
                now,
                msgspec.json.encode(log_topics.Totals(*self.watcher.totals())),
            )

    def _event(self, now: float, text: str, level: int) -> Message:
        stamp = log_topics.Stamp(int(now), int(now % 1 * 1e9))
        return Message(
            log_topics.EVENTS,
            now,
            msgspec.json.encode(log_topics.Event(stamp, level, text, self.name)),
        )


def time_of_day() -> float:
    """Return by how much the time of day (s since 1970) is ahead of the monotonic
    clock."""
    while True:
        before = time.monotonic()
        now = time.time()
        # A process that was stopped between the two reads them again.
        if time.monotonic() - before < SET_CLOCK / 2:
            return now - before


def was_set(ahead: float) -> bool:
    """Return whether the time of day was set since it was ``ahead`` (`time_of_day`), as
    by NTP after a boot, by hand, or by the sleep of the machine."""
    return abs(time_of_day() - ahead) > SET_CLOCK


def words_for_missed(missed: Mapping[str, int]) -> str:
    """Return what a reader missed, each count in its own unit; empty if nothing.

    >>> words_for_missed({"predictions": 12, "log": 3000})
    '12 predictions and 3 kB of packets'
    """
    predictions = missed.get("predictions", 0)
    packets = missed.get("log", 0)
    return " and ".join(
        [f"{predictions} predictions"] * bool(predictions)
        + [f"{math.ceil(packets / 1000)} kB of packets"] * bool(packets)
    )


def _settle(now: FingerState, before: FingerState) -> FingerState:
    """Leave out what moves all the time: the noise floor, and a threshold that follows
    it."""
    near = abs(now.threshold_dbfs - before.threshold_dbfs) < SETTLED_DB
    return replace(
        now,
        noise_floor_dbfs=0.0,
        threshold_dbfs=before.threshold_dbfs if near else now.threshold_dbfs,
    )


def _changes(before: FingerState, after: FingerState) -> Iterator[str]:
    """Say what changed between two states, in one line for each subject."""
    if before.muted_because != after.muted_because or before.armed != after.armed:
        armed = "armed" if after.armed else "not armed"
        yield f"muted: {after.muted_because}" if after.muted_because else armed
    for name in ("profile", "ceiling", "output_level", "threshold_dbfs"):
        if getattr(before, name) != getattr(after, name):
            yield f"{name}: {getattr(after, name)}"
    if after.buzzing and not before.buzzing:
        yield "buzz: somebody felt the actuator for a moment"


class StreamClock:
    """Turns times of a finger's stream into times of this machine, by the least delay
    seen.

    The least delay from the end of the sound to its prediction (capture, packet,
    network, detector) cannot be told from a difference of the clocks, so every time is
    late by this much. No clock of the other machine enters.
    """

    def __init__(self) -> None:
        self._least = math.inf
        self._at = 0.0

    def follow(self, made: float, end: float) -> None:
        """Take a prediction of sound that ends at ``end`` (s of the stream), made at
        ``made`` (s of this machine)."""
        delay = made - end
        # The least delay may grow again, as fast as two sound clocks part; else one
        # lucky packet would hold for ever.
        most = self._least + FASTEST_DRIFT * max(0.0, made - self._at)
        begins_anew = delay > most + LONGEST_DELAY
        self._least = delay if begins_anew else min(most, delay)
        self._at = made

    def shift(self, by: float) -> None:
        """Go on after this machine's clock was set ahead by so much (s)."""
        self._least += by
        self._at += by

    def time(self, end: float) -> float:
        """Return the time on this machine's clock of a time of the stream."""
        return self._least + end


@dataclass(frozen=True, slots=True)
class Passed:
    """A prediction of a finger, its command *as limited* (amplitude 0 where nothing
    vibrates), and its times.

    Times are in s since 1970, on the clock of this machine, which may be set at any
    moment: what asks how old a command is compares ``computed`` with
    ``time.monotonic()``.
    """

    finger: str
    prediction: Prediction
    command: HapticCommand
    sound: float
    """When the sound at the window's end came in, by `StreamClock`."""
    made: float
    """When the prediction and its command were computed."""
    rendered: float
    """When the command is expected at the actuator, by the medians of the latency
    budget; NaN where nothing renders."""
    computed: float
    """The same moment as ``made``, in s of the monotonic clock, which is never set."""

    @property
    def contact(self) -> bool:
        return self.prediction.touch is not Touch.NONE

    @property
    def roughness(self) -> float:
        """Roughness of what it touches, 0 to 1; 0 without contact."""
        return self.prediction.roughness if self.contact else 0.0

    def ended(self, made: float, computed: float) -> "Passed":
        """Return the same without contact and vibration: what holds once predictions no
        longer come."""
        command = HapticCommand(0.0, self.command.frequency, self.command.time)
        return replace(
            self,
            prediction=structs.replace(
                self.prediction, touch=Touch.NONE, unknown=False
            ),
            command=command,
            made=made,
            computed=computed,
        )


class PredictionReader:
    """Reads every prediction of a run, and of the processes that replace it.

    ``finger`` names the finger of a run that has a single one; a hand's fingers have
    names.

    The times follow the time of day when that is set: as those of other programs do.

    - ``fingers``: names of all fingers, in order.
    - ``missed``: predictions that were passed on to nobody: the oldest, where more than
      `READER_BACKLOG` were waiting.
    """

    def __init__(self, name: str, *, finger: str = "index") -> None:
        self.watcher = Watcher(name)
        names = self.watcher.finger_names()
        self.fingers = names if all(names) else [finger]
        self._epoch = time_of_day()
        self._last: dict[str, tuple[float, Passed]] = {}
        self._clocks = [StreamClock() for _ in self.fingers]
        for place in range(len(self.fingers)):
            # What a run did before, perhaps long ago, is skipped.
            self.watcher.new_predictions(finger=place)
        self.missed = 0

    def read(self) -> list[Passed]:
        """Return the predictions since the last call, oldest first for each finger.

        A finger without one for `READER_SILENCE` is returned once more, without contact
        and with amplitude 0.
        """
        now = time.monotonic()
        if was_set(self._epoch):
            before, self._epoch = self._epoch, time_of_day()
            for clock in self._clocks:
                clock.shift(self._epoch - before)
        found = self._read()
        self._last |= {passed.finger: (now, passed) for passed in found}
        return found + self.silenced(before=now - READER_SILENCE)

    def silenced(self, *, before: float = math.inf) -> list[Passed]:
        """Return each finger that touches or vibrates since its last prediction, read
        ``before`` a time, as silent."""
        now = time.monotonic()
        ended = [
            passed.ended(self._epoch + now, now)
            for read_at, passed in self._last.values()
            if read_at < before and (passed.contact or passed.command.amplitude)
        ]
        self._last |= {passed.finger: (before, passed) for passed in ended}
        return ended

    def _read(self) -> list[Passed]:
        if self.watcher.follow():
            self._clocks = [StreamClock() for _ in self.fingers]
        return [
            passed
            for place in range(len(self.fingers))
            for passed in self._read_finger(place)
        ]

    def _read_finger(self, place: int) -> Iterator[Passed]:
        rows, missed = self.watcher.new_predictions(finger=place)
        self.missed += missed + max(0, len(rows) - READER_BACKLOG)
        if not len(rows):
            return
        after = self.watcher.gauge("latency_render") + self.watcher.gauge(
            "latency_device"
        )
        for row in rows[-READER_BACKLOG:]:
            prediction, command = prediction_of(row)
            if not (
                math.isfinite(command.amplitude) and math.isfinite(command.frequency)
            ):
                command = HapticCommand(0.0, 0.0, command.time)
            computed = float(row["made"])
            made = self._epoch + computed
            clock = self._clocks[place]
            clock.follow(made, prediction.end)
            yield Passed(
                self.fingers[place],
                prediction,
                command,
                clock.time(prediction.end),
                made,
                made + after,
                computed,
            )
