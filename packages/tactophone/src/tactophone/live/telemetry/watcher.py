"""The reading side of telemetry: another process that reads a run's telemetry and may
send it requests."""

import contextlib
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import TactophoneError
from tactophone.core.types import FloatArray
from tactophone.live.telemetry import layout
from tactophone.live.telemetry.layout import (
    ACTIONS,
    COUNTERS,
    GAUGES,
    MARKS,
    Action,
    FingerState,
    Request,
    RunState,
)
from tactophone.live.telemetry.memory import (
    PREFIX,
    Memory,
    is_alive,
    open_memories,
    own_files,
)
from tactophone.live.telemetry.records import RunStart, read_records
from tactophone.live.telemetry.writer import REQUEST_AGE, request_in

_SILENCING = [ACTIONS.index("stop"), ACTIONS.index("mute")]
"""Slots of the mailbox for what silences a run."""

TELEMETRY_STALE_AFTER = 1.0
"""Seconds without a heartbeat after which a run counts as stalled; a live run updates
it at least every 0.1 s."""

_LARGEST_COUNT = 1 << 62
"""Greatest count that a run can reach: 3 million years of samples."""

# Places of what a `Pulse` holds: a watchdog reads them two hundred times a second.
_CALLBACKS = list(COUNTERS).index("callbacks")
_GAUGE = {name: index for index, name in enumerate(GAUGES)}
_AMPLITUDE = _GAUGE["output_amplitude"]
_PERIOD = _GAUGE["device_period"]


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """A run at one moment."""

    state: RunState
    finger: FingerState
    """State of the finger whose steps, sound and vibration these are."""
    counters: dict[str, int]
    gauges: dict[str, float]
    steps: NDArray[np.void]
    """The newest steps, of dtype `STEP`, ending at the count ``step_end``."""
    sound: FloatArray
    """The newest samples of sound, shape ``(samples, 2)``, ending at ``sound_end``."""
    vibration: FloatArray
    """The newest samples of vibration, shape ``(samples,)``, ending at
    ``vibration_end``."""
    step_end: int
    """Steps since the run began."""
    sound_end: int
    """Samples of sound since the run began."""
    vibration_end: int
    """Samples of vibration since the run began."""
    restarts: int
    """How many processes the `Watcher` has seen replaced. Counts under another number
    of restarts belong to another process."""
    age: float
    """Seconds since the run's last heartbeat."""
    alive: bool
    """Whether the run's process exists and its last heartbeat is newer than
    `TELEMETRY_STALE_AFTER`."""


@dataclass(frozen=True, slots=True)
class Pulse:
    """The few values that a watchdog needs."""

    callbacks: int
    """Callbacks of the device so far."""
    amplitude: float
    """Peak amplitude of the last period, 0 to 1 of full drive."""
    beat: float
    """The last heartbeat on the monotonic clock, in s."""
    period: float = math.nan
    """The device's period in s; NaN if unknown."""


