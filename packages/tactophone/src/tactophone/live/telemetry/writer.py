"""The writing side of telemetry: the running process publishes its steps and counts,
and reads its requests."""

import math
import struct
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from typing import Any

import numpy as np

from tactophone.core.prediction_fields import PREDICTION_FIELDS
from tactophone.core.types import (
    EVENT_KINDS,
    FloatArray,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.live.telemetry import layout
from tactophone.live.telemetry.layout import (
    ACTIONS,
    COUNTERS,
    GAUGES,
    MARKS,
    Action,
    Fault,
    Request,
    RunState,
)
from tactophone.live.telemetry.memory import Memory

_COUNTER = {name: index for index, name in enumerate(COUNTERS)}
"""Place of each counter in the memory."""

_GAUGE = {name: index for index, name in enumerate(GAUGES)}
"""Place of each gauge in the memory."""


def _packer(row: np.dtype[np.void]) -> struct.Struct:
    """Return what packs the numbers of a row, one after another, into its memory, in a
    quarter of the time of NumPy."""
    fields = [row[name] for name in row.names or ()]
    codes = [f"{math.prod(field.shape)}{field.base.char}" for field in fields]
    # "@" gives native sizes and alignment, as in the layout; "0d" ends a row at a whole
    # number of doubles, as the layout does too.
    return struct.Struct("".join(["@", *codes, "0d"]))


_STEP = _packer(layout.STEP_RECORD)
_PREDICTION = _packer(layout.PREDICTION_RECORD)
_MARK = _packer(layout.MARK)

_NOTHING = Prediction(
    (math.nan,) * 3, Touch.NONE, math.nan, -math.inf, start=math.nan, end=math.nan
)
"""What a step repeats before the first prediction."""

_SILENCE = HapticCommand(0.0, 0.0, math.nan)

REQUEST_AGE = 10.0
"""Seconds for which a request in the mailbox holds: a process that was stopped for
longer does not act on what somebody wanted before. What silences holds at any age."""

_SILENCING: frozenset[Action] = frozenset({"stop", "mute"})


class Telemetry(AbstractContextManager["Telemetry", None]):
    """Writes a run's telemetry; every call is short, takes no lock and never waits.

    Each counter, each gauge and each ring has *one* writing thread at most: adding to a
    counter from two threads can lose one of the additions.

    Every count is kept in this process and only copied to the shared memory, which is
    never read back but for the mailbox: whoever overwrites or removes the memory
    disturbs watchers, and never the run.

    - ``name``: name of the run, by which a `Watcher` finds it.
    - ``fingers``: how many fingers have steps, sound and vibration.

    >>> with Telemetry("doctest-writer") as telemetry:
    ...     telemetry.count("packets_received", 3)
    ...     telemetry.counter("packets_received")
    3
    """

    def __init__(self, name: str, *, fingers: int = 1) -> None:
        self.name = name
        self._memory = Memory(name, create=True, fingers=fingers)
        # Single numbers are written through memory views: NumPy takes half as long
        # again.
        self._counters = _view(self._memory["counters"])
        self._totals = [0] * len(COUNTERS)
        self._counts = {
            name: [0] * fingers for name in ("step", "prediction", "sound", "vibration")
        }
        self._published = {
            name: _view(self._memory[f"{name}_count"]) for name in self._counts
        }
        self._rings = {
            name: list(self._memory[name]) for name in ("sound", "vibration")
        }
        # Rows as bytes: first all of the first finger or mark, then of the next.
        rings = {
            name: self._memory[name].reshape(-1).view(np.uint8)
            for name in ("steps", "predictions", "marks")
        }
        self._rows = {name: _view(ring) for name, ring in rings.items()}
        self._log_ring = _view(self._memory["log"])
        self._logged = 0
        self._state_count = 0
        self._mark_counts = [0] * len(MARKS)
        self._marked = _view(self._memory["mark_counts"])
        self._gauges = _view(self._memory["gauges"])
        self._beat = self._memory["beat"]
        self._newest = [(_NOTHING, _SILENCE)] * fingers
        self._values = [_step_values(_NOTHING, _SILENCE)] * fingers
        self._request_counts = self._memory["requests"]["count"]
        self._seen = self._request_counts.tobytes()
        self.state = RunState()

    def __exit__(self, *_: object) -> None:
        self._memory.unlink()

    def count(self, name: str, n: int = 1) -> None:
        index = _COUNTER[name]
        self._totals[index] += n
        self._counters[index] = self._totals[index]

    def counter(self, name: str) -> int:
        return self._totals[_COUNTER[name]]

    def gauge(self, name: str, value: float) -> None:
        self._gauges[_GAUGE[name]] = value

    def vibration_count(self, finger: int = 0) -> int:
        return self._counts["vibration"][finger]

    def publish(
        self,
        step: PipelineStep,
        *,
        now: float,
        truth: int = -1,
        vibration_count: int | None = None,
    ) -> None:
        """Write one pipeline step of a finger: its sound, its predictions and its
        commands.

        - ``now``: the system-wide monotonic clock (s), which is the heartbeat.
        - ``truth``: the known `Touch` at this time, where the sound is simulated or
          labelled.
        - ``vibration_count``: samples of vibration written when the step was computed;
          by default, until now.
        """
        finger = step.finger
        block = step.block
        # Sound of one microphone fills both channels.
        self._append("sound", block.samples, finger)
        # A step without a prediction repeats the last prediction and command, so that a
        # reader needs one row only.
        event = self._renew(step) if step.predictions or step.commands else 0
        vibrated = vibration_count
        if vibrated is None:
            vibrated = self._counts["vibration"][finger]
        place = self._counts["step"][finger] % layout.STEP_CAPACITY
        row = finger * layout.STEP_CAPACITY + place
        _STEP.pack_into(
            self._rows["steps"],
            row * _STEP.size,
            block.end / block.sample_rate,
            self._counts["sound"][finger],
            vibrated,
            *self._values[finger],
            event,
            truth,
            block.concealed,
        )
        self._advance("step", 1, finger)
        for number, prediction in enumerate(step.predictions):
            command = step.commands[number] if step.commands else None
            self._log(prediction, command, finger, now)
        self.count("steps")
        if step.predictions:
            self.count("predictions", len(step.predictions))
        self._beat[...] = now

    def rendered(self, waveform: FloatArray, *, finger: int = 0) -> None:
        """Write the waveform just rendered for an actuator, shape ``(samples,)``; safe
        in an audio callback."""
        self._append("vibration", waveform, finger)

    def log(self, record: bytes) -> None:
        """Append a record of at most `LARGEST_RECORD` bytes to the session log; call it
        from one thread, or under a lock."""
        if len(record) > layout.LARGEST_RECORD:
            raise ValueError(
                f"a record of {len(record)} bytes, "
                f"but at most {layout.LARGEST_RECORD}: split it"
            )
        ring = self._log_ring
        at = self._logged % layout.LOG_CAPACITY
        head = min(len(record), layout.LOG_CAPACITY - at)
        ring[at : at + head] = record[:head]
        ring[: len(record) - head] = record[head:]
        # A record is counted once it is whole, so that a reader never sees part of it.
        self._logged += len(record)
        self._memory["log_count"][...] = self._logged

    def mark(self, *reached: tuple[int, int, float]) -> None:
        """Record what stages sound has reached: the index in `MARKS`, the RTP timestamp
        of its end, and when (s)."""
        counts = self._mark_counts
        marked = self._marked
        rows = self._rows["marks"]
        for index, position, now in reached:
            count = counts[index]
            row = index * layout.MARK_CAPACITY + count % layout.MARK_CAPACITY
            _MARK.pack_into(rows, row * _MARK.size, position, now)
            counts[index] = count + 1
            marked[index] = count + 1

    def update(self, state: RunState, *, now: float) -> None:
        """Publish a state; the same one again counts as a heartbeat."""
        self._beat[...] = now
        self._memory.sign()
        # A count that differs was overwritten, and the state perhaps too.
        intact = int(self._memory["state_count"]) == self._state_count > 0
        if intact and state == self.state:
            return
        self.state = state
        text = _fitting(state)
        slot = self._memory["states"][(self._state_count + 1) % 2]
        slot["text"][: len(text)] = np.frombuffer(text, np.uint8)
        slot["size"] = len(text)
        self._state_count += 1
        self._memory["state_count"][...] = self._state_count

    def requests(self, now: float | None = None) -> list[Request]:
        """Empty the mailbox: return the requests since the last call, oldest first.

        If ``now`` is given, requests that were not made within `REQUEST_AGE` of it are
        dropped: nobody asked for what lies in memory that was overwritten. A stop or a
        mute that nobody asked for does no harm, so these always hold.
        """
        before = self._seen
        self._seen = self._request_counts.tobytes()
        if before == self._seen:
            return []
        slots = self._memory["requests"]
        counted_before = np.frombuffer(before, np.uint64).reshape(slots.shape)
        counted = np.frombuffer(self._seen, np.uint64).reshape(slots.shape)
        found = []
        for action, place in np.argwhere(counted_before != counted).tolist():
            # Two watchers that write at once can garble a text: that is no request.
            with suppress(UnicodeDecodeError):
                slot = slots[action, place]
                found.append(request_in(slot, ACTIONS[action], place - 1))
        recent = [
            request
            for request in found
            if now is None
            or request.action in _SILENCING
            or abs(now - request.time) <= REQUEST_AGE
        ]
        return sorted(recent, key=lambda request: request.time)

    def _renew(self, step: PipelineStep) -> int:
        """Keep a step's newest prediction and command; return its newest event, 0
        without one."""
        prediction, command = self._newest[step.finger]
        prediction = step.predictions[-1] if step.predictions else prediction
        self._newest[step.finger] = prediction, step.command or command
        self._values[step.finger] = _step_values(*self._newest[step.finger])
        events = [
            event for prediction in step.predictions for event in prediction.events
        ]
        return 1 + EVENT_KINDS.index(events[-1].kind) if events else 0

    def _log(
        self,
        prediction: Prediction,
        command: HapticCommand | None,
        finger: int,
        made: float,
    ) -> None:
        command = command or HapticCommand(math.nan, math.nan, prediction.end)
        place = self._counts["prediction"][finger] % layout.PREDICTION_CAPACITY
        row = finger * layout.PREDICTION_CAPACITY + place
        values = [field.of(prediction, command) for field in PREDICTION_FIELDS]
        _PREDICTION.pack_into(
            self._rows["predictions"], row * _PREDICTION.size, *values, made
        )
        self._advance("prediction", 1, finger)

    def _append(self, name: str, samples: FloatArray, finger: int) -> None:
        ring = self._rings[name][finger]
        for start in range(0, len(samples), layout.LARGEST_WRITE):
            part = samples[start : start + layout.LARGEST_WRITE]
            # A part that reaches the end of the ring goes on at its beginning; the
            # count moves on last.
            at = self._counts[name][finger] % layout.SOUND_CAPACITY
            head = min(len(part), layout.SOUND_CAPACITY - at)
            ring[at : at + head] = part[:head]
            if head < len(part):
                ring[: len(part) - head] = part[head:]
            self._advance(name, len(part), finger)

    def _advance(self, name: str, n: int, finger: int) -> None:
        """Count rows of a ring that have been written."""
        counts = self._counts[name]
        counts[finger] += n
        self._published[name][finger] = counts[finger]


def request_in(slot: np.void, action: Action, finger: int) -> Request:
    """Read one slot of the mailbox; raises `UnicodeDecodeError` for a garbled text."""
    size = min(int(slot["size"]), len(slot["text"]))
    text = bytes(slot["text"][:size]).decode()
    return Request(action, float(slot["value"]), text, float(slot["time"]), finger)


def _view(array: Any) -> Any:
    return memoryview(array)


def _step_values(prediction: Prediction, command: HapticCommand) -> list[float]:
    return [field.of(prediction, command) for field in layout.STEP_FIELDS]


def _fitting(state: RunState) -> bytes:
    """Return a state as text, with as many of its faults as there is room for: what
    another end causes must not end this process."""
    text = bytes(state)
    shown = len(state.faults)
    while len(text) > layout.STATE_SIZE and shown:
        shown -= 1
        rest = Fault("state", f"and {len(state.faults) - shown} more")
        text = bytes(replace(state, faults=(*state.faults[:shown], rest)))
    if len(text) > layout.STATE_SIZE:
        text = bytes(replace(state, link="", source="", output="", faults=()))
    return text
