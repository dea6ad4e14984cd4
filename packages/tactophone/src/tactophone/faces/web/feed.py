"""The messages of a viewer: what is new in a run since the last message, as a JSON
header and tables of float32.

::

    uint32   length of the header, a multiple of four
    header   JSON: "series" names each table with its shape, in the order of the numbers
    numbers  little-endian float32, table after table, row by row

Sound is sent as an envelope, because a screen cannot show 48 000 points a second: the
lowest and highest value and the level of each bucket of `BUCKET` seconds. A column of
``spectrum`` has the level of the contact sound in each band of the texture detector.
Times are in s, relative to ``origin`` in stream time.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.core.microphones import CONTACT
from tactophone.core.texture_bands import band_edges
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.faces.web.spectrogram import Spectrogram
from tactophone.live.telemetry.layout import STEP_FIELDS, Request
from tactophone.live.telemetry.watcher import Snapshot, Watcher, runs

BUCKET = 0.01
"""Seconds in a bucket of the envelope: narrower than a pixel of the 5 s shown."""

STEP_INTERVAL = 0.01
"""Seconds between steps sent, for the same reason; a packet of 2.5 ms brings four times
as many."""

SCOPE_STEP = 12
"""Every twelfth sample of the vibration is sent, 4 kHz: its band ends at 1 kHz."""

STEP_COLUMNS = (*(field.name for field in STEP_FIELDS), "truth")

Tables = Mapping[str, NDArray[Any]]

LOWERING_HOLDS = 0.5
"""Seconds for which a lowering holds against a weaker one: many times longer than a run
takes to read its requests."""

SEARCH_INTERVAL = 2.0
"""Seconds between two searches for a run that nothing of its name leads to: each takes
tens of milliseconds."""

STATE_INTERVAL = 0.2
"""Seconds between messages with state, counters and gauges: faster than a person reads
numbers."""


def pack(header: Mapping[str, Any], tables: Tables) -> bytes:
    """Return a message of a header and its tables.

    >>> message = pack({"age": np.nan}, {"steps": np.zeros((2, 3))})
    >>> message[4:].split(b" ")[0], len(message)
    (b'{"age":null,"series":{"steps":[2,3]}}', 68)
    """
    header = {**header, "series": {name: table.shape for name, table in tables.items()}}
    text = msgspec.json.encode(header, enc_hook=float)  # NaN and infinity become null
    text += b" " * (-len(text) % 4)
    numbers = (
        np.ascontiguousarray(table, "<f4").tobytes() for table in tables.values()
    )
    return b"".join((len(text).to_bytes(4, "little"), text, *numbers))


def envelope(sound: FloatArray, size: int) -> NDArray[np.float64]:
    """Reduce sound to the low, high and level (dBFS) of each channel in each bucket of
    ``size`` samples.

    Shape ``(samples, channels)`` in; out ``(buckets, 3 * channels)``: low, high, level
    of channel 0, then of channel 1.

    >>> envelope(np.full((480, 1), 0.1, np.float32), 480).round(3).tolist()
    [[0.1, 0.1, -20.0]]
    """
    buckets = sound.reshape(-1, size, sound.shape[1]).astype(np.float64)
    level = 10 * np.log10(np.maximum(np.mean(buckets**2, axis=1), 1e-12))
    return np.stack([buckets.min(axis=1), buckets.max(axis=1), level], axis=2).reshape(
        len(buckets), 3 * sound.shape[1]
    )


def newest_pass(steps: NDArray[np.void]) -> NDArray[np.void]:
    """Return the steps since time last went back, as it does where a recording begins
    again: those before lie in the future of the new pass."""
    back = np.flatnonzero(np.diff(steps["time"]) < 0)
    return steps[back[-1] + 1 :] if len(back) else steps


def since(table: NDArray[np.float64], begun: float) -> NDArray[np.float64]:
    """Return the rows of a table from a time on; the first column is the time."""
    return table[table[:, 0] >= begun]


def step_table(steps: NDArray[np.void], origin: float) -> NDArray[np.float64]:
    """Return rows of time and `STEP_COLUMNS`, at most one every `STEP_INTERVAL`; the
    newest step is always included."""
    slots = np.floor(steps["time"] / STEP_INTERVAL)
    chosen = (
        steps[np.append(np.flatnonzero(np.diff(slots)), len(steps) - 1)]
        if len(steps)
        else steps
    )
    columns = {name: chosen[name] for name in STEP_COLUMNS}
    # Silence has no frequency.
    columns["frequency"] = np.where(chosen["amplitude"] > 0, chosen["frequency"], 0)
    return np.column_stack([chosen["time"] - origin, *columns.values()])


def event_table(steps: NDArray[np.void], origin: float) -> NDArray[np.float64]:
    """Return rows of time and kind, counted from 1 in `EVENT_KINDS`, of the steps with
    a touch event."""
    found = steps[steps["event"] > 0]
    return np.column_stack([found["time"] - origin, found["event"]])


class WatchedRun:
    """A run by name, whether it exists or not; a restarted run is found again."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._watcher: Watcher | None = None
        self._lowest: dict[tuple[str, int], tuple[float, float]] = {}
        """What each lowering of a finger asked for last, and when, in s."""
        self._searched = -SEARCH_INTERVAL

    def _find(self) -> Watcher | None:
        """Return a watcher of the run, whose memory may have lost its name before
        anybody looked at the page."""
        watcher = Watcher.find(self.name)
        if watcher is None and (now := time.monotonic()) - self._searched >= (
            SEARCH_INTERVAL
        ):
            self._searched = now
            watcher = next(runs(self.name), None)
        return watcher

    def snapshot(
        self, since: Snapshot | None = None, *, finger: int = 0
    ) -> Snapshot | None:
        """Read a finger of the run; ``None`` before it exists. Without such a
        finger, it is the first."""
        watcher = self._watcher = self._watcher or self._find()
        if watcher is None:
            return None
        watcher.follow(drain=False)
        return watcher.snapshot(since, finger=finger if finger < watcher.fingers else 0)

    @property
    def knows_its_start(self) -> bool:
        """Whether a log begun now would hold the run from its start."""
        return self._watcher is not None and self._watcher.knows_its_start

    @property
    def silenced(self) -> int:
        """See `Watcher.silenced`; -1 before the run exists."""
        return -1 if self._watcher is None else self._watcher.silenced

    def hand(self) -> list[tuple[int, float]]:
        """Return touch and amplitude of each finger now; empty where there is only
        one."""
        watcher = self._watcher
        if watcher is None or watcher.fingers == 1:
            return []
        steps = [
            watcher.newest_step(finger=finger) for finger in range(watcher.fingers)
        ]
        return [
            (int(step["touch"][0]), float(step["amplitude"][0]))
            if step is not None
            else (0, 0.0)
            for step in steps
        ]

    def ask(self, request: Request) -> None:
        """Pass a request to the run. For a finger that it does not have, it is for the
        first, which is what `snapshot` shows then."""
        if self._watcher is None:
            return
        finger = request.finger if request.finger < self._watcher.fingers else 0
        value = request.value
        if request.action.startswith("lower_"):
            value = self._not_above_the_last(request.action, finger, value)
        self._watcher.ask(request.action, value, text=request.text, finger=finger)

    def _not_above_the_last(self, action: str, finger: int, value: float) -> float:
        """Return the lower of a value and of what was asked just before, as the run may
        not have read that yet and a new request takes its place."""
        now = time.monotonic()
        before, asked = self._lowest.get((action, finger), (value, -math.inf))
        if now - asked < LOWERING_HOLDS:
            value = min(value, before)
        self._lowest[action, finger] = value, now
        return value


