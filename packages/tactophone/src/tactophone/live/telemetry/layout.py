"""What telemetry holds, and its layout in shared memory.

One writer, many readers, no lock. Three kinds of fields make that safe:

- *counters and gauges* are single aligned 8-byte words, which are written and read
  atomically;
- *ring buffers* (sound, vibration, steps, predictions) are written first and counted
  after. A reader copies the rows, reads the count again and drops the rows that the
  writer may have overwritten meanwhile;
- *texts* (the state) have two slots: the writer fills the slot that is not current and
  then increments the count. A writer that dies half way leaves the older text intact.

Beware: readers rely on stores becoming visible in program order, which x86 guarantees.
On other processors a reader may rarely see a torn row of a ring buffer; nothing that
controls vibration is read from here.

The names of counters and gauges follow WebRTC's statistics and RFC 3550 where those
have one. Only the names listed here can be counted, so a reader knows the whole list
beforehand.
"""

import functools
import json
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import Literal, Self, TypeAlias, get_args

import msgspec
import numpy as np

from tactophone.core.microphones import MICROPHONES
from tactophone.core.prediction_fields import PREDICTION_FIELDS
from tactophone.core.types import LIVE_SAMPLE_RATE

COUNTERS: dict[str, str] = {
    "packets_sent": "packets sent to the peer",
    "packets_received": "authentic packets received",
    "packets_lost": "packets that were never received, or too late to be used",
    "packets_late": (
        "authentic packets received after their place was filled, and dropped"
    ),
    "packets_duplicated": "authentic packets received more than once",
    "packets_reordered": "authentic packets received after a newer one",
    "packets_rejected": (
        "datagrams that failed authentication: forged, replayed, damaged or foreign"
    ),
    "packets_broken": "authentic packets that could not be parsed or decoded",
    "packets_recovered": "lost packets recovered from redundancy in the next ones",
    "packets_concealed": "lost packets whose sound was concealed",
    "packets_skipped": (
        "authentic packets too old for a prediction, after a stall of the link"
    ),
    "samples_received": "samples of sound decoded, concealed ones included",
    "samples_concealed": "samples of sound that were concealed",
    "handshakes": "encrypted sessions started",
    "link_losses": "times the session with the peer ended",
    "steps": "pipeline steps",
    "predictions": "windows classified",
    "callbacks": "periods of vibration that the sound device requested",
    "xruns": "periods that the sound device lost",
    "callback_faults": "periods filled with silence because the callback failed",
    "capture_overflows": (
        "blocks of microphone sound dropped because they were not fetched in time"
    ),
    "device_losses": "times a sound device or its server went away",
    "sound_faults": "blocks of sound with NaN or infinite samples",
    "model_faults": "outputs of the model that were not probabilities",
    "command_faults": "commands for the actuator with NaN or infinite values",
    "stale_fades": "times the vibration faded because no new command arrived",
    "emergency_stops": "emergency stops",
    "requests_refused": "requests from a page or another process that were refused",
    "process_restarts": "times a process that stalled or died was replaced",
}
"""Totals since the start of the process, with the description that a user reads."""

STAGES = (
    "capture",
    "encode",
    "network",
    "playout",
    "decode",
    "detect",
    "render",
    "device",
)
"""The latency budget from microphone to actuator; each stage has a gauge
``latency_<stage>``, its median in seconds."""

MARKS = ("captured", "sent", "received", "released", "decoded", "detected", "rendered")
"""Points that a block of sound passes, each recorded with the RTP timestamp at which
the block ends. The time between two successive points is a stage of the budget."""

