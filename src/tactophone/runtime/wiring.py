"""Opens the sources, sessions, pipelines and actuators that the settings name."""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import cast

from tactophone.capture import jack_hand_source, jack_source, portaudio_hand_source, portaudio_source
from tactophone.config import Link, Settings
from tactophone.errors import ConfigError
from tactophone.hand_file import each_finger, names_of
from tactophone.haptics import (
    PASSTHROUGH,
    Actuator,
    ActuatorResponse,
    GateProfile,
    Limits,
    Oscillator,
    PassthroughRenderer,
    Renderer,
    RenderHand,
    clocked_hand_actuator,
    gamepad_actuator,
    jack_hand_actuator,
    open_profile,
    parse_levels,
    portaudio_hand_actuator,
)
from tactophone.link import (
    IDENTITY_FOLDER,
    MOST_OPERATORS,
    NARROW_BAND,
    Address,
    Codec,
    DatagramSocket,
    Endpoint,
    Identity,
    Peers,
    ReceiveSession,
    RedundancyRule,
    SendGroup,
    SendSession,
    Session,
    resolve_all,
)
from tactophone.perception import (
    FALLBACK_MESSAGES,
    AnyTouchDetector,
    Calibration,
    FallbackDetector,
    FaultDetector,
    default_model,
    open_detector,
    tip_mismatch,
    with_fallback,
)
from tactophone.pipeline import Pipeline, open_events
from tactophone.telemetry import Fault
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray, Source

OpenSource = Callable[[Settings], Source]
"""Opens the source that the settings name; must be importable by a new process."""


def open_device(settings: Settings) -> Source:
    """Open the microphones; recordings and the simulated finger are opened by the command line."""
    capture = settings.capture
    if settings.fingers:
        return _open_hand(settings)
    if capture.source == "jack":
        process = settings.process
        name = process.name or "tactophone-robot"
        return jack_source(contact=capture.contact, air=capture.air, server=process.jack_server, name=name)
    if capture.source == "portaudio":
        return portaudio_source(capture.device, channels=2 if capture.air else 1)
    if capture.source == "microphone":
        return portaudio_source(capture.device, channels=1)
    raise ConfigError(
        f"capture.source = {capture.source!r} is not a device; devices are jack, portaudio and microphone"
    )


def _open_hand(settings: Settings) -> Source:
    """Open the microphones of all fingers: those of one JACK server, or of one PortAudio device."""
    capture, process = settings.capture, settings.process
    pairs = [(own.capture.contact, own.capture.air) for own in each_finger(settings)]
    if capture.source == "jack":
        name = process.name or "tactophone-robot"
        return jack_hand_source(
            dict(zip(names_of(settings), pairs, strict=True)), server=process.jack_server, name=name
        )
    if capture.source == "portaudio":
        channels = [(_channel(contact), _channel(air) if air else 0) for contact, air in pairs]
        return portaudio_hand_source(channels, capture.device)
    raise ConfigError(
        f"capture.source = {capture.source!r} has one finger: a hand's microphones are at jack or portaudio"
    )


def _channel(text: str) -> int:
    """Return the number of a device's channel; the default, a JACK port, stands for the channel of its number."""
    number = text.removeprefix("system:capture_")
    if not number.isdecimal() or not int(number):
        raise ConfigError(f"{text!r} is no channel of a PortAudio device: write its number, as in contact = 3")
    return int(number)


def open_actuator(
    settings: Settings,
    render: RenderHand,
    *,
    roughness: Callable[[], float] = lambda: 0.0,
    ceiling: Callable[[], float] = lambda: 0.0,
) -> Actuator:
    """Make the actuator of all fingers, not yet entered; a gamepad needs roughness and ceiling as they are, 0 to 1."""
    output, fingers = settings.output, each_finger(settings)
    match output.actuator:
        case "jack":
            process = settings.process
            ports = {finger.name: own.output.port for finger, own in zip(settings.fingers, fingers, strict=False)} or {
                "vibration": output.port
            }
            name = process.name or "tactophone-operator"
            return jack_hand_actuator(render, ports=ports, server=process.jack_server, name=name)
        case "portaudio":
            channels = [own.output.channel for own in fingers]
            return portaudio_hand_actuator(render, device=output.device, channels=channels)
        case "gamepad" if settings.fingers:
            raise ConfigError("a gamepad's motors play one finger: choose another --actuator, or leave --fingers out")
        case "gamepad":
            return gamepad_actuator(
                lambda out: render([out]), device=output.device, roughness=roughness, ceiling=ceiling
            )
    path = Path(output.device or "vibration.wav") if output.actuator == "file" else None
    return clocked_hand_actuator(render, fingers=len(fingers), period=output.period, path=path)


