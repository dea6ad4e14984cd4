"""Encoding and decoding of packets: lossless PCM for a local network, Opus for the rest.

The settings of Opus and why (measured with libopus 1.3.1):

- *Restricted low delay*: look-ahead of 2.5 ms instead of 6.5 ms.
- *Two uncoupled streams*, never coupled stereo: the encoder would mix the microphones, and at 5 ms and constant
  bitrate that distorts both at any bitrate (xiph/opus #251).
- *A hand is its fingers, one after another in one packet*, each coded as alone, equal to the bit. One encoder of all
  streams starves the last of them, from which libopus takes the bytes that delimit the others: with ten fingers that
  air microphone was at 0 dB SNR instead of 22.
- *Constant bitrate*: varying sizes of encrypted packets reveal when the finger touches (RFC 6562).
- *The narrowest bandwidth that the model needs*: 3 to 9 dB better below 1 kHz at no cost.
- *Expected loss of 20 %*: the encoder then depends less on earlier packets, +6 dB at 1 % loss at no cost.
- *No in-band FEC*: it does not exist at low delay; packets repeat earlier payloads (:mod:`~tactophone.link.packet`).

Payload type and first bytes give codec, channels and samples of a payload. The sender chooses, and the receiver needs
no setting that could disagree.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np

from tactophone.errors import ConfigError, PacketError
from tactophone.link.opus import LOOKAHEAD, OpusDecoder, OpusEncoder
from tactophone.link.packet import CLOCK_RATE, PAYLOAD_SPACE, SOUND_FORMATS, PayloadType
from tactophone.link.pcm import PcmDecoder, PcmEncoder, most_pcm_samples
from tactophone.opus_packets import FRAME_SIZES
from tactophone.types import MOST_FINGERS, FloatArray

NARROW_BAND = 4_000.0
"""The lowest bandwidth of Opus, in Hz: more than a model at a sample rate of 2 kHz uses."""

_KINDS = {format: kind for kind, format in SOUND_FORMATS.items()}


@dataclass(frozen=True, slots=True)
class Codec:
    """The codec of one session.

    Examples
    --------
    >>> codec = Codec("opus", packet_size=120)
    >>> codec.latency, codec.bitrate_bps
    (0.005, 128000)
    """

    name: Literal["pcm16", "opus"] = "opus"
    """``"pcm16"`` (lossless for 16-bit sound, no look-ahead) or ``"opus"``."""
    channels: int = 2
    """1 or 2; for a hand of 2 to 10 fingers twice as many, contact and air of each in turn."""
    packet_size: int = 240
    """Samples a packet: 120, 240, 480 or 960 for Opus; 1 to 240 for PCM, fewer for a hand (`most_pcm_samples`)."""
    bandwidth: float = NARROW_BAND
    """The highest frequency in Hz to transmit: the model's bandwidth."""
    bitrate_bps: int = 0
    """Of all channels together, Opus only; by default 96 kbit/s for two channels of 4 kHz, more for shorter packets and
    wider bands."""

    def __post_init__(self) -> None:
        if self.name not in ("pcm16", "opus"):
            raise ConfigError(f"codec {self.name!r}, but there are pcm16 and opus; choose one")
        if (self.name, self.channels) not in _KINDS:
            raise ConfigError(
                f"{self.channels} channels, but the link carries 1 or 2, or 2 for each of up to {MOST_FINGERS} fingers"
            )
        self._check_packet_size()
        if not self.bitrate_bps:
            object.__setattr__(self, "bitrate_bps", _default_bitrate(self))
        self._check_datagram()

    @property
    def lookahead(self) -> int:
        """Samples by which the decoded sound lies behind the encoded."""
        return LOOKAHEAD if self.name == "opus" else 0

    @property
    def latency(self) -> float:
        """Maximum seconds from a sample's arrival at the encoder to its packet, with look-ahead."""
        return (self.packet_size + self.lookahead) / CLOCK_RATE

    @property
    def kind(self) -> PayloadType:
        """The RTP payload type."""
        return _KINDS[self.name, self.channels]

    def largest_packet(self, samples: int) -> int:
        """Return the size of the largest packet, up to its own, of so many samples; 0 if there is none."""
        most = min(samples, self.packet_size)
        return most if self.name == "pcm16" else max((size for size in FRAME_SIZES if size <= most), default=0)

    def for_bandwidth(self, bandwidth: float) -> "Codec":
        """Return this codec for another bandwidth in Hz; a default bitrate is adapted to it."""
        chosen = self.bitrate_bps != _default_bitrate(self)
        return replace(self, bandwidth=bandwidth, bitrate_bps=self.bitrate_bps if chosen else 0)

    def _check_packet_size(self) -> None:
        if self.name == "opus" and self.packet_size not in FRAME_SIZES:
            sizes = ", ".join(f"{size / 48:g} ms" for size in FRAME_SIZES)
            raise ConfigError(f"Opus packets of {self.packet_size} samples, but Opus has {sizes} ({FRAME_SIZES})")
        most = most_pcm_samples(self.channels)
        longest = math.floor(most / CLOCK_RATE * 1e5) / 1e5
        if self.name == "pcm16" and not 1 <= self.packet_size <= most:
            raise ConfigError(
                f"PCM datagrams of {self.packet_size} samples, but 1 to {most} of {self.channels} channels fit one; "
                f"choose fewer, as in --packet-duration {longest:g}, or Opus"
            )

    def _check_datagram(self) -> None:
        size = self.bitrate_bps * self.packet_size // CLOCK_RATE // 8
        if self.name == "opus" and self.channels > 2 and size > PAYLOAD_SPACE:
            raise ConfigError(
                f"Opus of {self.channels} channels with {self.bitrate_bps / 1000:g} kbit/s takes {size} bytes in "
                f"{1000 * self.packet_size / CLOCK_RATE:g} ms, but a datagram has {PAYLOAD_SPACE}; "
                "choose shorter packets"
            )