GAUGES: dict[str, str] = {
    "jitter": "interarrival jitter (RFC 3550, 6.4.1), s",
    "playout_delay": "how long sound waits so that late packets can be used, s",
    "clock_skew_ppm": "how much faster the peer's sound clock runs, ppm",
    "bitrate_bps": "bits per second on the wire, all headers included",
    "loss_ratio": "share of packets lost in the last report interval",
    "redundancy": "earlier packets carried in each packet",
    "round_trip": "round-trip time, s; with several operators, the longest",
    "operators": "operators connected to the robot",
    "output_amplitude": "amplitude of the vibration now, 0-1 of full drive",
    "device_period": "duration of one period of the actuator's device, s",
    "device_latency": "latency reported by the sound device, s",
    **{f"latency_{stage}": f"median time in the stage {stage}, s" for stage in STAGES},
    "latency_total": "median from microphone to vibration, measured end to end, s",
}
"""Values that go up and down, with the description that a user reads; NaN until first
set."""

Action: TypeAlias = Literal[
    "stop",
    "mute",
    "arm",
    "ceiling",
    "output_level",
    "lower_ceiling",
    "lower_output_level",
    "profile",
    "threshold_dbfs",
    "pause",
    "seek",
    "moving",
    "buzz",
]
"""What a watcher may ask of a run; `Request` says what each means."""

ACTIONS: tuple[Action, ...] = get_args(Action)
"""Every action, in the order of the mailbox."""


@dataclass(frozen=True, slots=True)
class Request:
    """A request of a watcher to the runtime; the newest of each action counts."""

    action: Action
    """``stop`` is the emergency stop. ``mute`` and ``arm`` need no value. ``ceiling``
    and ``output_level`` are 0-1 of full drive; a ceiling above the local machine's own
    is refused. ``lower_ceiling`` and ``lower_output_level`` set the lower of this value
    and the present one, and wait in places of their own: whoever may only weaken can
    neither undo a lowering nor take its place. ``threshold_dbfs`` is the contact
    gate's. ``profile`` takes the profile's name in ``text``. A replay alone knows
    ``pause``, 1 or 0, and ``seek``, in s. A robot alone knows ``moving``, 1 or 0:
    whether it moves. ``buzz`` vibrates for a moment at ceiling times output level, so
    that a person feels whether the actuator works and how strong it is; refused while
    muted."""
    value: float = 0.0
    text: str = ""
    time: float = 0.0
    """When the request was made, on the system-wide monotonic clock, in seconds."""
    finger: int = -1
    """Counted from 0; -1 stands for all fingers."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault that is present now: a code for programs, a text with the next step for
    people."""

    code: str
    text: str

    @property
    def end(self) -> str:
        """What to tell people once it is no longer present."""
        return f"over: {self.text}"


def ended_faults(before: Iterable[Fault], now: Iterable[Fault]) -> Iterator[Fault]:
    """Yield the faults that are no longer present; one whose text alone has changed
    still is.

    >>> gone, other = Fault("actuator", "the device is gone"), Fault("link", "no robot")
    >>> [fault.end for fault in ended_faults([gone, other], [other])]
    ['over: the device is gone']
    """
    present = {fault.code for fault in now}
    return (fault for fault in before if fault.code not in present)


@dataclass(frozen=True, slots=True)
class FingerState:
    """The settings of one finger and whether it may vibrate; amplitudes are 0-1 of full
    drive."""

    name: str = ""
    """Empty for the only finger of a run without ``--fingers``."""
    armed: bool = False
    muted_because: str = "starting"
    ceiling: float = 0.0
    local_ceiling: float = 0.0
    output_level: float = 1.0
    profile: str = ""
    detector: str = ""
    threshold_dbfs: float = float("-inf")
    noise_floor_dbfs: float = float("-inf")
    can_buzz: bool = False
    """Whether something here would render ``buzz``."""
    buzzing: bool = False


