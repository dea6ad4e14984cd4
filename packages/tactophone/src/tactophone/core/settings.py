"""All settings: frozen dataclasses whose fields carry unit, range, words and flag, read
from TOML and checked.

A TOML file overrides the defaults, an option of the command line the file, and ``--set
section.name=value`` both. What ``--help`` and ``tactophone settings`` show, and which
verb offers which option, stands here beside each setting.
"""

import dataclasses
import math
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.plugins import ACTUATORS, registered
from tactophone.core.small_files import read_small
from tactophone.core.tips import DEFAULT_TIP, TIP_NAMES
from tactophone.core.types import MOST_OPERATORS

VIBRATION_FILE = "vibration.wav"
"""Where the vibration of `--actuator file` goes, unless a file is named."""

DEFAULT_CEILING = 0.5
"""Greatest amplitude of a vibration, 0 to 1 of full drive, unless the user of this
machine allows another."""


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting: its dotted name, default, words, and what may be written.

    A number lies within ``span``, both ends included. The verbs in ``verbs`` have the
    option ``flag`` for it. Where ``device`` names another setting, the option takes
    both, as in ``--source portaudio:3``.
    """

    name: str
    default: Any
    words: str
    unit: str = ""
    span: tuple[float, float] = (-math.inf, math.inf)
    choices: tuple[str, ...] = ()
    flag: str = ""
    verbs: tuple[str, ...] = ()
    device: str = ""
    group: str = ""
    """Entry points of other packages whose names may be written too."""

    @property
    def range(self) -> str:
        """Return the range and the unit, or the choices; empty for a text or a
        switch."""
        if self.choices:
            return f"one of {', '.join(self.choices)}"
        if math.isinf(self.span[0]):
            return self.unit
        return f"{self.span[0]:.10g} to {self.span[1]:.10g} {self.unit}".rstrip()

    @property
    def help(self) -> str:
        if self.choices:
            return f"{self.words}: {', '.join(self.choices)}"
        return ", ".join(filter(None, (self.words, self.range)))

    def check(self, value: Any, *, where: str) -> Any:
        """Return a value as this setting holds it; raises `ConfigError`, which says
        what was wanted."""
        kind = type(self.default)
        # NaN lies in no range; as a default it means "from the model", and may then be
        # written too.
        if _is_nan(value) and _is_nan(self.default):
            return value
        if self.group and value not in self.choices and value in registered(self.group):
            return value
        wanted: Any = Literal[self.choices] if self.choices else kind
        if not math.isinf(self.span[0]):
            wanted = Annotated[
                kind, msgspec.Meta(ge=kind(self.span[0]), le=kind(self.span[1]))
            ]
        try:
            return msgspec.convert(value, wanted)
        except msgspec.ValidationError:
            # A whole number may stand for any number, but True is no number.
            whole = kind is float and type(value) is int
            fits = type(value) is kind or whole
            allowed = self.range if self.choices or fits else f"a {_KINDS[kind]}"
            hint = did_you_mean(str(value), self.choices)
            found = f"{where}: {self.name} = {value!r}, but it is"
            if where == self.flag:
                found = f"{where} {value}: must be"
            raise ConfigError(f"{found} {allowed}{hint}") from None


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


_KINDS = {
    str: "text",
    int: "whole number",
    float: "number",
    bool: "switch: true or false",
}


def _setting(default: Any, words: str, *, verbs: str = "", **rest: Any) -> Any:
    """Declare a setting, and the ``verbs``, with spaces between them, whose option
    changes it; else as `Setting`."""
    setting = Setting("", default, words, verbs=tuple(verbs.split()), **rest)
    return field(default=default, metadata={"setting": setting})


@dataclass(frozen=True, slots=True)
class CaptureSettings:
    """Where the robot's sound comes from."""

    source: str = _setting(
        "jack",
        "where the sound comes from: JACK ports, a PortAudio device, one plain "
        "microphone, the microphone of a page, a recording, the simulated finger, or "
        "a ROS 2 topic",
        choices=("jack", "portaudio", "microphone", "browser", "file", "finger", "ros"),
        flag="--source",
        verbs="answer call check devices loopback record send setup",
        device="capture.device",
    )
    device: str = _setting(
        "",
        "PortAudio device (name or number), recording to play, seed of the simulated "
        "finger, or topic; empty: the default",
    )
    tip: str = _setting(
        DEFAULT_TIP,
        "the finger's tip: it chooses the model unless one is named, and the simulated "
        "finger wears it",
        choices=TIP_NAMES,
        flag="--tip",
        verbs="answer call check demo feel loopback play receive send setup",
    )
    contact: str = _setting("system:capture_1", "JACK port of the contact microphone")
    air: str = _setting(
        "system:capture_2", "JACK port of the air microphone; empty without one"
    )
    block_size: int = _setting(
        128,
        "block of a file or of the simulated finger",
        unit="samples",
        span=(1, 4096),
    )
    loop: bool = _setting(True, "repeat a recording when it ends")


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """The network link between robot and operator."""

    peer: str = _setting(
        "",
        "operator that the robot calls, host or host:port; "
        f"up to {MOST_OPERATORS}, with commas or an option each",
        flag="--peer",
        verbs="send",
    )
    host: str = _setting(
        "", "address at which the operator's side listens; empty: all, of IPv4 and IPv6"
    )
    port: int = _setting(48_470, "UDP port of the operator's side", span=(0, 65_535))
    identity: str = _setting(
        "", "folder with this side's key and trusted peers; empty: ~/.config/tactophone"
    )
    codec: str = _setting(
        "opus",
        "pcm16 for a local network, opus for the rest",
        choices=("opus", "pcm16"),
        flag="--codec",
        verbs="latency send",
    )
    packet_duration: float = _setting(
        0.005,
        "sound in a packet",
        unit="s",
        span=(0.0005, 0.02),
        flag="--packet-duration",
        verbs="latency",
    )
    bandwidth: float = _setting(
        0.0,
        "highest frequency to transmit; 0: as the operator's model needs",
        unit="Hz",
        span=(0, 20_000),
    )
    bitrate_bps: int = _setting(
        0,
        "of Opus, both channels of a finger together; 0: by bandwidth and packet "
        "duration",
        unit="bit/s",
        span=(0, 510_000),
    )
    redundancy: int = _setting(
        -1, "earlier packets repeated in each; -1: adapt to the loss", span=(-1, 2)
    )
    send_predictions: bool = _setting(
        False,
        "run the detector on the robot and send only its predictions",
        flag="--send-predictions",
        verbs="latency send",
    )


