"""The messages to the page: a JSON header, then tables of float32, in a binary message.

::

    uint32   length of the header, a multiple of four
    header   JSON: "series" names each table with its shape, in the order of the numbers
    numbers  little-endian float32, table after table, row by row

Sound is sent as an envelope, because a screen cannot show 48 000 points a second: the lowest and highest value
and the level of each bucket of `BUCKET` seconds. Times are in s, relative to ``origin`` in stream time.
"""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.telemetry import STEP_FIELDS, Snapshot
from tactophone.types import FloatArray

BUCKET = 0.01
"""Seconds in a bucket of the envelope: narrower than a pixel of the 5 s shown."""

STEP_INTERVAL = 0.01
"""Seconds between steps sent, for the same reason; a packet of 2.5 ms brings four times as many."""

SCOPE_STEP = 12
"""Every twelfth sample of the vibration is sent, 4 kHz: its band ends at 1 kHz."""

STEP_COLUMNS = (*(field.name for field in STEP_FIELDS), "truth")

Tables = Mapping[str, NDArray[Any]]


def pack(header: Mapping[str, Any], tables: Tables) -> bytes:
    """Return a message of a header and its tables.

    >>> message = pack({"age": np.nan}, {"steps": np.zeros((2, 3))})
    >>> message[4:].split(b" ")[0], len(message)
    (b'{"age":null,"series":{"steps":[2,3]}}', 68)
    """
    header = {**header, "series": {name: table.shape for name, table in tables.items()}}
    text = msgspec.json.encode(header, enc_hook=float)  # NaN and infinity become null
    text += b" " * (-len(text) % 4)
    numbers = (np.ascontiguousarray(table, "<f4").tobytes() for table in tables.values())
    return b"".join((len(text).to_bytes(4, "little"), text, *numbers))


def header(snapshot: Snapshot, *, full: bool) -> dict[str, Any]:
    """Return the header of a message; a ``full`` one has the state of run and finger, all counters and all gauges."""
    entries: dict[str, Any] = {"alive": snapshot.alive, "age": snapshot.age}
    if full:
        state = {**asdict(snapshot.state), **asdict(snapshot.finger)}
        entries |= {"state": state, "counters": snapshot.counters, "gauges": snapshot.gauges}
    return entries


def envelope(sound: FloatArray, size: int) -> NDArray[np.float64]:
    """Reduce sound to the low, high and level (dBFS) of each channel in each bucket of ``size`` samples.

    Shape ``(samples, channels)`` in; out ``(buckets, 3 * channels)``: low, high, level of channel 0, then of channel 1.

    >>> envelope(np.full((480, 1), 0.1, np.float32), 480).round(3).tolist()
    [[0.1, 0.1, -20.0]]
    """
    buckets = sound.reshape(-1, size, sound.shape[1]).astype(np.float64)
    level = 10 * np.log10(np.maximum(np.mean(buckets**2, axis=1), 1e-12))
    return np.stack([buckets.min(axis=1), buckets.max(axis=1), level], axis=2).reshape(len(buckets), 3 * sound.shape[1])


def step_table(steps: NDArray[np.void], origin: float) -> NDArray[np.float64]:
    """Return rows of time and `STEP_COLUMNS`, at most one every `STEP_INTERVAL`; the newest step is always included."""
    slots = np.floor(steps["time"] / STEP_INTERVAL)
    chosen = steps[np.append(np.flatnonzero(np.diff(slots)), len(steps) - 1)] if len(steps) else steps
    columns = {name: chosen[name] for name in STEP_COLUMNS}
    columns["frequency"] = np.where(chosen["amplitude"] > 0, chosen["frequency"], 0)  # silence has no frequency
    return np.column_stack([chosen["time"] - origin, *columns.values()])


def event_table(steps: NDArray[np.void], origin: float) -> NDArray[np.float64]:
    """Return rows of time and kind, counted from 1 in `EVENT_KINDS`, of the steps with a touch event."""
    found = steps[steps["event"] > 0]
    return np.column_stack([found["time"] - origin, found["event"]])