@dataclass(frozen=True, slots=True)
class RunState:
    """What the running endpoint shows of itself."""

    role: str = ""
    profiles: tuple[str, ...] = ()
    link: str = ""
    source: str = ""
    output: str = ""
    sample_rate: int = LIVE_SAMPLE_RATE
    channels: int = 2
    """Channels of each finger's sound."""
    duration: float = 0.0
    """Length of the recording that a replay plays, in s; 0 for everything live."""
    paused: bool = False
    faults: tuple[Fault, ...] = ()
    fingers: tuple[FingerState, ...] = (FingerState(),)
    """At least one."""

    @property
    def armed(self) -> bool:
        return any(finger.armed for finger in self.fingers)

    @property
    def muted_because(self) -> str:
        """Why the first finger is muted; empty if any finger is armed."""
        return "" if self.armed else self.fingers[0].muted_because

    @classmethod
    def parse(cls, text: bytes) -> Self:
        """Parse the output of `__bytes__`; raises `ValueError` or
        `msgspec.ValidationError` for anything else.

        >>> shown = RunState(faults=(Fault("link", "no sound"),))
        >>> RunState.parse(bytes(shown)).faults[0].code
        'link'
        """
        # msgspec does not parse the text itself, as its JSON has no infinity.
        return msgspec.convert(json.loads(text), cls)

    def __bytes__(self) -> bytes:
        return json.dumps(asdict(self)).encode()


SOUND_CAPACITY = 1 << 17
"""Samples of sound and of vibration kept: 2.7 s at 48 kHz."""

STEP_CAPACITY = 1 << 13
"""Steps kept: 20 s at 400 a second, one for each packet of 2.5 ms."""

PREDICTION_CAPACITY = 1 << 13
"""Predictions kept: 80 s at a hundred a second."""

MARK_CAPACITY = 1 << 12
"""Marks kept of each kind: 10 s of packets of 2.5 ms."""

LOG_CAPACITY = 1 << 21
"""Bytes of the session log kept: 10 s of two microphones as PCM with all headers, and
over a minute as Opus."""

LARGEST_RECORD = 1 << 16
"""Bytes of the largest record of the session log; longer ones are split."""

LARGEST_WRITE = 1 << 14
"""Samples written to a ring buffer before its count is updated: a reader must drop as
many at the old end."""

STATE_SIZE = 1 << 14
"""Bytes for the state as JSON: some forty faults of 300 letters."""

STEP_FIELDS = tuple(field for field in PREDICTION_FIELDS if field.step)
"""Fields of a prediction that each step repeats."""

STEP_RECORD = np.dtype(
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
"""One pipeline step: stream time (s), the counts of sound and vibration at that time,
the newest prediction and command (`PREDICTION_FIELDS`; NaN before the first
prediction). ``event`` is the newest touch event of this step alone. ``truth`` is the
known `Touch`, or -1."""

PREDICTION_RECORD = np.dtype(
    [*((field.name, field.dtype) for field in PREDICTION_FIELDS), ("made", "f8")],
    align=True,
)
"""One prediction and the command computed from it, and when, on the system-wide
monotonic clock, in seconds."""

MARK = np.dtype([("position", "i8"), ("time", "f8")])
"""The RTP timestamp at which a block of sound ends, and the time on the system-wide
monotonic clock, in seconds."""

_TEXT = np.dtype([("size", "u8"), ("text", "u1", STATE_SIZE)])
"""One slot of the state."""

_REQUEST = np.dtype(
    [
        ("count", "u8"),
        ("time", "f8"),
        ("value", "f8"),
        ("size", "u8"),
        ("text", "u1", 64),
    ]
)
"""One slot of the mailbox: how many requests came, and the newest."""

HEAD_SIZE = 32
"""Bytes of the first four fields, which lie at the same place in every layout."""


@functools.cache
def layout_of(fingers: int) -> np.dtype[np.void]:
    """Return the layout for a number of fingers: each finger has its own rings, counts
    and requests, and there is one slot more for requests to all."""
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
            ("steps", STEP_RECORD, (fingers, STEP_CAPACITY)),
            ("predictions", PREDICTION_RECORD, (fingers, PREDICTION_CAPACITY)),
            ("sound", "f4", (fingers, SOUND_CAPACITY, len(MICROPHONES))),
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
