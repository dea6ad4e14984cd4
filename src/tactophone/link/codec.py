"""Encoding and decoding of packets: lossless PCM for a local network, Opus for the rest.

The settings of Opus and why (measured with libopus 1.3.1; ``benchmarks/codec.py`` prints the cost of each):

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

import ctypes
import math
import weakref
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np

from tactophone.errors import ConfigError, PacketError
from tactophone.link.packet import CLOCK_RATE, PAYLOAD_SPACE, SOUND_FORMATS, PayloadType
from tactophone.link.pcm import PcmDecoder, PcmEncoder, most_pcm_samples
from tactophone.types import MOST_FINGERS, FloatArray

OPUS_SIZES = (120, 240, 480, 960)
"""Packet sizes of Opus at low delay, in samples at 48 kHz: 2.5, 5, 10 and 20 ms."""

LOOKAHEAD = 120
"""Samples by which the output of restricted low-delay Opus lies behind its input, as ``OPUS_GET_LOOKAHEAD``."""

NARROW_BAND = 4_000.0
"""The lowest bandwidth of Opus, in Hz: more than a model at a sample rate of 2 kHz uses."""

LARGEST_PACKET = 5_760
"""Samples of the longest packet of Opus, 120 ms (RFC 6716 section 3.2.5): more than any sender here makes."""

_POINTER = ctypes.c_void_p

_BANDWIDTHS = {4_000: 1101, 8_000: 1103, 12_000: 1104, 20_000: 1105}
"""Highest frequency in Hz, and its number in ``opus_defines.h``; 6 kHz does not exist at low delay (RFC 6716)."""

_LARGEST_OPUS = 1275 * 2
"""Bytes of the largest packet of two streams (RFC 6716 section 3.4)."""

_KINDS = {format: kind for kind, format in SOUND_FORMATS.items()}


@dataclass(frozen=True, slots=True)
class Codec:
    """The codec of one session.

    Parameters
    ----------
    name
        ``"pcm16"`` (lossless for 16-bit sound, no look-ahead) or ``"opus"``.
    channels
        1 or 2; for a hand of 2 to 10 fingers twice as many, contact and air of each in turn.
    packet_size
        Samples a packet: 120, 240, 480 or 960 for Opus; 1 to 240 for PCM, fewer for a hand (`most_pcm_samples`).
    bandwidth
        The highest frequency in Hz to transmit: the model's bandwidth.
    bitrate_bps
        Of all channels together, Opus only; by default 96 kbit/s for two channels of 4 kHz, more for shorter packets
        and wider bands.

    Examples
    --------
    >>> codec = Codec("opus", packet_size=120)
    >>> codec.latency, codec.bitrate_bps
    (0.005, 128000)
    """

    name: Literal["pcm16", "opus"] = "opus"
    channels: int = 2
    packet_size: int = 240
    bandwidth: float = NARROW_BAND
    bitrate_bps: int = 0

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
        return most if self.name == "pcm16" else max((size for size in OPUS_SIZES if size <= most), default=0)

    def for_bandwidth(self, bandwidth: float) -> "Codec":
        """Return this codec for another bandwidth in Hz; a default bitrate is adapted to it."""
        chosen = self.bitrate_bps != _default_bitrate(self)
        return replace(self, bandwidth=bandwidth, bitrate_bps=self.bitrate_bps if chosen else 0)

    def _check_packet_size(self) -> None:
        if self.name == "opus" and self.packet_size not in OPUS_SIZES:
            sizes = ", ".join(f"{size / 48:g} ms" for size in OPUS_SIZES)
            raise ConfigError(f"Opus packets of {self.packet_size} samples, but Opus has {sizes} ({OPUS_SIZES})")
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
    return _OpusEncoder(codec) if codec.channels <= 2 else _HandEncoder(codec)


def open_decoder(kind: PayloadType) -> Decoder:
    """Return a new decoder for a payload type; `PacketError` when it is not sound."""
    if kind not in SOUND_FORMATS:
        raise PacketError(f"payload type {kind.name} is not sound; only sound can be decoded")
    codec, channels = SOUND_FORMATS[kind]
    if codec == "pcm16":
        return PcmDecoder(kind, channels=channels)
    return _OpusDecoder(kind, channels) if channels <= 2 else _HandDecoder(kind, channels // 2)


def _default_bitrate(codec: Codec) -> int:
    """Return the default bitrate: 96 kbit/s for two channels of 4 kHz, which is 30 dB SNR at 5 ms."""
    per_channel = 64_000 if codec.packet_size == OPUS_SIZES[0] else 48_000
    return codec.channels * (per_channel if codec.bandwidth <= NARROW_BAND else 2 * per_channel)


class _OpusEncoder:
    def __init__(self, codec: Codec) -> None:
        opus = _libopus()
        self._size, self._channels = codec.packet_size, codec.channels
        api = opus.api.multistream_encoder
        self._state = api.create_state(
            CLOCK_RATE, codec.channels, codec.channels, 0, range(codec.channels), opus.APPLICATION_RESTRICTED_LOWDELAY
        )
        weakref.finalize(self, api.destroy, self._state)
        bandwidth = next((number for top, number in _BANDWIDTHS.items() if top >= codec.bandwidth), 1105)
        ctl = opus.api.ctl
        for setting, value in (
            (ctl.set_bitrate, codec.bitrate_bps),
            (ctl.set_vbr, 0),
            (ctl.set_bandwidth, bandwidth),
            (ctl.set_packet_loss_perc, 20),
        ):
            api.encoder_ctl(self._state, setting, value)
        self._error = opus.OpusError
        self._encode = _function(opus, "opus_multistream_encode_float")
        # Both arrays are made once: the binding's own call makes them, and lists of their values, for each packet.
        self._samples = np.zeros((self._size, self._channels), np.float32)
        self._payload = ctypes.create_string_buffer(_LARGEST_OPUS)
        self._pointers = self._samples.ctypes.data, ctypes.addressof(self._payload)

    def encode(self, samples: FloatArray) -> bytes:
        # libopus does not check the length: it would read past the end of a short array.
        count = len(samples)
        if samples.shape != (count, self._channels) or count not in OPUS_SIZES or count > self._size:
            raise ValueError(f"samples of shape {samples.shape}, but a packet takes {(self._size, self._channels)}")
        self._samples[:count] = samples
        pcm, payload = self._pointers
        size = self._encode(self._state, pcm, count, payload, _LARGEST_OPUS)
        if size < 0:
            raise self._error(size)
        return ctypes.string_at(payload, size)


class _OpusDecoder:
    def __init__(self, kind: PayloadType, channels: int) -> None:
        opus = _libopus()
        self.kind = kind
        self._channels = channels
        api, self._info, self._error = opus.api.multistream_decoder, opus.api.decoder, opus.OpusError
        self._state = api.create_state(CLOCK_RATE, self._channels, self._channels, 0, range(self._channels))
        weakref.finalize(self, api.destroy, self._state)
        self._decode = _function(opus, "opus_multistream_decode_float")
        self._samples = np.zeros((LARGEST_PACKET, self._channels), np.float32)
        self._pointer = self._samples.ctypes.data
        self._sizes: dict[int, int] = {}

    def size(self, content: bytes) -> int:
        if not content:
            raise PacketError("an empty Opus payload, which the encoder never makes")
        # The first byte of the first stream holds for all streams (layout in RFC 7845 section 5.1.1). Where its last
        # two bits are 0, there is one frame, whose size the other bits say (RFC 6716 section 3.1).
        if (known := self._sizes.get(content[0])) is not None:
            return known
        try:
            per_part = self._info.packet_get_samples_per_frame(content, CLOCK_RATE)
            size = int(per_part * self._info.packet_get_nb_frames(content))
        except self._error as error:
            raise PacketError(f"an Opus payload that libopus cannot parse: {error}") from error
        if not content[0] & 3:
            self._sizes[content[0]] = size
        return size

    def decode(self, content: bytes) -> FloatArray:
        return self._run(content, self.size(content))

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        # Opus extrapolates, and smooths the transition to the next packet; it takes multiples of 2.5 ms, at most 20 ms.
        whole = -(-size // OPUS_SIZES[0]) * OPUS_SIZES[0]
        steps = [min(OPUS_SIZES[-1], whole - done) for done in range(0, whole, OPUS_SIZES[-1])]
        return np.concatenate([self._run(b"", step) for step in steps])[:size]

    def _run(self, content: bytes, size: int) -> FloatArray:
        if size > LARGEST_PACKET:
            raise PacketError(f"an Opus payload of {size} samples, but at most {LARGEST_PACKET} exist")
        decoded = self._decode(self._state, content, len(content), self._pointer, size, 0)
        if decoded < 0:
            raise PacketError(f"an Opus payload that libopus cannot decode: {self._error(decoded)}")
        return self._samples[:decoded].copy()


def _function(opus: Any, name: str) -> Any:
    """Return a function of libopus that takes the addresses of arrays; of its own, as the binding types its own."""
    function = opus.api.libopus[name]
    if "decode" in name:
        function.argtypes = (_POINTER, ctypes.c_char_p, ctypes.c_int32, _POINTER, ctypes.c_int, ctypes.c_int)
    else:
        function.argtypes = (_POINTER, _POINTER, ctypes.c_int, _POINTER, ctypes.c_int32)
    function.restype = ctypes.c_int
    return function


class _HandEncoder:
    """Encodes each finger as alone, in payloads of one size, since the bitrate is constant."""

    def __init__(self, codec: Codec) -> None:
        fingers = codec.channels // 2
        alone = replace(codec, channels=2, bitrate_bps=codec.bitrate_bps // fingers)
        self._encoders = [_OpusEncoder(alone) for _ in range(fingers)]

    def encode(self, samples: FloatArray) -> bytes:
        parts = np.hsplit(samples, len(self._encoders))
        return b"".join(encoder.encode(part) for encoder, part in zip(self._encoders, parts, strict=True))


class _HandDecoder:
    def __init__(self, kind: PayloadType, fingers: int) -> None:
        self.kind = kind
        self._decoders = [_OpusDecoder(PayloadType.MULTIOPUS, 2) for _ in range(fingers)]

    def size(self, content: bytes) -> int:
        return self._decoders[0].size(self._split(content)[0])

    def decode(self, content: bytes) -> FloatArray:
        parts = self._split(content)
        sizes = {decoder.size(part) for decoder, part in zip(self._decoders, parts, strict=True)}
        if len(sizes) != 1:
            raise PacketError(f"fingers of {sorted(sizes)} samples in one payload, but all have the same")
        return np.hstack([decoder.decode(part) for decoder, part in zip(self._decoders, parts, strict=True)])

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        return np.hstack([decoder.conceal(size, following) for decoder in self._decoders])

    def _split(self, content: bytes) -> list[bytes]:
        each, rest = divmod(len(content), len(self._decoders))
        if rest or not each:
            raise PacketError(f"{len(content)} bytes of Opus, which {len(self._decoders)} fingers cannot share evenly")
        return [content[start : start + each] for start in range(0, len(content), each)]


def _libopus() -> Any:
    """Import the binding; late, because it needs the system's libopus and PCM does not."""
    try:
        import opuslib_next
        import opuslib_next.api.ctl
        import opuslib_next.api.decoder
        import opuslib_next.api.multistream_decoder
        import opuslib_next.api.multistream_encoder
    except ModuleNotFoundError as error:
        raise ConfigError("the Opus codec needs: pip install 'tactophone[link]'; or use --codec pcm16") from error
    except Exception as error:
        # The binding raises a bare Exception when the shared library itself is missing.
        raise ConfigError(f"no libopus here ({error}): apt install libopus0; or use --codec pcm16") from error
    return opuslib_next