class Watcher:
    """Reads a run from another process and sends it requests; the run never waits for a
    watcher.

    When the run's process was replaced, `follow` goes over to the new one.

    Attributes
    ----------
    restarts
        How often `follow` went over to a new process.

    Examples
    --------
    >>> from tactophone.live.telemetry.writer import Telemetry
    >>> with Telemetry("doctest-watcher") as telemetry:
    ...     telemetry.count("xruns")
    ...     watcher = Watcher("doctest-watcher")
    ...     watcher.ask("mute")
    ...     watcher.snapshot().counters["xruns"], telemetry.requests()[0].action
    (1, 'mute')
    """

    def __init__(self, name: str, *, lost: Path | None = None) -> None:
        self.name = name
        self.restarts: int = 0
        self._memory = Memory(name, create=False, lost=lost)
        self._following: Memory | None = None
        self._predictions_read = [0] * self.fingers

    @classmethod
    def find(cls, name: str) -> Self | None:
        """Return a watcher of a run; ``None`` while it does not exist."""
        with contextlib.suppress(TactophoneError):
            return cls(name)
        return None

    def follow(self, *, drain: bool = True) -> bool:
        """Go over to the process that replaced a dead one; returns whether it did, and
        counts then begin at 0.

        Call it before each read. It goes over one call after it has found the new
        process, so that the read between gets whatever the dead process wrote last;
        without ``drain`` it goes over at once.
        """
        if self._following is None:
            if self.alive or not self._memory.replaced:
                return False
            with contextlib.suppress(TactophoneError):  # gone again
                self._following = Memory(self.name, create=False)
            if drain or self._following is None:
                return False
        self._memory = self._following
        self._following = None
        self._predictions_read = [0] * self.fingers
        self.restarts += 1
        return True

    @property
    def fingers(self) -> int:
        """Number of fingers of the run."""
        return self._memory.fingers

    def finger_names(self) -> list[str]:
        """Return the name of every finger, in order; one empty name without
        ``--fingers``."""
        names = [finger.name for finger in self.state().fingers]
        if not all(names):
            # A run that has just begun has published no state yet.
            names = self._logged_names() or names
        return names if len(names) == self.fingers else [""] * self.fingers

    def _logged_names(self) -> list[str]:
        """Return the fingers' names from the log, which begins with how the run was
        started; empty once that was overwritten."""
        log, count = self.log()
        if len(log) < count:
            return []
        with contextlib.suppress(TactophoneError):
            first = next(read_records(log), None)
            if isinstance(first, RunStart):
                return [finger["name"] for finger in first.fingers]
        return []

    def snapshot(self, since: Snapshot | None = None, *, finger: int = 0) -> Snapshot:
        """Copy the current values; a finger's sound, vibration and steps only as far as
        they are newer than ``since``."""
        known_steps = known_sound = known_vibration = 0
        if since and since.restarts == self.restarts:
            known_steps = since.step_end
            known_sound = since.sound_end
            known_vibration = since.vibration_end
        steps, step_end = self._ring("step", known_steps, finger)
        sound, sound_end = self._ring("sound", known_sound, finger)
        vibration, vibration_end = self._ring("vibration", known_vibration, finger)
        state = self.state()
        counters, gauges = self.totals()
        known = finger < len(state.fingers)
        return Snapshot(
            state=state,
            finger=state.fingers[finger] if known else FingerState(),
            counters=counters,
            gauges=gauges,
            steps=steps,
            sound=sound,
            vibration=vibration,
            step_end=step_end,
            sound_end=sound_end,
            vibration_end=vibration_end,
            restarts=self.restarts,
            age=self._age,
            alive=self.alive,
        )

    @property
    def pid(self) -> int:
        """Process id of the writing process."""
        return int(self._memory["pid"])

    @property
    def inode(self) -> int:
        """Number of the run's memory, which two runs of one name do not share."""
        return self._memory.inode

    @property
    def exists(self) -> bool:
        """Whether the run's process exists, though it may stand still. It takes about a
        millisecond, as the process's memory map is read: `alive` is for often."""
        return self._memory.written

    @property
    def alive(self) -> bool:
        """Whether the process exists and has shown a sign of life lately."""
        return self._age < TELEMETRY_STALE_AFTER and is_alive(self.pid)

    @property
    def _age(self) -> float:
        return time.monotonic() - float(self._memory["beat"])

    def predictions(
        self, since: int = 0, *, finger: int = 0
    ) -> tuple[NDArray[np.void], int]:
        """Copy a finger's predictions after the first ``since``, of dtype `PREDICTION`,
        and return their total count.

        Fewer than ``total - since`` rows mean that the rest was overwritten before this
        call.
        """
        return self._ring("prediction", since, finger)

    def new_predictions(self, *, finger: int = 0) -> tuple[NDArray[np.void], int]:
        """Copy a finger's predictions since the last call; return them, and how many
        were overwritten before it."""
        since = self._predictions_read[finger]
        rows, self._predictions_read[finger] = self.predictions(since, finger=finger)
        return rows, max(0, self._predictions_read[finger] - since - len(rows))

    def log(self, since: int = 0) -> tuple[bytes, int]:
        """Copy the records of the session log after its first ``since`` bytes, and
        return its total length.

        The records are whole, or none is returned: where part of them was overwritten
        before this call, what is left begins within a record. Fewer bytes than
        ``total - since`` therefore mean that all of these records are lost, and the
        next call with ``since=total`` begins at a record.
        """
        rows, total = _newest(
            self._memory["log"],
            self._memory["log_count"],
            slack=layout.LARGEST_RECORD,
            since=since,
        )
        # A total below ``since`` belongs to a new run, read from its beginning.
        wanted = total - since if since <= total else total
        whole = len(rows) == wanted
        return rows.tobytes() if whole else b"", total

    @property
    def log_length(self) -> int:
        """Bytes of the session log since the run began."""
        return int(self._memory["log_count"].item())

    @property
    def knows_its_start(self) -> bool:
        """Whether `log` still returns the run from its start, which a replay needs."""
        kept = len(self._memory["log"]) - layout.LARGEST_RECORD
        return self.log_length <= kept

    def state(self) -> RunState:
        """Return the newest state alone."""
        while turn := int(self._memory["state_count"]):
            slot = self._memory["states"][turn % 2]
            text = bytes(slot["text"][: min(int(slot["size"]), layout.STATE_SIZE)])
            if int(self._memory["state_count"]) == turn:
                # Overwritten memory holds anything; the writer repairs it at its next
                # update.
                with contextlib.suppress(
                    ValueError, msgspec.ValidationError, RecursionError
                ):
                    return RunState.parse(text)
                break
        return RunState()

    @property
    def silenced(self) -> int:
        """How often the run was asked to stop or to mute, by anybody, a signal
        included; equal to an earlier number if nobody has since."""
        return int(self._memory["requests"][_SILENCING]["count"].sum())

    @property
    def silenced_at(self) -> float:
        """When the run was last asked to stop or to mute, as `silenced` counts, in s of
        the monotonic clock; 0 for never."""
        return float(self._memory["requests"][_SILENCING]["time"].max())

    def totals(self) -> tuple[dict[str, int], dict[str, float]]:
        """Return all counters and gauges, by name."""
        counters = zip(COUNTERS, self._memory["counters"].tolist(), strict=True)
        gauges = zip(GAUGES, self._memory["gauges"].tolist(), strict=True)
        return dict(counters), dict(gauges)

    def pulse(self) -> Pulse:
        """Read the values of a `Pulse`; cheap enough for the watchdog's two hundred
        calls a second."""
        counters = self._memory["counters"]
        gauges = self._memory["gauges"]
        return Pulse(
            int(counters[_CALLBACKS]),
            float(gauges[_AMPLITUDE]),
            float(self._memory["beat"]),
            float(gauges[_PERIOD]),
        )

    def newest_step(self, *, finger: int = 0) -> NDArray[np.void] | None:
        """Copy a finger's newest step; ``None`` before the first."""
        count = int(self._memory["step_count"][finger])
        steps, end = self._ring("step", max(0, count - 1), finger)
        return steps[-1:] if end and len(steps) else None

    def gauge(self, name: str) -> float:
        """Read one gauge of `GAUGES`."""
        return float(self._memory["gauges"][_GAUGE[name]])

    def marks(self, name: str) -> NDArray[np.void]:
        """Copy the newest marks of one kind of `MARKS`, of dtype `MARK`."""
        index = MARKS.index(name)
        rows, _ = _newest(
            self._memory["marks"][index],
            self._memory["mark_counts"][index : index + 1],
            slack=1,
        )
        return rows

    def ask(
        self, action: Action, value: float = 0.0, *, text: str = "", finger: int = -1
    ) -> None:
        """Put a request for all fingers, or one, into the mailbox; `RunState` shows the
        outcome.

        It replaces an older one of the same action for the same finger.
        """
        slot = self._memory["requests"][ACTIONS.index(action), 1 + finger]
        encoded = np.frombuffer(text.encode(), np.uint8)
        if len(encoded) > len(slot["text"]):
            raise ValueError(
                f"{action}: {text!r} is longer than {len(slot['text'])} bytes"
            )
        slot["text"][: len(encoded)] = encoded
        slot["size"] = len(encoded)
        slot["value"] = value
        slot["time"] = time.monotonic()
        slot["count"] += np.uint64(1)

    def left_requests(self) -> list[Request]:
        """Return what a process that has ended may not have come to, oldest first: the
        newest request of each action and finger, made in its last `REQUEST_AGE` s or
        since."""
        slots = self._memory["requests"]
        found = []
        for action, place in np.argwhere(slots["count"]).tolist():
            with contextlib.suppress(UnicodeDecodeError):
                slot = slots[action, place]
                found.append(request_in(slot, ACTIONS[action], place - 1))
        since = float(self._memory["beat"]) - REQUEST_AGE
        recent = [request for request in found if request.time >= since]
        return sorted(recent, key=lambda request: request.time)

    def _ring(self, name: str, since: int, finger: int) -> tuple[NDArray[Any], int]:
        by_row = name in ("step", "prediction")
        rows = self._memory[f"{name}s" if by_row else name][finger]
        slack = 1 if by_row else layout.LARGEST_WRITE
        return _newest(
            rows,
            self._memory[f"{name}_count"][finger : finger + 1],
            slack=slack,
            since=since,
        )


