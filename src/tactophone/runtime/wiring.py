"""Settings become things: which source, session and actuator a run is made of."""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import cast

from tactophone.capture import jack_source, portaudio_source
from tactophone.config import Settings
from tactophone.endpoints import Pipeline
from tactophone.errors import ConfigError
from tactophone.haptics import (
    PASSTHROUGH,
    Actuator,
    GateProfile,
    Limits,
    Oscillator,
    PassthroughRenderer,
    clocked_actuator,
    jack_actuator,
    open_profile,
    portaudio_actuator,
)
from tactophone.haptics.actuator import Render
from tactophone.link import (
    Codec,
    DatagramSocket,
    Endpoint,
    Identity,
    Peers,
    ReceiveSession,
    RedundancyRule,
    SendSession,
    Session,
    resolve,
)
from tactophone.link.codec import NARROW_BAND
from tactophone.link.identity import DEFAULT_FOLDER
from tactophone.perception import (
    AnyTouchDetector,
    FallbackDetector,
    default_model,
    guard,
    model_path,
    open_detector,
    read_model,
)
from tactophone.perception.sensor_health.calibration_file import Calibration
from tactophone.perception.sensor_health.fallback import WORDS
from tactophone.perception.sensor_health.faults import FaultWatch
from tactophone.telemetry import Fault
from tactophone.types import FloatArray, Source

SAMPLE_RATE = 48_000
"""Hz of the whole live journey; what runs at another rate is converted before it."""

OpenSource = Callable[[Settings], Source]
"""Makes the source that the settings name; must be importable by a new process."""


def open_device(settings: Settings) -> Source:
    """Make the microphones' source; others are opened by who knows them (the command line)."""
    capture = settings.capture
    if capture.source == "jack":
        process = settings.process
        name = process.name or "tactophone-robot"
        return jack_source(contact=capture.contact, air=capture.air, server=process.jack_server, name=name)
    if capture.source == "portaudio":
        return portaudio_source(capture.device, channels=2 if capture.air else 1)
    raise ConfigError(f"capture.source = {capture.source!r} is no device: this door opens jack and portaudio")


def open_actuator(settings: Settings, render: Render) -> Actuator:
    """Make the actuator, not yet entered."""
    output = settings.output
    match output.actuator:
        case "jack":
            process = settings.process
            name = process.name or "tactophone-operator"
            return jack_actuator(render, port=output.port, server=process.jack_server, name=name)
        case "portaudio":
            return portaudio_actuator(render, device=output.device)
        case "file":
            return clocked_actuator(render, period=output.period, path=Path(output.device or "vibration.wav"))
    return clocked_actuator(render, period=output.period)


def open_renderer(settings: Settings, pull: Callable[[int], FloatArray]) -> Oscillator | PassthroughRenderer:
    """Make what drives the finger: the oscillator, or a relay of the sound that ``pull`` gives."""
    feel = settings.feel
    limits = Limits(ceiling=feel.ceiling)
    return (
        PassthroughRenderer(PASSTHROUGH[feel.profile](None), pull, limits)
        if feel.profile in PASSTHROUGH
        else Oscillator(limits)
    )


def open_pipeline_for(settings: Settings, *, channels: int) -> Pipeline:
    """Make what turns sound of so many channels into commands, by the model and profile that the settings name.

    Its judge is on its guard against faulty microphones, unless the settings say otherwise.
    """
    feel, wanted = settings.feel, settings.judge
    model = wanted.model or default_model(channels)
    calibration = _calibration(wanted.calibration, channels)
    plain = open_detector(model, sample_rate=SAMPLE_RATE)
    reference = calibration.reference if calibration else None
    judge: AnyTouchDetector = plain
    if wanted.watch:
        judge = guard(plain, sample_rate=SAMPLE_RATE, channels=channels, model=model, reference=reference)
    if not math.isnan(wanted.threshold_dbfs):
        judge.threshold_dbfs = wanted.threshold_dbfs
    elif calibration and read_model(model_path(model)).card.gate.rule == "rms":
        # The calibrated level is an RMS; a gate that listens to a band alone has learnt its own threshold.
        judge.threshold_dbfs = calibration.threshold_dbfs
    profile = GateProfile(feel.profile) if feel.profile in PASSTHROUGH else open_profile(feel.profile)
    return Pipeline(judge, profile, Limits(ceiling=feel.ceiling))


def sensor_faults(judge: AnyTouchDetector) -> Iterator[Fault]:
    """Say what is wrong with the microphones that a judge hears, and what it does about it."""
    if isinstance(judge, FallbackDetector):
        for fault in judge.sensor_faults:
            yield Fault(fault.code, f"{fault} ({WORDS[judge.answer]})")


def open_watch(settings: Settings, *, channels: int) -> FaultWatch | None:
    """Make what names sensor faults where the sound is heard, before any codec has smoothed them."""
    if not settings.judge.watch:
        return None
    calibration = _calibration(settings.judge.calibration, channels)
    return FaultWatch(SAMPLE_RATE, calibration.reference if calibration else None)


def _calibration(path: str, channels: int) -> Calibration | None:
    """Read a calibration, if one is named and it is of a set-up with as many microphones."""
    if not path:
        return None
    calibration = Calibration.read(Path(path).expanduser())
    return calibration if calibration.channels == channels else None


def open_session(settings: Settings, *, call: bool) -> Session:
    """Make one end of the sealed line; the robot calls, the operator answers."""
    link = settings.link
    folder = Path(link.identity or DEFAULT_FOLDER).expanduser()
    if call and not link.peer:
        raise ConfigError("whom to call is not known: give the operator's host, as in --peer operator.local")
    callee = resolve(link.peer, link.port) if call else None
    peers = Peers.load(folder)
    if not peers.items():
        raise ConfigError(f"{folder} knows no peer to trust: pair the two machines first with `tactophone pair`")
    return Session(Identity.load(folder), peers, call=callee)


def open_send_session(settings: Settings, channels: int) -> SendSession:
    """Make the robot's end, with the codec and the redundancy that the settings ask for."""
    link = settings.link
    codec = Codec(
        "pcm16" if link.codec == "pcm16" else "opus",
        channels=channels,
        packet_size=round(link.packet_duration * SAMPLE_RATE),
        bandwidth=link.bandwidth or NARROW_BAND,
        bitrate_bps=link.bitrate_bps,
    )
    fixed = link.redundancy >= 0
    rule = RedundancyRule(least=link.redundancy, most=link.redundancy) if fixed else RedundancyRule()
    return SendSession(open_session(settings, call=True), codec, rule=rule, follow=not link.bandwidth)


def post(end: SendSession | ReceiveSession, socket: DatagramSocket) -> None:
    """Send what an end has to send."""
    socket.send(cast(list[tuple[bytes, Endpoint]], end.outgoing()))
