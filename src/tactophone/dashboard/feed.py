"""The messages of a viewer: what is new in a run since the last message."""

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dashboard.message import BUCKET, SCOPE_STEP, envelope, event_table, header, pack, step_table
from tactophone.telemetry import Request, Snapshot, Watcher

STATE_INTERVAL = 0.2
"""Seconds between messages with state, counters and gauges: faster than a person reads numbers."""


class WatchedRun:
    """A run by name, whether it exists or not; a restarted run is found again."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._watcher: Watcher | None = None

    def snapshot(self, since: Snapshot | None = None, *, finger: int = 0) -> Snapshot | None:
        """Read a finger of the run; ``None`` while there is none. Without such a finger, it is the first."""
        watcher = self._watcher = self._watcher or Watcher.find(self.name)
        if watcher is None:
            return None
        watcher.follow(drain=False)
        return watcher.snapshot(since, finger=finger if finger < watcher.fingers else 0)

    def hand(self) -> list[tuple[int, float]]:
        """Return touch and amplitude of each finger now; empty where there is only one."""
        watcher = self._watcher
        if watcher is None or watcher.fingers == 1:
            return []
        steps = [watcher.newest_step(finger=finger) for finger in range(watcher.fingers)]
        return [
            (int(step["touch"][0]), float(step["amplitude"][0])) if step is not None else (0, 0.0) for step in steps
        ]

    def ask(self, request: Request) -> None:
        """Send a request to the run, if there is a run."""
        if self._watcher is not None:
            finger = request.finger if request.finger < self._watcher.fingers else -1
            self._watcher.ask(request.action, request.value, text=request.text, finger=finger)


class Feed:
    """Makes a viewer's messages; each continues where the last one ended, however long ago that was."""

    def __init__(self, run: WatchedRun, *, finger: int = 0) -> None:
        self._run, self._finger = run, finger
        self._reset()

    def _reset(self) -> None:
        self._last: Snapshot | None = None
        self._rest = np.zeros((0, 2), np.float32)
        self._offset = 0.0
        self._state_sent = -STATE_INTERVAL

    def message(self) -> bytes:
        """Return a message with all that is new since the last one."""
        snapshot = self._run.snapshot(self._last, finger=self._finger)
        if snapshot is None:
            return pack({"alive": False, "waiting_for": self._run.name}, {})
        if self._last is not None and snapshot.restarts != self._last.restarts:
            self._reset()  # a restarted run counts from 0
        now = time.monotonic()
        full = now - self._state_sent >= STATE_INTERVAL
        self._state_sent = now if full else self._state_sent
        origin, tables = self._origin(snapshot), self._tables(snapshot)
        self._last = snapshot
        hand = self._run.hand()
        return pack({**header(snapshot, full=full), "origin": origin, **({"hand": hand} if hand else {})}, tables)

    def _tables(self, snapshot: Snapshot) -> dict[str, NDArray[Any]]:
        first = snapshot.vibration_end - len(snapshot.vibration)
        origin = self._origin(snapshot)
        return {
            "steps": step_table(snapshot.steps, origin),
            "events": event_table(snapshot.steps, origin),
            "sound": self._envelope(snapshot),
            "scope": snapshot.vibration[-first % SCOPE_STEP :: SCOPE_STEP],
        }

    def _envelope(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Return the time of each bucket's end and its envelope; an unfinished bucket waits for the next message."""
        rate = snapshot.state.sample_rate
        size = max(1, round(BUCKET * rate))
        missed = self._last is None or snapshot.sound_end - len(snapshot.sound) > self._last.sound_end
        sound = snapshot.sound if missed else np.concatenate([self._rest, snapshot.sound])
        # Buckets start at multiples of their size since the run began, also after sound was missed.
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