@dataclass(frozen=True, slots=True)
class CallSettings:
    """The servers of `tactophone call` and `answer`: docs/guide/apart.md."""

    mailbox: str = _setting(
        "ws://relay.magic-wormhole.io:4000/v1",
        "magic-wormhole mailbox that passes a call's encrypted first words; the "
        "default server is run by a volunteer, without guarantees",
    )
    stun: str = _setting(
        "stun.l.google.com:19302,stun.cloudflare.com:3478",
        "STUN servers, HOST or HOST:PORT with commas between them; from two, --check "
        "learns the kind of router",
    )
    turn: str = _setting(
        "", "TURN relay, USER:PASSWORD@HOST or USER:PASSWORD@HOST:PORT; empty: none"
    )
    relay_only: bool = _setting(
        False,
        "never take a direct way, so that the other end learns no address of this one",
    )


@dataclass(frozen=True, slots=True)
class DetectorSettings:
    """What classifies the sound."""

    model: str = _setting(
        "",
        "name of a shipped model, or path of a model file; empty: the shipped model "
        "for the tip",
        flag="--model",
        verbs="demo feel latency loopback play receive replay send try",
    )
    calibration: str = _setting(
        "",
        "file written by `tactophone check`: contact threshold and microphone check; "
        "empty: none",
        flag="--calibration",
        verbs="receive",
    )
    check_microphones: bool = _setting(
        True,
        "detect faulty microphones and fall back safely; switch off for synthetic "
        "test signals",
    )
    threshold_dbfs: float = _setting(
        math.nan,
        "level of the contact gate; nan: from the calibration, or just over the noise "
        "floor",
        unit="dBFS",
        span=(-120, 0),
        flag="--threshold",
        verbs="feel try",
    )
    contact: str = _setting(
        "bands",
        "what decides on contact: bands, each over its own noise, within milliseconds "
        "and deaf to steady motors; the level alone; or the level of the model's "
        "window, as in the paper",
        choices=("bands", "level", "window"),
        flag="--contact",
        verbs="feel",
    )
    margin_db: float = _setting(
        math.nan,
        "how far over its noise a band is heard, for a loud robot; nan: from the "
        "calibration, or 5",
        unit="dB",
        span=(3, 12),
    )
    events: bool = _setting(
        False,
        "detect taps, strokes and slips too; the profile events always does",
        flag="--events",
        verbs="feel",
    )


