"""Runs everything once before a side reports that it has started, so that nothing is loaded or compiled in a run.

Libraries load parts of themselves at first use: NumPy its FFT and medians, the Opus binding its shared library (which
starts the linker to find it), the resampler its filters. On a machine that has just been installed that takes seconds.
"""

import contextlib
from collections.abc import Iterable

import numpy as np

from tactophone.endpoints import OperatorEndpoint
from tactophone.errors import ModelError, PacketError
from tactophone.hand import channels_of, each_finger
from tactophone.haptics import Renderer
from tactophone.link import Codec, ReceiveSession, open_decoder, open_encoder
from tactophone.perception import FaultDetector
from tactophone.pipeline import Hand, Pipeline
from tactophone.runtime.pipeline_wiring import open_pipeline_for
from tactophone.settings import Settings
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock, Detector, FloatArray

DURATION = 0.6
"""Seconds of noise that a detector is rehearsed with: its longest window, and half a second for what is measured
rarely."""

_BLOCK = 240


def open_rehearsed_pipeline(settings: Settings, *, channels: int) -> Pipeline:
    """Open the pipeline that the settings name, and let it process noise.

    Raises
    ------
    ModelError
        Also where the model cannot do with so many channels.
    """
    pipeline = open_pipeline_for(settings, channels=channels)
    rehearse_detector(pipeline.detector, channels=channels)
    return pipeline


def open_endpoint(settings: Settings, session: ReceiveSession) -> OperatorEndpoint:
    """Open the operator's side with all pipelines that it may need: the network thread must not load a model later.

    A single finger has one for one microphone and one for two; of a hand, a finger without an air microphone has that
    for one.
    """
    if settings.is_hand:
        fingers, channels = each_finger(settings), channels_of(settings, alone=2)
        hand = [open_rehearsed_pipeline(own, channels=count) for own, count in zip(fingers, channels, strict=True)]
        rehearse_decoders([Codec(channels=2 * len(fingers), packet_size=120)])
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


def rehearse_detector(detector: Detector, *, channels: int) -> None:
    """Let a detector process noise, loud and then digital silence, and return it to its initial state."""
    for sound in (_noise(DURATION, channels), np.zeros((_BLOCK, channels), np.float32)):
        for start in range(0, len(sound), _BLOCK):
            detector.push(AudioBlock(sound[start : start + _BLOCK], LIVE_SAMPLE_RATE, start))
    detector.reset()


def rehearse_microphone_check(check: FaultDetector | None, *, channels: int) -> None:
    """Let the check for microphone faults process noise, and return it to its initial state."""
    if check is not None:
        check.push(AudioBlock(_noise(DURATION, channels), LIVE_SAMPLE_RATE, 0))
        check.reset()


def rehearse_encoder(codec: Codec) -> bytes:
    """Encode a packet of noise with an encoder of this codec; returns it."""
    return open_encoder(codec).encode(_noise(codec.packet_size / LIVE_SAMPLE_RATE, codec.channels))


def rehearse_decoders(codecs: Iterable[Codec]) -> None:
    """Decode and conceal packets of these codecs; a payload that cannot be decoded here is reported when it comes."""
    for codec in codecs:
        with contextlib.suppress(PacketError):
            payload = rehearse_encoder(codec)
            decoder = open_decoder(codec.kind)
            decoder.decode(payload)
            decoder.conceal(codec.packet_size, payload)


def rehearse_renderer(renderer: Renderer, *, period: int) -> None:
    """Render a period, and return the renderer to its initial state."""
    renderer.render(np.zeros(period, np.float32))
    renderer.reset()


def rehearse_statistics() -> None:
    """Load what medians and quantiles need."""
    np.median(np.zeros(2))
    np.quantile(np.zeros(2), 0.5)


def _noise(duration: float, channels: int) -> FloatArray:
    random = np.random.default_rng(0)
    noise: FloatArray = (0.1 * random.standard_normal((round(duration * LIVE_SAMPLE_RATE), channels))).astype(
        np.float32
    )
    return noise
