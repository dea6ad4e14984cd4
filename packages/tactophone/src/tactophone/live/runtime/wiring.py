"""Opens what a live side needs before it starts: actuator, renderers and the operator's
pipelines; and runs it all once before it is needed.

Libraries load parts of themselves at first use: NumPy its FFT and medians, the Opus
binding its shared library (which starts the linker to find it), the resampler its
filters. On a machine that has just been installed that takes seconds, so everything is
rehearsed before a side reports that it has started.
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from tactophone.core.errors import ConfigError, ModelError, PacketError
from tactophone.core.hand import channels_of, each_finger, names_of
from tactophone.core.microphones import MICROPHONES
from tactophone.core.plugins import ACTUATORS, load
from tactophone.core.settings import VIBRATION_FILE, Settings
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    AudioBlock,
    Detector,
    FloatArray,
    Source,
)
from tactophone.live.audio import actuator
from tactophone.live.audio.actuator import Actuator, RenderHand
from tactophone.live.telemetry.layout import Fault
from tactophone.net.endpoints import OperatorEndpoint
from tactophone.net.link.codec import Codec, open_decoder, open_encoder
from tactophone.net.link.receive import ReceiveSession
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator, Renderer
from tactophone.signal.haptics.passthrough import (
    PassthroughRenderer,
    is_passthrough,
    open_passthrough,
)
from tactophone.signal.perception.fallback import FallbackDetector
from tactophone.signal.perception.health import FaultDetector
from tactophone.signal.perception.opening import open_fault_detector, options_from
from tactophone.signal.pipeline import Hand, Pipeline, open_pipeline_for

OpenSource = Callable[[Settings], Source]
"""Opens the source that the settings name; must be importable by a new process."""

REHEARSAL = 0.6
"""Seconds of noise that a detector is rehearsed with: its longest window, and half a
second for what is measured rarely."""

_BLOCK = 240


def open_actuator(
    settings: Settings,
    render: RenderHand,
    *,
    roughness: Callable[[], float] = lambda: 0.0,
    ceiling: Callable[[], float] = lambda: 0.0,
    resume: bool = False,
) -> Actuator:
    """Make the actuator of all fingers, not yet entered; a gamepad needs roughness and
    ceiling as they are, 0 to 1.

    ``resume``: a process of the same run failed, whose file goes on.
    """
    output = settings.output
    fingers = each_finger(settings)
    match output.actuator:
        case "jack":
            process = settings.process
            names = [name or "vibration" for name in names_of(settings)]
            ports = {
                name: own.output.port for name, own in zip(names, fingers, strict=True)
            }
            name = process.name or "tactophone-operator"
            return actuator.jack_hand_actuator(
                render, ports=ports, server=process.jack_server, name=name
            )
        case "portaudio":
            channels = [own.output.channel for own in fingers]
            return actuator.portaudio_hand_actuator(
                render, device=output.device, channels=channels
            )
        case "gamepad" if settings.is_hand:
            raise ConfigError(
                "a gamepad's motors play one finger: choose another --actuator, or "
                "leave --fingers out"
            )
        case "gamepad":
            return actuator.gamepad_actuator(
                lambda out: render([out]),
                device=output.device,
                roughness=roughness,
                ceiling=ceiling,
            )
    if make := output.actuator not in ("file", "none") and load(
        ACTUATORS, output.actuator
    ):
        made: Actuator = make(render=render, fingers=len(fingers), device=output.device)
        return made
    path = Path(output.device or VIBRATION_FILE) if output.actuator == "file" else None
    return actuator.clocked_hand_actuator(
        render,
        fingers=len(fingers),
        period=output.period,
        path=path,
        resume=resume,
    )


def open_renderer(
    settings: Settings, pull: Callable[[int], FloatArray], *, hand: bool = False
) -> Renderer:
    """Make the renderer of a finger: the oscillator, or the passthrough of the sound
    that ``pull`` returns."""
    profile = settings.rendering.profile
    limits = Limits(ceiling=settings.rendering.ceiling)
    if not is_passthrough(profile):
        return Oscillator(limits)
    if hand:
        raise ConfigError(
            f"the profile {profile} renders the sound of a single finger; give the "
            "hand another profile"
        )
    # The gate of the renderer applies the ceiling; applied in the passthrough too, it
    # would count twice.
    passthrough = open_passthrough(profile, Limits(ceiling=1.0))
    return PassthroughRenderer(passthrough, pull, limits)


def open_microphone_check(settings: Settings, *, channels: int) -> FaultDetector | None:
    """Open and rehearse the check of a finger's microphones; none if the settings
    switch it off."""
    check = open_fault_detector(options_from(settings, channels=channels))
    if check:
        check.push(AudioBlock(_noise(REHEARSAL, channels), LIVE_SAMPLE_RATE, 0))
        check.reset()
    return check


def microphone_faults(detector: Detector, *, finger: str = "") -> Iterator[Fault]:
    """Yield what is wrong with a finger's microphones and what the detector falls back
    to, or what does not fit."""
    if isinstance(detector, FallbackDetector):
        for fault in detector.sensor_faults:
            yield finger_fault(finger, fault.code, f"{fault} ({detector.consequence})")
        if (misfit := detector.misfit) and not detector.sensor_faults:
            yield finger_fault(finger, *misfit)


def finger_fault(finger: str, code: str, text: str) -> Fault:
    """Return a fault with the finger's name before code and text; without, where it is
    the only one.

    >>> finger_fault("index", "contact-dead", "the contact microphone is dead").code
    'index-contact-dead'
    """
    return (
        Fault(f"{finger}-{code}", f"{finger}: {text}") if finger else Fault(code, text)
    )


def open_rehearsed_pipeline(settings: Settings, *, channels: int) -> Pipeline:
    """Open the pipeline that the settings name, and let it process noise.

    Raises `ModelError` also where the model cannot do with so many channels.
    """
    pipeline = open_pipeline_for(settings, channels=channels)
    # Loud noise, then digital silence: both ways through the detector.
    for sound in (
        _noise(REHEARSAL, channels),
        np.zeros((_BLOCK, channels), np.float32),
    ):
        for start in range(0, len(sound), _BLOCK):
            pipeline.detector.push(
                AudioBlock(sound[start : start + _BLOCK], LIVE_SAMPLE_RATE, start)
            )
    pipeline.detector.reset()
    return pipeline


def open_endpoint(settings: Settings, session: ReceiveSession) -> OperatorEndpoint:
    """Open the operator's side with all pipelines that it may need: the network thread
    must not load a model later.

    A single finger has one for one microphone and one for two; of a hand, a finger
    without an air microphone has that for one.
    """
    if settings.is_hand:
        fingers, channels = each_finger(settings), channels_of(settings, alone=2)
        hand = [
            open_rehearsed_pipeline(own, channels=count)
            for own, count in zip(fingers, channels, strict=True)
        ]
        rehearse_decoders(
            [Codec(channels=len(MICROPHONES) * len(fingers), packet_size=120)]
        )
        return OperatorEndpoint(session, Hand(hand, channels=channels))
    pipelines, refusal = {2: open_rehearsed_pipeline(settings, channels=2)}, ""
    try:
        pipelines[1] = open_rehearsed_pipeline(settings, channels=1)
    except ModelError as error:
        refusal = str(error)
    rehearse_decoders(Codec(channels=channels) for channels in pipelines)

    def reopen(channels: int) -> Pipeline:
        if channels not in pipelines:
            raise ModelError(refusal)
        pipelines[channels].reset()
        return pipelines[channels]

    return OperatorEndpoint(session, pipelines[2], reopen=reopen)


def rehearse_encoder(codec: Codec) -> bytes:
    return open_encoder(codec).encode(
        _noise(codec.packet_size / LIVE_SAMPLE_RATE, codec.channels)
    )


def rehearse_decoders(codecs: Iterable[Codec]) -> None:
    """Decode and conceal packets of these codecs; a payload that cannot be decoded here
    is reported when it comes."""
    for codec in codecs:
        with contextlib.suppress(PacketError):
            payload = rehearse_encoder(codec)
            decoder = open_decoder(codec.kind)
            decoder.decode(payload)
            decoder.conceal(codec.packet_size, payload)


def rehearse_statistics() -> None:
    np.median(np.zeros(2))
    np.quantile(np.zeros(2), 0.5)


def _noise(duration: float, channels: int) -> FloatArray:
    random = np.random.default_rng(0)
    return random.normal(
        0.0, 0.1, (round(duration * LIVE_SAMPLE_RATE), channels)
    ).astype(np.float32)
