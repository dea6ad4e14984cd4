"""Opens the sources, renderers and actuators that the settings name."""

from collections.abc import Callable
from pathlib import Path

from tactophone.capture import jack_hand_source, jack_source, portaudio_hand_source, portaudio_source
from tactophone.errors import ConfigError
from tactophone.hand import each_finger, names_of
from tactophone.haptics import (
    PASSTHROUGH,
    Actuator,
    ActuatorResponse,
    Limits,
    Oscillator,
    PassthroughRenderer,
    Renderer,
    RenderHand,
    clocked_hand_actuator,
    gamepad_actuator,
    jack_hand_actuator,
    parse_levels,
    portaudio_hand_actuator,
)
from tactophone.settings import Settings
from tactophone.types import FloatArray, Source

OpenSource = Callable[[Settings], Source]
"""Opens the source that the settings name; must be importable by a new process."""


def open_device(settings: Settings) -> Source:
    """Open the microphones; recordings and the simulated finger are opened by the command line."""
    capture = settings.capture
    if settings.is_hand:
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
            names = [name or "vibration" for name in names_of(settings)]
            ports = {name: own.output.port for name, own in zip(names, fingers, strict=True)}
            name = process.name or "tactophone-operator"
            return jack_hand_actuator(render, ports=ports, server=process.jack_server, name=name)
        case "portaudio":
            channels = [own.output.channel for own in fingers]
            return portaudio_hand_actuator(render, device=output.device, channels=channels)
        case "gamepad" if settings.is_hand:
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
