"""All settings as frozen dataclasses, read from TOML and checked.

A TOML file overrides the defaults, and ``--set section.name=value`` overrides the file. Each setting carries its unit,
its range and the words that ``--help`` and ``tactophone settings`` show, so that they stand in one place.
"""

import dataclasses
import math
import sys
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tactophone.errors import ConfigError, did_you_mean
from tactophone.types import DEFAULT_CEILING, DEFAULT_TIP, TIP_NAMES

_ANY = (-math.inf, math.inf)


def _setting(default: Any, words: str, *, unit: str = "", span: tuple[float, float] = _ANY) -> Any:
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
    prediction_payload: str = _choice(
        "tactophone",
        "form in which predictions are sent: all of each in 16 bytes, or as vibration in the RTP payload for haptics",
        ("tactophone", "rfc9993"),
    )


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
    """Everything that can be set; one TOML table per field, but for the fingers.

    Examples
    --------
    >>> change(Settings(), ["link.packet_duration=0.0025", "capture.source=finger"]).link.packet_duration
    0.0025
    """

    capture: Capture = Capture()
    link: Link = Link()
    detector: Detector = Detector()
    rendering: Rendering = Rendering()
    output: Output = Output()
    actuator: Actuator = Actuator()
    process: Process = Process()
    fingers: tuple[Finger, ...] = ()
    """Of a hand, in the order of the link's channels; none: the one finger that the tables above describe."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One setting, for help texts: its dotted name, default, words with range, and unit."""

    name: str
    default: Any
    words: str
    unit: str = ""
    choices: tuple[Any, ...] = ()


def entries() -> Iterator[Entry]:
    """Return all settings in the order of the file."""
    for section in _section_names():
        for entry in dataclasses.fields(type(getattr(Settings(), section))):
            meta = entry.metadata
            words = f"{meta['words']}{_range(meta.get('span', _ANY), meta.get('unit', ''))}"
            yield Entry(f"{section}.{entry.name}", entry.default, words, meta.get("unit", ""), meta.get("choices", ()))


def read(path: Path, settings: Settings | None = None) -> Settings:
    """Read a TOML file over the defaults, or over other settings.

    Raises `ConfigError` when the file cannot be read, or holds an unknown setting or a value out of range.
    """
    settings = settings or Settings()
    tables = read_tables(
        path,
        missing=f"`tactophone settings > {path}` writes one to begin with",
        outside=f"write it under one of {_sections()}",
    )
    for section, table in tables.items():
        for name, value in table.items():
            settings = replace(settings, f"{section}.{name}", value, where=str(path))
    return settings


def read_tables(path: Path, *, missing: str, outside: str) -> dict[str, Mapping[str, Any]]:
    """Read a TOML file that holds tables alone.

    ``missing`` and ``outside`` end the error messages about a file that cannot be read, and an entry outside a table.
    Raises `ConfigError` in either case, or if the file is no TOML.
    """
    try:
        tables = tomllib.loads(path.read_text())
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; {missing}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path} is not TOML: {error}") from None
    for name, table in tables.items():
        if not isinstance(table, Mapping):
            raise ConfigError(f"{path}: {name} stands outside a table; {outside}")
    return tables


def change(settings: Settings, assignments: Iterable[str]) -> Settings:
    """Apply ``section.name=value`` assignments; a value that is not TOML is taken as plain text."""
    defaults = {entry.name: entry.default for entry in entries()}
    for assignment in assignments:
        name, equals, text = assignment.partition("=")
        if not equals:
            raise ConfigError(f"--set {assignment}: wanted section.name=value, such as link.port=48470")
        value = _value(text.strip())
        if isinstance(defaults.get(name.strip()), str) and not isinstance(value, str):
            value = text.strip()  # a device may be named "3"
        settings = replace(settings, name.strip(), value, where="--set")
    return settings


def replace(settings: Settings, name: str, value: Any, *, where: str) -> Settings:
    """Change the setting of a dotted name, checked; ``where`` is its origin, for the error message."""
    section, _, key = name.partition(".")
    known = {entry.name: entry for entry in entries()}
    if name not in known:
        hint = did_you_mean(name, known) or f"; sections are {_sections()}"
        raise ConfigError(f"{where}: there is no setting {name}{hint}")
    table = getattr(settings, section)
    declared = next(entry for entry in dataclasses.fields(table) if entry.name == key)
    checked = _checked(declared, value, f"{where}: {name} = {value!r}")
    return dataclasses.replace(settings, **{section: dataclasses.replace(table, **{key: checked})})


def _checked(declared: "dataclasses.Field[Any]", value: Any, found: str) -> Any:
    kind = type(declared.default)
    if kind is float and type(value) is int:
        # A whole number of more than 308 digits has no float; infinity is then refused by the range.
        value = float(value) if abs(value) < sys.float_info.max else math.inf if value > 0 else -math.inf
    if type(value) is not kind:
        raise ConfigError(f"{found}, but it is a {_KINDS[kind]}")
    choices = declared.metadata.get("choices", ())
    if choices and value not in choices:
        raise ConfigError(f"{found}, but it is one of {', '.join(choices)}{did_you_mean(str(value), choices)}")
    low, high = declared.metadata.get("span", _ANY)
    # NaN is in no range; as a default it means "from the model", and is then allowed.
    unset = kind is float and math.isnan(value) and math.isnan(declared.default)  # type: ignore[arg-type]
    if kind in (int, float) and not low <= value <= high and not unset:
        raise ConfigError(f"{found}, but it is {_range((low, high), declared.metadata['unit']).removeprefix(', ')}")
    return value


_KINDS = {str: "text", int: "whole number", float: "number", bool: "switch: true or false"}


def _range(span: tuple[float, float], unit: str) -> str:
    if math.isinf(span[0]):
        return f", {unit}" if unit else ""
    return f", {span[0]:g} to {span[1]:g} {unit}".rstrip()


def _value(text: str) -> Any:
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text


def _sections() -> str:
    return ", ".join(_section_names())


def _section_names() -> list[str]:
    return [section.name for section in dataclasses.fields(Settings) if section.name != "fingers"]