def _newest(
    rows: NDArray[Any], count: NDArray[Any], *, slack: int, since: int = 0
) -> tuple[NDArray[Any], int]:
    """Copy the rows from ``since`` to the count, without those that the writer may
    overwrite meanwhile."""
    end = int(count.item())
    if end > _LARGEST_COUNT:
        # The memory was overwritten: its rows mean nothing until the writer counts on.
        return rows[:0].copy(), since
    # A count below `since` belongs to a new run: all of its rows are new.
    first_wanted = since if since <= end else 0
    # The writer may be filling up to `slack` rows.
    oldest_valid = end + slack - len(rows)
    start = max(first_wanted, oldest_valid, 0)
    # The remainder is computed here, as `mode="wrap"` subtracts the length until the
    # index fits: the longer the run, the slower.
    copy: NDArray[Any] = rows.take(np.arange(start, end) % len(rows), axis=0)
    # The count has moved on during the copy: the rows that it has reached since are not
    # valid.
    overwritten = int(count.item()) + slack - len(rows) - start
    return copy[max(overwritten, 0) :], end


def runs(name: str = "") -> Iterator[Watcher]:
    """Yield a watcher of each run on this machine whose process exists, or of those
    called ``name`` alone; each as soon as it is found.

    The run whose name is given comes first, then what processes have open, which finds
    memory that has lost its name, then the folder, which other users may have filled.
    """
    files = ((path.name.removeprefix(PREFIX), None) for path in own_files())
    places: Iterator[tuple[str, Path | None]] = (
        chain([(name, None)], open_memories())
        if name
        else chain(open_memories(), files)
    )
    seen = set[int]()
    for found, lost in places:
        if name in ("", found):
            with contextlib.suppress(TactophoneError):
                watcher = Watcher(found, lost=lost)
                if watcher.inode not in seen and watcher.exists:
                    seen.add(watcher.inode)
                    yield watcher


def running() -> list[str]:
    """Return the names of the runs on this machine whose processes exist.

    >>> from tactophone.live.telemetry.writer import Telemetry
    >>> with Telemetry("doctest-running"):
    ...     "doctest-running" in running()
    True
    """
    return sorted({watcher.name for watcher in runs()})