@dataclass(frozen=True, slots=True)
class RenderingSettings:
    """How predictions become vibration, and how strong it may be."""

    profile: str = _setting(
        "graded",
        "rendering profile: graded, paper, perceptual, erm, lra, piezo, dualsense, "
        "events; or the sound itself: direct, or a passthrough of a plug-in",
        flag="--profile",
        verbs="demo loopback play receive replay try",
    )
    ceiling: float = _setting(
        DEFAULT_CEILING,
        "greatest amplitude; a profile that asks for more is scaled down as a whole",
        unit="of full drive",
        span=(0, 1),
        flag="--ceiling",
        verbs="feel loopback receive replay try",
    )
    output_level: float = _setting(
        1.0, "volume below the ceiling", unit="of the profile's amplitude", span=(0, 1)
    )
    muted: bool = _setting(False, "start muted, until armed")


@dataclass(frozen=True, slots=True)
class OutputSettings:
    """Where the vibration goes."""

    actuator: str = _setting(
        "jack",
        "device that drives the actuator, the motors of a gamepad, a WAV file, or "
        "nothing",
        choices=("jack", "portaudio", "gamepad", "file", "none"),
        group=ACTUATORS,
        flag="--actuator",
        verbs="answer call devices loopback receive try",
        device="output.device",
    )
    device: str = _setting(
        "",
        "PortAudio device (name or number), gamepad (name), or the WAV file to write; "
        "empty: the default",
    )
    channel: int = _setting(
        1,
        "output channel of the PortAudio device, counted from 1; 3 or 4 on a DualSense",
        span=(1, 64),
    )
    port: str = _setting("system:playback_1", "JACK port of the actuator's amplifier")
    period: int = _setting(
        128, "period of the actuators file and none", unit="samples", span=(16, 4096)
    )


@dataclass(frozen=True, slots=True)
class ActuatorSettings:
    """What the actuator can play, for the profiles perceptual, erm, lra, piezo and
    dualsense: `devices measure`."""

    resonance: float = _setting(
        math.nan, "resonance; nan: typical of the profile", unit="Hz", span=(10, 2000)
    )
    lowest: float = _setting(
        math.nan,
        "lower end of its band; nan: the profile's",
        unit="Hz",
        span=(10, 2000),
    )
    highest: float = _setting(
        math.nan,
        "upper end of its band; nan: the profile's",
        unit="Hz",
        span=(10, 2000),
    )
    slowest: float = _setting(
        math.nan,
        "lowest speed of a rotating motor; nan: typical",
        unit="Hz",
        span=(1, 1000),
    )
    fastest: float = _setting(
        math.nan,
        "speed of a rotating motor at full drive; nan: typical",
        unit="Hz",
        span=(1, 1000),
    )
    response: str = _setting(
        "",
        "levels in dB relative to the resonance by frequency in Hz, as in "
        "40:-12,160:0,250:-6; empty: flat",
    )


