"""The side that is watched: a process that writes what it hears, believes and does, and reads what is asked of it."""

import math
from contextlib import suppress
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tactophone.telemetry import memory as layout
from tactophone.telemetry.memory import TICK, Memory
from tactophone.telemetry.registry import ACTIONS, COUNTERS, GAUGES, Request, State
from tactophone.types import FloatArray, PipelineStep

_COUNTER = {name: index for index, name in enumerate(COUNTERS)}
_GAUGE = {name: index for index, name in enumerate(GAUGES)}

_UNJUDGED = np.zeros((), TICK)
_UNJUDGED["probabilities"] = _UNJUDGED["roughness"] = math.nan
_UNJUDGED["level_dbfs"] = -math.inf


class Telemetry:
    """Write what may be watched; every call is short, takes no lock and never waits.

    Each counter, each gauge and each ring has *one* writing thread at most: adding to a counter from two threads
    can lose one of the additions.

    Parameters
    ----------
    name
        Under which others watch this run.

    Examples
    --------
    >>> with Telemetry("doctest-writer") as telemetry:
    ...     telemetry.count("packets_received", 3)
    ...     telemetry.counter("packets_received")
    3
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._memory = Memory(name, create=True)
        self._counters = self._memory["counters"]
        self._gauges = self._memory["gauges"]
        self._memory["ticks"][-1] = _UNJUDGED  # the row before the first
        self._seen = np.zeros(len(ACTIONS), np.uint64)
        self.state = State()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def count(self, name: str, n: int = 1) -> None:
        """Add to a counter of `COUNTERS`."""
        self._counters[_COUNTER[name]] += np.uint64(n)

    def counter(self, name: str) -> int:
        """Read a counter back."""
        return int(self._counters[_COUNTER[name]])

    def gauge(self, name: str, value: float) -> None:
        """Set a gauge of `GAUGES`."""
        self._gauges[_GAUGE[name]] = value

    def publish(self, tick: PipelineStep, *, now: float, truth: int = -1) -> None:
        """Write one step of the receiving side: its sound, its newest belief and its command.

        Parameters
        ----------
        now
            The system-wide monotonic clock (s): the sign of life that watchers look at.
        truth
            The known `Touch` of this moment, where the sound is simulated or labelled.
        """
        self._append("sound", _stereo(tick.block.samples))
        ring, count = self._memory["ticks"], self._memory["tick_count"]
        index = int(count)
        ring[index % layout.TICK_CAPACITY] = ring[index % layout.TICK_CAPACITY - 1]  # belief and command last on
        row = ring[index % layout.TICK_CAPACITY]
        _fill(row, tick)
        row["sound_end"], row["vibration_end"] = self._memory["sound_count"], self._memory["vibration_count"]
        row["truth"] = truth
        count[...] = index + 1
        self.count("ticks")
        self.count("predictions", len(tick.predictions))
        self._memory["beat"][...] = now

    def feel(self, waveform: FloatArray) -> None:
        """Write what the actuator was just given, shape ``(samples,)``; fit for an audio callback."""
        self._append("vibration", waveform)

    def mark(self, index: int, position: int, *, now: float) -> None:
        """Note that a stretch of sound ending at ``position`` has come to the moment ``MARKS[index]``."""
        count = self._memory["mark_counts"][index : index + 1]
        self._memory["marks"][index, int(count[0]) % layout.MARK_CAPACITY] = (position, now)
        count += np.uint64(1)

    def update(self, state: State, *, now: float) -> None:
        """Show a new state, or the same one as a sign of life."""
        self._memory["beat"][...] = now
        if state == self.state and int(self._memory["state_count"]):
            return
        self.state = state
        text = bytes(state)
        if len(text) > layout.STATE_SIZE:
            raise ValueError(f"the state takes {len(text)} bytes of {layout.STATE_SIZE}: shorten the faults' texts")
        turn = int(self._memory["state_count"]) + 1
        slot = self._memory["states"][turn % 2]
        slot["text"][: len(text)] = np.frombuffer(text, np.uint8)
        slot["size"] = len(text)
        self._memory["state_count"][...] = turn

    def requests(self) -> list[Request]:
        """Empty the mailbox: what has been asked since the last call, oldest first."""
        slots = self._memory["requests"]
        new = np.flatnonzero(slots["count"] != self._seen)
        self._seen[:] = slots["count"]
        found = [request for index in new if (request := _request(int(index), slots[index])) is not None]
        return sorted(found, key=lambda request: request.time)

    def close(self) -> None:
        """End this run's telemetry; its name is free again."""
        self._memory.unlink()

    def _append(self, name: str, samples: FloatArray) -> None:
        ring, count = self._memory[name], self._memory[f"{name}_count"]
        for start in range(0, len(samples), layout.LARGEST_WRITE):
            part = samples[start : start + layout.LARGEST_WRITE]
            index = int(count)
            at = index % layout.SOUND_CAPACITY
            head = min(len(part), layout.SOUND_CAPACITY - at)
            ring[at : at + head] = part[:head]
            ring[: len(part) - head] = part[head:]
            count[...] = index + len(part)


def _stereo(samples: FloatArray) -> FloatArray:
    return samples if samples.shape[1] == 2 else np.repeat(samples[:, :1], 2, axis=1)


def _fill(row: NDArray[np.void], tick: PipelineStep) -> None:
    row["time"] = tick.block.end / tick.block.sample_rate
    row["concealed"] = tick.block.concealed
    if tick.predictions:
        belief = tick.predictions[-1]
        row["probabilities"], row["roughness"] = belief.probabilities, belief.roughness
        row["level_dbfs"], row["touch"] = belief.level_dbfs, belief.touch
    if tick.command is not None:
        row["amplitude"], row["frequency"] = tick.command.amplitude, tick.command.frequency


def _request(index: int, slot: NDArray[np.void]) -> Request | None:
    with suppress(UnicodeDecodeError):  # two watchers that write at once can garble a text; it is then nobody's wish
        text = bytes(slot["text"][: int(slot["size"])]).decode()
        return Request(ACTIONS[index], value=float(slot["value"]), text=text, time=float(slot["time"]))
    return None
