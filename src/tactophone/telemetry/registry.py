"""What telemetry can tell, by name: counters, gauges, the state and the requests.

The names follow WebRTC's statistics and RFC 3550 where those have one. A name that is not here cannot be counted:
a reader knows the whole list beforehand.
"""

import json
from dataclasses import asdict, dataclass, field
from typing import Literal, Self, TypeAlias, get_args

COUNTERS: dict[str, str] = {
    "packets_sent": "packets that left for the other side",
    "packets_received": "packets that arrived and were genuine",
    "packets_lost": "packets that never came, or came too late to be used",
    "packets_late": "genuine packets that came after their turn and were dropped",
    "packets_duplicated": "genuine packets that came more than once",
    "packets_reordered": "genuine packets that came after a younger one",
    "packets_rejected": "datagrams that were not genuine: forged, replayed, damaged or foreign",
    "packets_broken": "genuine packets that could not be understood",
    "packets_recovered": "lost packets whose sound came redundantly in the next ones",
    "packets_concealed": "lost packets whose sound was guessed",
    "packets_skipped": "genuine packets too old to be judged, after a stall of the link",
    "samples_received": "samples of sound decoded, guesses included",
    "samples_concealed": "samples of sound that were guessed",
    "handshakes": "sealed sessions begun",
    "link_losses": "times the other side fell silent",
    "ticks": "steps of the receiving side",
    "predictions": "windows judged",
    "callbacks": "times the sound device asked for vibration",
    "xruns": "periods that the sound device lost",
    "callback_faults": "periods answered with silence because the callback failed",
    "capture_overflows": "blocks of microphone sound dropped because they were not fetched in time",
    "device_losses": "times a sound device or its server went away",
    "sound_faults": "blocks of sound that were not numbers",
    "model_faults": "answers of the detector that were not probabilities",
    "command_faults": "commands for the actuator that were not numbers",
    "stale_fades": "times the vibration faded because commands stopped coming",
    "emergency_stops": "emergency stops",
    "requests_refused": "requests from a page or another process that were not granted",
    "process_restarts": "times the watchdog ended a stalled process and began a new one",
}
"""Things that only ever grow, each with the words for a reader."""

STAGES = ("capture", "encode", "network", "playout", "decode", "judge", "render", "device")
"""The latency budget in the order of the walk; each has a gauge ``latency_<stage>``, its median in seconds."""

MARKS = ("captured", "sent", "received", "released", "decoded", "judged", "rendered")
"""Moments in the life of a stretch of sound, each noted with the RTP timestamp at which that stretch ends; what lies
between two of them is a stage of the budget."""

GAUGES: dict[str, str] = {
    "jitter": "interarrival jitter (RFC 3550, 6.4.1), s",
    "playout_delay": "how long sound waits so that late packets can still be used, s",
    "clock_skew_ppm": "how much faster the other side's sound clock runs, millionths",
    "bitrate_bps": "bits a second on the wire, all headers included",
    "loss_ratio": "share of packets lost in the last seconds",
    "redundancy": "earlier packets carried in each packet",
    "round_trip": "to the other side and back, s",
    "output_amplitude": "amplitude of the vibration now, 0-1 of full drive",
    "device_period": "sound that the actuator's device asks for at once, s",
    "device_latency": "what the sound device says of its own delay, s",
    **{f"latency_{stage}": f"median time in the stage {stage}, s" for stage in STAGES},
    "latency_total": "median from microphone to vibration, measured from end to end, s",
}
"""Things that go up and down, each with the words for a reader; NaN until first set."""

Action: TypeAlias = Literal["stop", "mute", "arm", "ceiling", "output_level", "profile", "threshold_dbfs"]
ACTIONS: tuple[Action, ...] = get_args(Action)


@dataclass(frozen=True, slots=True)
class Request:
    """Something that a watcher asks of the runtime; the newest of each action counts.

    Parameters
    ----------
    action
        ``stop`` is the emergency stop. ``mute`` and ``arm`` need no value. ``ceiling`` and ``output_level`` are 0-1 of
        full drive, and a ceiling over the local machine's own is refused. ``threshold_dbfs`` is the contact gate's;
        ``profile`` is given by name in ``text``.
    time
        When it was asked, on the system-wide monotonic clock, in seconds.
    """

    action: Action
    value: float = 0.0
    text: str = ""
    time: float = 0.0


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that is wrong now: a code for programs, words (with what to do) for people."""

    code: str
    text: str
    since: float = 0.0


@dataclass(frozen=True, slots=True)
class State:
    """How the running side is set and whether it may vibrate; amplitudes are 0-1 of full drive."""

    role: str = ""
    armed: bool = False
    muted_because: str = "starting"
    ceiling: float = 0.0
    local_ceiling: float = 0.0
    output_level: float = 1.0
    profile: str = ""
    profiles: tuple[str, ...] = ()
    detector: str = ""
    threshold_dbfs: float = float("-inf")
    noise_floor_dbfs: float = float("-inf")
    link: str = ""
    source: str = ""
    output: str = ""
    sample_rate: int = 48_000
    channels: int = 2
    faults: tuple[Fault, ...] = field(default=())

    @classmethod
    def parse(cls, text: bytes) -> Self:
        """Read what `__bytes__` wrote.

        >>> State.parse(bytes(State(faults=(Fault("link", "no sound"),)))).faults[0].code
        'link'
        """
        entries = json.loads(text)
        entries["profiles"] = tuple(entries["profiles"])
        entries["faults"] = tuple(Fault(**fault) for fault in entries["faults"])
        return cls(**entries)

    def __bytes__(self) -> bytes:
        return json.dumps(asdict(self)).encode()
