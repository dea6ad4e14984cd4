"""The layout of telemetry in shared memory.

One writer, many readers, no lock. Three kinds of fields make that safe:

- *counters and gauges* are single aligned 8-byte words, which are written and read atomically;
- *ring buffers* (sound, vibration, steps, predictions) are written first and counted after. A reader copies the rows,
  reads the count again and drops the rows that the writer may have overwritten meanwhile;
- *texts* (the state) have two slots: the writer fills the slot that is not current and then increments the count. A
  writer that dies half way leaves the older text intact.

Beware: readers rely on stores becoming visible in program order, which x86 guarantees. On other processors a reader may
rarely see a torn row of a ring buffer; nothing that controls vibration is read from here.
"""

import functools
import zlib

import numpy as np

from tactophone.telemetry.registry import ACTIONS, COUNTERS, GAUGES, MARKS
from tactophone.types import PREDICTION_FIELDS

SOUND_CAPACITY = 1 << 17
"""Samples of sound and of vibration kept: 2.7 s at 48 kHz."""

STEP_CAPACITY = 1 << 13
"""Steps kept: 20 s at 400 a second, one for each packet of 2.5 ms."""

PREDICTION_CAPACITY = 1 << 13
"""Predictions kept: 80 s at a hundred a second."""

MARK_CAPACITY = 1 << 12
"""Marks kept of each kind: 10 s of packets of 2.5 ms."""

LOG_CAPACITY = 1 << 21
"""Bytes of the session log kept: 10 s of two microphones as PCM with all headers, and over a minute as Opus."""

LARGEST_RECORD = 1 << 16
"""Bytes of the largest record of the session log; longer ones are split."""

LARGEST_WRITE = 1 << 14
"""Samples written to a ring buffer before its count is updated: a reader must drop as many at the old end."""

STATE_SIZE = 1 << 14
"""Bytes for the state as JSON: some forty faults of 300 letters."""

STEP_FIELDS = tuple(field for field in PREDICTION_FIELDS if field.step)

STEP = np.dtype(
    [
        ("time", "f8"),
        ("sound_end", "u8"),
        ("vibration_end", "u8"),
        *((field.name, field.dtype.replace("f8", "f4")) for field in STEP_FIELDS),
        ("event", "i1"),
        ("truth", "i1"),
        ("concealed", "?"),
    ],
    align=True,
)
"""One pipeline step: stream time (s), the counts of sound and vibration at that time, the newest prediction and
command (`PREDICTION_FIELDS`; NaN before the first prediction). ``event`` is the newest touch event of this step alone.
``truth`` is the known `Touch`, or -1."""

PREDICTION = np.dtype([(field.name, field.dtype) for field in PREDICTION_FIELDS], align=True)
"""One prediction and the command computed from it."""

MARK = np.dtype([("position", "i8"), ("time", "f8")])
"""The RTP timestamp at which a block of sound ends, and the time on the system-wide monotonic clock, in seconds."""

_TEXT = np.dtype([("size", "u8"), ("text", "u1", STATE_SIZE)])
_REQUEST = np.dtype([("count", "u8"), ("time", "f8"), ("value", "f8"), ("size", "u8"), ("text", "u1", 64)])

HEAD_SIZE = 32
"""Bytes of the first four fields, which lie at the same place in every layout."""


@functools.cache
def layout_of(fingers: int) -> np.dtype[np.void]:
    """Return the layout for so many fingers: rings and their counts are for each, requests for all and for each."""
    return np.dtype(
        [
            ("fingerprint", "u8"),
            ("pid", "u8"),
            ("beat", "f8"),
            ("fingers", "u8"),
            ("step_count", "u8", fingers),
            ("prediction_count", "u8", fingers),
            ("sound_count", "u8", fingers),
            ("vibration_count", "u8", fingers),
            ("log_count", "u8"),
            ("state_count", "u8"),
            ("mark_counts", "u8", len(MARKS)),
            ("counters", "u8", len(COUNTERS)),
            ("gauges", "f8", len(GAUGES)),
            ("requests", _REQUEST, (len(ACTIONS), 1 + fingers)),
            ("states", _TEXT, 2),
            ("steps", STEP, (fingers, STEP_CAPACITY)),
            ("predictions", PREDICTION, (fingers, PREDICTION_CAPACITY)),
            ("sound", "f4", (fingers, SOUND_CAPACITY, 2)),
            ("vibration", "f4", (fingers, SOUND_CAPACITY)),
            ("log", "u1", LOG_CAPACITY),
            ("marks", MARK, (len(MARKS), MARK_CAPACITY)),
        ],
        align=True,
    )


@functools.cache
def fingerprint_of(fingers: int) -> int:
    """Return the number by which readers recognise this layout and these names."""
    names = (tuple(COUNTERS), tuple(GAUGES), MARKS, ACTIONS)
    return zlib.crc32(repr((layout_of(fingers), *names)).encode())