def actuator_response(settings: Settings) -> ActuatorResponse:
    """Return what the settings say of the actuator."""
    actuator = settings.actuator
    return ActuatorResponse(
        actuator.resonance,
        actuator.lowest,
        actuator.highest,
        actuator.slowest,
        actuator.fastest,
        parse_levels(actuator.response),
    )


def open_renderer(settings: Settings, pull: Callable[[int], FloatArray], *, hand: bool = False) -> Renderer:
    """Make the renderer of a finger: the oscillator, or the passthrough of the sound that ``pull`` returns."""
    limits, profile = Limits(ceiling=settings.rendering.ceiling), settings.rendering.profile
    if profile not in PASSTHROUGH:
        return Oscillator(limits)
    if hand:
        raise ConfigError(f"the profile {profile} renders the sound of a single finger; give the hand another profile")
    # The gate of the renderer applies the ceiling; applied in the passthrough too, it would count twice.
    return PassthroughRenderer(PASSTHROUGH[profile](Limits(ceiling=1.0)), pull, limits)


def open_pipeline_for(settings: Settings, *, channels: int) -> Pipeline:
    """Open the pipeline for so many channels, with the model and profile that the settings name.

    Its detector falls back safely when a microphone is faulty, unless the settings say otherwise.
    """
    chosen, profile = settings.detector, settings.rendering.profile
    model = chosen.model or default_model(settings.capture.tip)
    calibration = _calibration(chosen.calibration, channels)
    detector: AnyTouchDetector
    detector = plain = open_detector(model, sample_rate=LIVE_SAMPLE_RATE, follow_floor=True)
    if chosen.check_microphones:
        reference = calibration.reference if calibration else None
        detector = with_fallback(
            plain, sample_rate=LIVE_SAMPLE_RATE, channels=channels, model=model, reference=reference
        )
    if not math.isnan(chosen.threshold_dbfs):
        detector.threshold_dbfs = chosen.threshold_dbfs
    elif calibration and (level := calibration.threshold_for(detector.detector.card.gate.rule)) is not None:
        # A model whose rule was not calibrated follows the noise floor.
        detector.threshold_dbfs = level
    return Pipeline(
        detector,
        GateProfile(profile) if profile in PASSTHROUGH else open_profile(profile, actuator_response(settings)),
        Limits(ceiling=settings.rendering.ceiling),
        events=open_events(sample_rate=LIVE_SAMPLE_RATE, channels=channels, tip=settings.capture.tip)
        if chosen.events or profile == "events"
        else None,
    )


def tip_warning(settings: Settings, pipeline: Pipeline) -> str:
    """Return what is wrong if the model is for another tip than the settings name; empty otherwise."""
    return tip_mismatch(pipeline.card, settings.capture.tip)


def microphone_faults(detector: AnyTouchDetector, *, finger: str = "") -> Iterator[Fault]:
    """Yield what is wrong with a finger's microphones, and what the detector falls back to."""
    if isinstance(detector, FallbackDetector):
        for fault in detector.sensor_faults:
            yield finger_fault(finger, fault.code, f"{fault} ({FALLBACK_MESSAGES[detector.mode]})")


def finger_fault(finger: str, code: str, text: str) -> Fault:
    """Return a fault with the finger's name before code and text; without, where it is the only one.

    >>> finger_fault("index", "contact-dead", "the contact microphone is dead").code
    'index-contact-dead'
    """
    return Fault(f"{finger}-{code}", f"{finger}: {text}") if finger else Fault(code, text)


def open_microphone_check(settings: Settings, *, channels: int) -> FaultDetector | None:
    """Open the check for microphone faults on the robot, where no codec has changed the sound yet."""
    if not settings.detector.check_microphones:
        return None
    calibration = _calibration(settings.detector.calibration, channels)
    return FaultDetector(LIVE_SAMPLE_RATE, calibration.reference if calibration else None)