class Feed:
    """Makes a viewer's messages; each continues where the last one ended, however long
    ago that was."""

    def __init__(self, run: WatchedRun, *, finger: int = 0) -> None:
        self._run = run
        self._finger = finger
        self._reset()

    def _reset(self) -> None:
        self._last: Snapshot | None = None
        self._rest = np.zeros((0, 2), np.float32)
        self._spectrogram = Spectrogram(LIVE_SAMPLE_RATE)
        self._offset = 0.0
        self._state_sent = -STATE_INTERVAL

    def message(self) -> bytes:
        """Return a message with all that is new since the last one."""
        snapshot = self._run.snapshot(self._last, finger=self._finger)
        if snapshot is None:
            return pack({"alive": False, "waiting_for": self._run.name}, {})
        if self._last is not None and snapshot.restarts != self._last.restarts:
            self._reset()  # a restarted run counts from 0
        header: dict[str, Any] = {
            "alive": snapshot.alive,
            "age": snapshot.age,
            "silenced": self._run.silenced,
        }
        if (now := time.monotonic()) - self._state_sent >= STATE_INTERVAL:
            self._state_sent = now
            state = {**asdict(snapshot.state), **asdict(snapshot.finger)}
            header |= {
                "state": state,
                "counters": snapshot.counters,
                "gauges": snapshot.gauges,
                "whole": self._run.knows_its_start,
                "bands_hz": band_edges()[1:-1].round().tolist(),
            }
        header["origin"] = origin = self._origin(snapshot)
        steps = newest_pass(snapshot.steps)
        # Sound of the pass before would be drawn where this one had not begun.
        begun = -math.inf
        if len(steps) < len(snapshot.steps):
            begun = float(steps[0]["time"]) - origin - BUCKET
        first = snapshot.vibration_end - len(snapshot.vibration)
        tables: Tables = {
            "steps": step_table(steps, origin),
            "events": event_table(steps, origin),
            "sound": since(self._envelope(snapshot), begun),
            "spectrum": since(self._spectrum(snapshot), begun),
            "scope": snapshot.vibration[-first % SCOPE_STEP :: SCOPE_STEP],
        }
        self._last = snapshot
        if hand := self._run.hand():
            header["hand"] = hand
        return pack(header, tables)

    def _missed(self, snapshot: Snapshot) -> bool:
        """Return whether the new sound does not follow what was sent before."""
        first = snapshot.sound_end - len(snapshot.sound)
        return self._last is None or first > self._last.sound_end

    def _spectrum(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Return the time of each column's end, and its levels."""
        rate = snapshot.state.sample_rate
        if rate != self._spectrogram.sample_rate:
            self._spectrogram = Spectrogram(rate)
        if self._missed(snapshot):
            self._spectrogram.reset()
        levels = self._spectrogram.push(snapshot.sound[:, CONTACT])
        back = np.arange(len(levels))[::-1] * self._spectrogram.hop
        ends = -(self._spectrogram.waiting + back) / rate
        return np.column_stack([ends, levels])

    def _envelope(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Return the time of each bucket's end and its envelope; an unfinished bucket
        waits for the next message."""
        rate = snapshot.state.sample_rate
        size = max(1, round(BUCKET * rate))
        sound = (
            snapshot.sound
            if self._missed(snapshot)
            else np.concatenate([self._rest, snapshot.sound])
        )
        # Buckets start at multiples of their size since the run began, also after sound
        # was missed.
        sound = sound[-(snapshot.sound_end - len(sound)) % size :]
        count = len(sound) // size
        self._rest = sound[count * size :]
        ends = -len(self._rest) - size * np.arange(count)[::-1]
        return np.column_stack([ends / rate, envelope(sound[: count * size], size)])

    def _origin(self, snapshot: Snapshot) -> float:
        """Return the stream time of the newest sound, in s."""
        rate = snapshot.state.sample_rate
        if len(snapshot.steps):
            newest = snapshot.steps[-1]
            self._offset = float(newest["time"]) - int(newest["sound_end"]) / rate
        return self._offset + snapshot.sound_end / rate
