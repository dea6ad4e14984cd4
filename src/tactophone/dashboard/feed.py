"""One viewer's place in a run: what is new since the last message."""

import time
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.dashboard.message import BUCKET, SCOPE_STEP, envelope, pack, tick_table, words
from tactophone.errors import TactophoneError
from tactophone.telemetry import Request, Snapshot, Watcher

WHOLE_EVERY = 0.2
"""Seconds between messages with state, counters and gauges: as fast as anybody reads figures."""

SEEK_EVERY = 0.5
"""Seconds between looks for a run that has not begun yet, or has ended and may begin anew."""


class Run:
    """The run that is watched, whether it is there or not: one that begins anew is found again."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._watcher: Watcher | None = None
        self._alive = False
        self._sought = -SEEK_EVERY

    def snapshot(self, since: Snapshot | None = None) -> Snapshot | None:
        """Look at the run; ``None`` while there is none."""
        if not self._alive:
            self._seek(time.monotonic())
        if self._watcher is None:
            return None
        snapshot = self._watcher.snapshot(since)
        self._alive = snapshot.alive
        return snapshot

    def ask(self, request: Request) -> None:
        """Pass a request on, if there is a run to pass it to."""
        if self._watcher is not None:
            self._watcher.ask(request.action, request.value, text=request.text)

    def _seek(self, now: float) -> None:
        if now - self._sought < SEEK_EVERY:
            return
        self._sought = now
        with suppress(TactophoneError):
            self._watcher = Watcher(self.name)


class Feed:
    """Makes one viewer's messages; each goes on where the last one ended, however long ago that was."""

    def __init__(self, run: Run) -> None:
        self._run = run
        self._forget()

    def _forget(self) -> None:
        self._last: Snapshot | None = None
        self._rest = np.zeros((0, 2), np.float32)
        self._offset = 0.0
        self._whole_at = -WHOLE_EVERY

    def message(self) -> bytes:
        """Give what is new."""
        snapshot = self._run.snapshot(self._last)
        if snapshot is None:
            return pack({"alive": False, "waiting_for": self._run.name}, {})
        if self._last is not None and snapshot.tick_end < self._last.tick_end:
            self._forget()
        now = time.monotonic()
        whole = now - self._whole_at >= WHOLE_EVERY
        self._whole_at = now if whole else self._whole_at
        origin, tables = self._origin(snapshot), self._tables(snapshot)
        self._last = snapshot
        return pack({**words(snapshot, whole=whole), "origin": origin}, tables)

    def _tables(self, snapshot: Snapshot) -> dict[str, NDArray[Any]]:
        first = snapshot.vibration_end - len(snapshot.vibration)
        return {
            "ticks": tick_table(snapshot.ticks, self._origin(snapshot)),
            "sound": self._envelope(snapshot),
            "scope": snapshot.vibration[-first % SCOPE_STEP :: SCOPE_STEP],
        }

    def _envelope(self, snapshot: Snapshot) -> NDArray[np.float64]:
        """Time of each bucket's end, then its envelope; what fills no bucket yet waits for the next message."""
        rate = snapshot.state.sample_rate
        size = max(1, round(BUCKET * rate))
        missed = self._last is None or snapshot.sound_end - len(snapshot.sound) > self._last.sound_end
        sound = snapshot.sound if missed else np.concatenate([self._rest, snapshot.sound])
        sound = sound[-(snapshot.sound_end - len(sound)) % size :]
        count = len(sound) // size
        self._rest = sound[count * size :]
        ends = -len(self._rest) - size * np.arange(count)[::-1]
        return np.column_stack([ends / rate, envelope(sound[: count * size], size)])

    def _origin(self, snapshot: Snapshot) -> float:
        """Stream time at the newest sound."""
        rate = snapshot.state.sample_rate
        if len(snapshot.ticks):
            newest = snapshot.ticks[-1]
            self._offset = float(newest["time"]) - int(newest["sound_end"]) / rate
        return self._offset + snapshot.sound_end / rate