def _calibration(path: str, channels: int) -> Calibration | None:
    """Read the calibration at ``path``; none if the path is empty or the number of microphones differs."""
    if not path:
        return None
    calibration = Calibration.read(Path(path).expanduser())
    return calibration if calibration.channels == channels else None


def open_session(settings: Settings, *, call: Sequence[Endpoint] = ()) -> Session:
    """Open one end of an encrypted session: the robot calls an operator's addresses, the operator answers.

    Raises `ConfigError` if no peer is trusted yet.
    """
    folder = Path(settings.link.identity or IDENTITY_FOLDER).expanduser()
    peers = Peers.load(folder)
    if not peers.items():
        raise ConfigError(f"{folder} holds no trusted peer: pair the two machines first with `tactophone pair`")
    return Session(Identity.load(folder), peers, call=cast(list[Address], list(call)) or None)


def operators_of(link: Link) -> list[Endpoint]:
    """Return host and port of each operator that the robot calls.

    Raises
    ------
    ConfigError
        If there is none, one twice, or more than `MOST_OPERATORS`.

    Examples
    --------
    >>> operators_of(Link(peer="trainer.local, 192.0.2.7:48471, ::1, [2001:db8::7]:48472"))
    [('trainer.local', 48470), ('192.0.2.7', 48471), ('::1', 48470), ('2001:db8::7', 48472)]
    """
    operators = [_endpoint(name.strip(), link.port) for name in link.peer.split(",") if name.strip()]
    if not operators:
        raise ConfigError("link.peer is empty: give the operator's host, as in --peer operator.local")
    if len(operators) > MOST_OPERATORS:
        raise ConfigError(
            f"link.peer names {len(operators)} operators, but a robot sends to at most {MOST_OPERATORS}: leave some out"
        )
    if twice := [host for (host, port), count in Counter(operators).items() if count > 1]:
        raise ConfigError(f"link.peer names {twice[0]} twice: name each operator once, or with ports of their own")
    return operators


def _endpoint(name: str, port: int) -> Endpoint:
    """Split ``host``, ``host:port`` or ``[host]:port``; the colons of an IPv6 address alone are no port."""
    host, colon, number = name.rpartition(":")
    if not colon or name.endswith("]") or (":" in host and not host.endswith("]")):
        return name.strip("[]"), port
    if not number.isascii() or not number.isdecimal() or not 0 < int(number) < 1 << 16:
        raise ConfigError(f"link.peer = {name!r}: {number!r} is no port; write host or host:port")
    return host.strip("[]"), int(number)


def open_send_group(settings: Settings, channels: int) -> SendGroup:
    """Open the robot's sessions, with the codec and the redundancy that the settings ask for.

    Raises
    ------
    ConfigError
        As `operators_of` and `open_session`, and where two names lead to one address.
    """
    link = settings.link
    haptics = link.prediction_payload == "rfc9993"
    if haptics and settings.fingers:
        raise ConfigError(
            "the payload rfc9993 holds the vibration of one finger: leave --prediction-payload out of a hand"
        )
    operators = [resolve_all(host, port) for host, port in operators_of(link)]
    every = Counter(address for found in operators for address in set(found))
    if twice := [address for address, count in every.items() if count > 1]:
        raise ConfigError(f"two names in link.peer lead to {twice[0][0]}: name each operator once")
    codec = Codec(
        "pcm16" if link.codec == "pcm16" else "opus",
        channels=channels,
        packet_size=round(link.packet_duration * LIVE_SAMPLE_RATE),
        bandwidth=link.bandwidth or NARROW_BAND,
        bitrate_bps=link.bitrate_bps * max(1, len(settings.fingers)),
    )
    fixed = link.redundancy >= 0
    rule = RedundancyRule(least=link.redundancy, most=link.redundancy) if fixed else RedundancyRule()
    sessions = [open_session(settings, call=found) for found in operators]
    return SendGroup(sessions, codec, rule=rule, follow=not link.bandwidth, haptics=haptics, prompt=True)


def send_outgoing(session: SendSession | ReceiveSession, socket: DatagramSocket) -> None:
    """Send the datagrams that a session has to send, over a socket that prefers its peer."""
    # First the socket: what the peer sends once it has these datagrams must meet the new preference.
    socket.follow(cast("tuple[Endpoint, frozenset[int]] | None", session.session.remote))
    if outgoing := session.outgoing():
        socket.send(cast("list[tuple[bytes, Endpoint]]", outgoing))