class Encoder(Protocol):
    """Encodes the sound of one packet as one payload."""

    def encode(self, samples: FloatArray) -> bytes:
        """Encode ``samples``, float32 of shape ``(packet_size, channels)`` or of a shorter packet, all finite."""


class Decoder(Protocol):
    """Decodes payloads in order, and conceals the gaps between them."""

    @property
    def kind(self) -> PayloadType:
        """The payload type that it decodes."""

    def size(self, content: bytes) -> int:
        """Return the samples in a payload; `PacketError` when it is malformed."""

    def decode(self, content: bytes) -> FloatArray:
        """Decode a payload, to shape ``(size, channels)``; `PacketError` when it is malformed."""

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        """Conceal ``size`` lost samples, before the payload ``following`` if it has arrived."""


def open_encoder(codec: Codec) -> Encoder:
    """Return a new encoder."""
    if codec.name == "pcm16":
        return PcmEncoder()
    return OpusEncoder(
        channels=codec.channels, packet_size=codec.packet_size, bandwidth=codec.bandwidth, bitrate_bps=codec.bitrate_bps
    )


def open_decoder(kind: PayloadType) -> Decoder:
    """Return a new decoder for a payload type; `PacketError` when it is not sound."""
    if kind not in SOUND_FORMATS:
        raise PacketError(f"payload type {kind.name} is not sound; only sound can be decoded")
    codec, channels = SOUND_FORMATS[kind]
    if codec == "pcm16":
        return PcmDecoder(kind, channels=channels)
    return OpusDecoder(kind, channels)


def _default_bitrate(codec: Codec) -> int:
    """Return the default bitrate: 96 kbit/s for two channels of 4 kHz, which is 30 dB SNR at 5 ms."""
    per_channel = 64_000 if codec.packet_size == FRAME_SIZES[0] else 48_000
    return codec.channels * (per_channel if codec.bandwidth <= NARROW_BAND else 2 * per_channel)


def encode_and_decode(samples: FloatArray, codec: Codec) -> FloatArray:
    """Encode and decode sound at 48 kHz, shape ``(samples, channels)``; the result is aligned and of the same shape.

    >>> sound = np.linspace(-1, 1, 1000, dtype=np.float32)[:, None]
    >>> bool(np.abs(encode_and_decode(sound, Codec("pcm16", channels=1)) - sound).max() < 1e-4)
    True
    """
    # The codec delays by its look-ahead: the sound is padded at the end and the result cut at the start.
    encoder, decoder = open_encoder(codec), open_decoder(codec.kind)
    packets = -(-(len(samples) + codec.lookahead) // codec.packet_size)
    padded = np.zeros((packets * codec.packet_size, samples.shape[1]), np.float32)
    padded[: len(samples)] = samples
    decoded = [decoder.decode(encoder.encode(block)) for block in padded.reshape(packets, codec.packet_size, -1)]
    return np.concatenate(decoded)[codec.lookahead : codec.lookahead + len(samples)]