@dataclass(frozen=True, slots=True)
class ProcessSettings:
    """Processes, priorities and the watchdog."""

    name: str = _setting(
        "",
        "name of this run for `status`, `stop`, `mute` and `arm`; empty: the verb",
        flag="--name",
        verbs="answer call demo feel latency loopback play receive replay send try",
    )
    jack_server: str = _setting("", "JACK server; empty: the default one")
    priority: int = _setting(
        58, "SCHED_FIFO priority of the network thread; 0: none", span=(0, 95)
    )
    watchdog: bool = _setting(
        True, "silence a late process; kill a stalled one and start a new one, muted"
    )
    stall_timeout: float = _setting(
        0.05,
        "time without a callback, while vibrating, after which a process is late and "
        "silenced",
        unit="s",
        span=(0.01, 1),
    )


@dataclass(frozen=True, slots=True)
class PageSettings:
    """The pages that --dashboard, `listen`, `play` and `try` serve."""

    address: str = _setting(
        "", "HOST:PORT of the page; empty: any free port, for this machine only"
    )
    lan: bool = _setting(
        False,
        "serve the page to the local network too, and print a QR code for a phone",
        flag="--lan",
        verbs="feel listen play receive replay send try",
    )
    open: bool = _setting(
        True,
        "open the page of `listen`, `play` or `try` in this machine's browser, where "
        "it has a screen and no --lan is given",
        flag="--no-open",
        verbs="listen play try",
    )
    https: bool = _setting(
        False,
        "serve the page encrypted, with this machine's certificate, made at first use; "
        "a phone needs it for sound and microphone (try --lan has it)",
        flag="--https",
        verbs="feel listen play replay try",
    )


@dataclass(frozen=True, slots=True)
class BridgeSettings:
    """What --bridge passes on, and how: docs/guide/bridges.md."""

    finger: str = _setting(
        "index",
        "finger in the names of OSC and ROS; the fingers of a hand have their own",
    )
    osc_listen: int = _setting(
        0,
        "UDP port of this machine at which /tactophone/stop is obeyed; 0: none",
        span=(0, 65_535),
    )
    osc_avatar: bool = _setting(False, "send VRChat's avatar parameters too")
    ros_publish: bool = _setting(
        True, "publish predictions, sound and diagnostics to ROS 2"
    )
    ros_sinks: str = _setting(
        "",
        "ROS 2 devices to drive with the vibration, KIND or KIND:TOPIC with commas "
        "between them: joy, senseglove, float32, or of a plug-in",
    )


@dataclass(frozen=True, slots=True)
class SimulationSettings:
    """The simulated network, and the simulated person of the source finger."""

    network: str = _setting(
        "clean",
        "simulated network: clean, lan, wifi, wifi-busy, wifi-roaming, internet, "
        "bursty, or loss=0.05,burst=3,delay=0.01,jitter=0.002 (fractions of 1, "
        "seconds); all but clean need the extra sim",
        flag="--network",
        verbs="demo loopback",
    )
    seed: int = _setting(
        0,
        "random seed of network, strokes and set-up",
        span=(0, 2**31 - 1),
        flag="--seed",
        verbs="demo",
    )
    gain_db: float = _setting(
        0.0, "extra gain of the simulated contact microphone", unit="dB", span=(-40, 40)
    )
    air_gain_db: float = _setting(
        0.0,
        "extra gain of the simulated air microphone; a stylus may drive it too far",
        unit="dB",
        span=(-40, 40),
    )
    faults: str = _setting(
        "",
        "faults of the simulated microphones, CODE or CODE@S-S (between two times in "
        "s), with commas between them: contact-dead, air-hum@3-5, ...",
    )


