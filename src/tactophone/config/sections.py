"""The settings, section by section: each with its unit, its range and the words that ``--help`` shows."""

import math
from dataclasses import dataclass, field
from typing import Any

from tactophone.types import DEFAULT_CEILING, DEFAULT_TIP, TIP_NAMES

ANY = (-math.inf, math.inf)
"""The span of a setting without one."""


def _setting(default: Any, words: str, *, unit: str = "", span: tuple[float, float] = ANY) -> Any:
    """Declare a number or a text; numbers lie within ``span``, both ends included."""
    return field(default=default, metadata={"words": words, "unit": unit, "span": span})


def _choice(default: Any, words: str, choices: tuple[Any, ...]) -> Any:
    """Declare a setting with a fixed set of values."""
    return field(default=default, metadata={"words": words, "choices": choices})


@dataclass(frozen=True, slots=True)
class Capture:
    """Where the robot's sound comes from."""

    source: str = _choice(
        "jack",
        "microphones, one plain microphone, that of a page in a browser, a recording, the simulated finger, "
        "or a ROS 2 topic",
        ("jack", "portaudio", "microphone", "browser", "file", "finger", "ros"),
    )
    device: str = _setting(
        "",
        "PortAudio device (name or number), recording to play, seed of the simulated finger, or topic; "
        "empty: the default",
    )
    tip: str = _choice(
        DEFAULT_TIP,
        "tip that touches: it chooses the model where none is named, and is the simulated finger's",
        TIP_NAMES,
    )
    contact: str = _setting("system:capture_1", "JACK port of the contact microphone")
    air: str = _setting("system:capture_2", "JACK port of the air microphone; empty: there is none")
    block_size: int = _setting(128, "block of a file or of the simulated finger", unit="samples", span=(1, 4096))
    loop: bool = _setting(True, "repeat a recording when it ends")


@dataclass(frozen=True, slots=True)
class Link:
    """The network link between robot and operator."""

    peer: str = _setting(
        "", "operator that the robot calls, host or host:port; up to four, by a flag each or with commas"
    )
    host: str = _setting("", "address at which the operator's side listens; empty: all, of IPv4 and IPv6")
    port: int = _setting(48_470, "UDP port of the operator's side", span=(0, 65_535))
    identity: str = _setting("", "folder with this side's key and trusted peers; empty: ~/.config/tactophone")
    codec: str = _choice("opus", "pcm16 for a local network, opus for the rest", ("opus", "pcm16"))
    packet_duration: float = _setting(0.005, "sound in a packet", unit="s", span=(0.0005, 0.02))
    bandwidth: float = _setting(
        0.0, "highest frequency to transmit; 0: as the operator's model needs", unit="Hz", span=(0, 20_000)
    )
    bitrate_bps: int = _setting(
        0,
        "of Opus, both channels of a finger together; 0: by bandwidth and packet duration",
        unit="bit/s",
        span=(0, 510_000),
    )
    redundancy: int = _setting(-1, "earlier packets repeated in each; -1: adapt to the loss", span=(-1, 2))
    send_predictions: bool = _setting(False, "run the detector on the robot and send only its predictions")


@dataclass(frozen=True, slots=True)
class Detector:
    """What classifies the sound."""

    model: str = _setting("", "name of a shipped model, or path of a model file; empty: the shipped model for the tip")
    calibration: str = _setting(
        "", "file written by `tactophone calibrate`: contact threshold and microphone check; empty: none"
    )
    check_microphones: bool = _setting(
        True, "detect faulty microphones and fall back safely; switch off for synthetic test signals"
    )
    threshold_dbfs: float = _setting(
        math.nan,
        "level of the contact gate; nan: from the calibration, or just over the noise floor, which is followed",
        unit="dBFS",
        span=(-120, 0),
    )
    events: bool = _setting(False, "detect taps, strokes and slips too; the profile events always does")


@dataclass(frozen=True, slots=True)
class Rendering:
    """How predictions become vibration, and how strong it may be."""

    profile: str = _setting(
        "paper",
        "rendering profile: paper, perceptual, erm, lra, piezo, dualsense, events; or the sound itself: direct, pitch, "
        "median-frequency",
    )
    ceiling: float = _setting(
        DEFAULT_CEILING,
        "greatest amplitude; a profile that asks for more is scaled down as a whole",
        unit="of full drive",
        span=(0, 1),
    )
    output_level: float = _setting(1.0, "volume below the ceiling", unit="of the profile's amplitude", span=(0, 1))
    muted: bool = _setting(False, "start muted, until armed")


@dataclass(frozen=True, slots=True)
class Output:
    """Where the vibration goes."""

    actuator: str = _choice(
        "jack",
        "device that drives the actuator, the motors of a gamepad, a WAV file, or nothing",
        ("jack", "portaudio", "gamepad", "file", "none"),
    )
    device: str = _setting(
        "", "PortAudio device (name or number), gamepad (name), or the WAV file to write; empty: the default"
    )
    channel: int = _setting(
        1, "output channel of the PortAudio device, counted from 1; 3 or 4 on a DualSense", span=(1, 64)
    )
    port: str = _setting("system:playback_1", "JACK port of the actuator's amplifier")
    period: int = _setting(128, "period of the actuators file and none", unit="samples", span=(16, 4096))


@dataclass(frozen=True, slots=True)
class Actuator:
    """What the actuator can play, for the profiles perceptual, erm, lra, piezo and dualsense: `devices measure`."""

    resonance: float = _setting(math.nan, "resonance; nan: typical of the profile", unit="Hz", span=(10, 2000))
    lowest: float = _setting(math.nan, "lower end of its band; nan: the profile's", unit="Hz", span=(10, 2000))
    highest: float = _setting(math.nan, "upper end of its band; nan: the profile's", unit="Hz", span=(10, 2000))
    slowest: float = _setting(math.nan, "lowest speed of a rotating motor; nan: typical", unit="Hz", span=(1, 1000))
    fastest: float = _setting(
        math.nan, "speed of a rotating motor at full drive; nan: typical", unit="Hz", span=(1, 1000)
    )
    response: str = _setting(
        "", "levels in dB relative to the resonance by frequency in Hz, as in 40:-12,160:0,250:-6; empty: flat"
    )


@dataclass(frozen=True, slots=True)
class Process:
    """Processes, priorities and the watchdog."""

    name: str = _setting("", "name of this run for `stop`, `mute` and `arm`; empty: the verb")
    jack_server: str = _setting("", "JACK server; empty: the default one")
    priority: int = _setting(58, "SCHED_FIFO priority of the network thread; 0: none", span=(0, 95))
    lock_memory: bool = _setting(False, "lock the process in memory (mlockall)")
    watchdog: bool = _setting(True, "silence a late process; kill a stalled one and start a new one, muted")
    stall_timeout: float = _setting(
        0.05,
        "time without a callback, while vibrating, after which a process is late and silenced",
        unit="s",
        span=(0.01, 1),
    )


@dataclass(frozen=True, slots=True)
class Finger:
    """One finger of a hand: its name, and the settings that are its own, by dotted name (`tactophone.hand_file`)."""

    name: str
    settings: tuple[tuple[str, Any], ...] = ()


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything that can be set; one TOML table per field, but for the fingers."""

    capture: Capture = Capture()
    link: Link = Link()
    detector: Detector = Detector()
    rendering: Rendering = Rendering()
    output: Output = Output()
    actuator: Actuator = Actuator()
    process: Process = Process()
    fingers: tuple[Finger, ...] = ()
    """Of a hand, in the order of the link's channels; none: the one finger that the tables above describe."""
