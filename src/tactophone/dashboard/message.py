"""What goes to the page: JSON words first, then numbers as float32, in one binary message.

::

    uint32   length of the words, a multiple of four
    words    JSON: "series" names each table with its shape, in the order of the numbers
    numbers  little-endian float32, table after table, row by row

Sound is sent as an envelope, because a screen has no room for 48 000 points a second: for each bucket of
`BUCKET` seconds its lowest and highest value and its level. Times are seconds of the stream, less ``origin``.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.telemetry import Snapshot
from tactophone.types import FloatArray

BUCKET = 0.01
"""Seconds in a bucket of the envelope: less than a pixel of the five seconds shown."""

TICK_STEP = 0.01
"""Seconds between ticks sent, for the same reason; a packet of 2.5 ms brings four times as many."""

SCOPE_STEP = 12
"""Of the vibration, which ends at 1 kHz, one sample in twelve is sent: 4 kHz."""

TICK_COLUMNS = ("none", "smooth", "rough", "roughness", "level_dbfs", "amplitude", "frequency", "touch", "truth")

Tables = Mapping[str, NDArray[Any]]


def pack(words: Mapping[str, Any], tables: Tables) -> bytes:
    """Write one message.

    >>> message = pack({"age": math.nan}, {"ticks": np.zeros((2, 3))})
    >>> message[4:].split(b" ")[0], len(message)
    (b'{"age":null,"series":{"ticks":[2,3]}}', 68)
    """
    told = {**words, "series": {name: table.shape for name, table in tables.items()}}
    text = json.dumps(_finite(told), separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    numbers = (np.ascontiguousarray(table, "<f4").tobytes() for table in tables.values())
    return b"".join((len(text).to_bytes(4, "little"), text, *numbers))


def words(snapshot: Snapshot, *, whole: bool) -> dict[str, Any]:
    """Give what is told in words: always whether the run lives, and on a ``whole`` message all there is to know."""
    told: dict[str, Any] = {"alive": snapshot.alive, "age": snapshot.age}
    if whole:
        told |= {"state": asdict(snapshot.state), "counters": snapshot.counters, "gauges": snapshot.gauges}
    return told


def envelope(sound: FloatArray, size: int) -> NDArray[np.float64]:
    """Reduce each ``size`` samples of sound ``(samples, channels)`` to low, high and level (dBFS) of each channel.

    >>> envelope(np.full((480, 1), 0.1, np.float32), 480).round(3).tolist()
    [[0.1, 0.1, -20.0]]
    """
    buckets = sound.reshape(-1, size, sound.shape[1]).astype(np.float64)
    level = 10 * np.log10(np.maximum(np.mean(buckets**2, axis=1), 1e-12))
    return np.stack([buckets.min(axis=1), buckets.max(axis=1), level], axis=2).reshape(len(buckets), 3 * sound.shape[1])


def tick_table(ticks: NDArray[np.void], origin: float) -> NDArray[np.float64]:
    """Give rows of time and `TICK_COLUMNS`, not more than one every `TICK_STEP`; the newest always."""
    slots = np.floor(ticks["time"] / TICK_STEP)
    chosen = ticks[np.append(np.flatnonzero(np.diff(slots)), len(ticks) - 1)] if len(ticks) else ticks
    columns = {name: chosen[name] for name in TICK_COLUMNS[3:]}
    columns["frequency"] = np.where(chosen["amplitude"] > 0, chosen["frequency"], 0)  # silence has no pitch
    return np.column_stack([chosen["time"] - origin, *chosen["probabilities"].T, *columns.values()])


def _finite(value: Any) -> Any:
    """Put ``None`` where JSON has no number."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