@dataclass(frozen=True, slots=True)
class FingerSettings:
    """One finger: its name, and the settings that are its own, by dotted name
    (`tactophone.core.hand`)."""

    name: str = ""
    """Empty for the only finger of a run without ``--fingers``."""
    settings: tuple[tuple[str, Any], ...] = ()


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything that can be set; one TOML table per field, but for the fingers."""

    capture: CaptureSettings = CaptureSettings()
    link: LinkSettings = LinkSettings()
    call: CallSettings = CallSettings()
    detector: DetectorSettings = DetectorSettings()
    rendering: RenderingSettings = RenderingSettings()
    output: OutputSettings = OutputSettings()
    actuator: ActuatorSettings = ActuatorSettings()
    process: ProcessSettings = ProcessSettings()
    page: PageSettings = PageSettings()
    bridges: BridgeSettings = BridgeSettings()
    simulation: SimulationSettings = SimulationSettings()
    fingers: tuple[FingerSettings, ...] = (FingerSettings(),)
    """At least one, in the order of the link's channels; by default the one that the
    tables above describe."""

    @property
    def is_hand(self) -> bool:
        """Whether ``--fingers`` named the fingers: each then has two channels of sound,
        and ports of its own."""
        return bool(self.fingers[0].name)


SECTIONS = tuple(
    section.name
    for section in dataclasses.fields(Settings)
    if section.name != "fingers"
)

SETTINGS: Mapping[str, Setting] = {
    f"{section}.{each.name}": replace(
        each.metadata["setting"], name=f"{section}.{each.name}"
    )
    for section in SECTIONS
    for each in dataclasses.fields(getattr(Settings(), section))
}
"""Every setting by its dotted name, in the order of the file."""


def read_settings(path: Path, settings: Settings | None = None) -> Settings:
    """Read a TOML file over the defaults, or over other settings.

    Raises `ConfigError` when the file cannot be read, or holds an unknown setting or a
    value out of range.
    """
    settings = settings or Settings()
    tables = read_tables(
        path,
        missing=f"`tactophone settings > {path}` writes one to begin with",
        outside=f"write it under one of {', '.join(SECTIONS)}",
    )
    for section, table in tables.items():
        for name, value in table.items():
            settings = set_value(settings, f"{section}.{name}", value, where=str(path))
    return settings


LARGEST_SETTINGS = 1 << 16
"""Bytes of a file of settings or of a hand; all settings with their words take a tenth
of that."""


def read_tables(
    path: Path, *, missing: str, outside: str
) -> dict[str, Mapping[str, Any]]:
    """Read a TOML file that holds tables alone.

    ``missing`` and ``outside`` end the error messages about a file that cannot be read,
    and an entry outside a table. Raises `ConfigError` in either case, or if the file is
    no TOML or larger than `LARGEST_SETTINGS`.
    """
    try:
        content = read_small(path, LARGEST_SETTINGS)
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}; {missing}") from None
    except ValueError as error:
        raise ConfigError(f"{path}: {error}; {missing}") from None
    try:
        tables = msgspec.toml.decode(content, type=dict[str, Any])
    except (ValueError, RecursionError) as error:
        # Also numbers of thousands of digits, and brackets nested as deep.
        raise ConfigError(f"{path} is not TOML: {error}") from None
    for name, table in tables.items():
        if not isinstance(table, Mapping):
            raise ConfigError(f"{path}: {name} stands outside a table; {outside}")
    return tables


def change(
    settings: Settings, assignments: Iterable[str], *, where: str = "--set"
) -> Settings:
    """Apply ``section.name=value`` assignments; a value that is not TOML is taken as
    plain text.

    >>> changed = change(Settings(), ["link.packet_duration=0.0025"])
    >>> changed.link.packet_duration
    0.0025
    """
    for assignment in assignments:
        name, equals, text = (part.strip() for part in assignment.partition("="))
        if not equals:
            raise ConfigError(
                f"{where} {assignment}: wanted section.name=value, "
                "such as link.port=48470"
            )
        try:
            value = tomllib.loads(f"value = {text}")["value"]
        except (ValueError, RecursionError):
            value = text
        wants_text = name in SETTINGS and isinstance(SETTINGS[name].default, str)
        if wants_text and not isinstance(value, str):
            # A device may be named "3".
            value = text
        settings = set_value(settings, name, value, where=where)
    return settings


def set_value(settings: Settings, name: str, value: Any, *, where: str) -> Settings:
    """Change the setting of a dotted name, checked; ``where`` is its origin, for the
    error message."""
    if name not in SETTINGS:
        hint = did_you_mean(name, SETTINGS) or f"; sections are {', '.join(SECTIONS)}"
        raise ConfigError(f"{where}: there is no setting {name}{hint}")
    section, _, key = name.partition(".")
    checked = SETTINGS[name].check(value, where=where)
    return replace(
        settings, **{section: replace(getattr(settings, section), **{key: checked})}
    )
