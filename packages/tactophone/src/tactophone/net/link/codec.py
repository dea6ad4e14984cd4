"""Encoding and decoding of packets: lossless PCM for a local network, Opus for the
rest.

The settings of Opus and why (measured with libopus 1.3.1):

- *Restricted low delay*: look-ahead of 2.5 ms instead of 6.5 ms.
- *Two uncoupled streams*, never coupled stereo: the encoder would mix the microphones,
  and at 5 ms and constant bitrate that distorts both at any bitrate (xiph/opus #251).
- *A hand is its fingers, one after another in one packet*. Each finger is coded as if
  it were alone, equal to the bit. A single encoder for all streams starves the last
  one, because libopus takes the bytes that delimit the others from its share: with ten
  fingers that air microphone was at 0 dB SNR instead of 22.
- *Constant bitrate*: varying sizes of encrypted packets reveal when the finger touches
  (RFC 6562).
- *The narrowest bandwidth that the model needs*: 3 to 9 dB better below 1 kHz at no
  cost.
- *Expected loss of 20 %*: the encoder then depends less on earlier packets, +6 dB at 1
  % loss at no cost.
- *No in-band FEC*: it does not exist at low delay; packets repeat earlier payloads
  (:mod:`~net.link.packet`).

Payload type and first bytes give codec, channels and samples of a payload. The sender
chooses, and the receiver needs no setting that could disagree.

Opus payloads equal the output of libopus's multistream API to the bit. But each stream
is encoded and decoded by a call of its own, on the state that the multistream API made.
That API recomputes the sizes of its states for every packet, which executes four CPUID
instructions, and in a virtual machine each of these takes 20 µs (measured; caches are
cold afterwards). It is used where there is more to do than to call each stream: for the
first packet of a size, for concealment, and for packets of several frames, which no
sender here makes.
"""

import ctypes
import math
import weakref
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

import numpy as np

from tactophone.core.errors import ConfigError, PacketError
from tactophone.core.microphones import MICROPHONES, fingers_of
from tactophone.core.types import MOST_FINGERS, FloatArray
from tactophone.net.link.packet import (
    CLOCK_RATE,
    FRAME_SIZES,
    LARGEST_FRAME,
    LONG_LENGTH,
    PAYLOAD_SPACE,
    SOUND_FORMATS,
    PayloadType,
    frame_length,
    split_streams,
)

LEAST_OF_DEFAULT = 0.75
"""Share of a band's default bitrate that is enough for it: 2 dB less SNR, where the
band below would leave out what the model hears."""

NARROW_BAND = 4_000.0
"""The lowest bandwidth of Opus, in Hz: more than a model at a sample rate of 2 kHz
uses."""

_KINDS = {format: kind for kind, format in SOUND_FORMATS.items()}
"""Payload type of each codec and number of channels."""


@dataclass(frozen=True, slots=True)
class Codec:
    """The codec of one session.

    >>> Codec("opus", packet_size=120).bitrate_bps
    128000
    """

    name: Literal["pcm16", "opus"] = "opus"
    """``"pcm16"`` (lossless for 16-bit sound, no look-ahead) or ``"opus"``."""
    channels: int = 2
    """1 or 2; for a hand of 2 to 10 fingers twice as many, contact and air of each in
    turn."""
    packet_size: int = 240
    """Samples a packet: 120, 240, 480 or 960 for Opus; 1 to 240 for PCM, fewer for a
    hand (`most_pcm_samples`)."""
    bandwidth: float = NARROW_BAND
    """The highest frequency in Hz to transmit: the model's bandwidth."""
    bitrate_bps: int = 0
    """Bitrate of all channels together, Opus only; by default 96 kbit/s for two
    channels of 4 kHz, more for shorter packets and wider bands."""

    def __post_init__(self) -> None:
        if self.name not in ("pcm16", "opus"):
            raise ConfigError(
                f"codec {self.name!r}, but there are pcm16 and opus; choose one"
            )
        if (self.name, self.channels) not in _KINDS:
            raise ConfigError(
                f"{self.channels} channels, but the link carries 1 or 2, or 2 for "
                f"each of up to {MOST_FINGERS} fingers"
            )
        if not self.bitrate_bps:
            object.__setattr__(self, "bitrate_bps", _default_bitrate(self))
        if self.name == "pcm16":
            self._check_pcm()
            return
        if self.packet_size not in FRAME_SIZES:
            sizes = ", ".join(f"{size / 48:g} ms" for size in FRAME_SIZES)
            raise ConfigError(
                f"Opus packets of {self.packet_size} samples, but Opus has {sizes} "
                f"({FRAME_SIZES})"
            )
        size = self.bitrate_bps * self.packet_size // CLOCK_RATE // 8
        if self.channels > len(MICROPHONES) and size > PAYLOAD_SPACE:
            raise ConfigError(
                f"Opus of {self.channels} channels with {self.bitrate_bps / 1000:g} "
                f"kbit/s takes {size} bytes in "
                f"{1000 * self.packet_size / CLOCK_RATE:g} ms, but a datagram has "
                f"{PAYLOAD_SPACE}; "
                "choose shorter packets"
            )

    def _check_pcm(self) -> None:
        most = most_pcm_samples(self.channels)
        if not 1 <= self.packet_size <= most:
            longest = math.floor(most / CLOCK_RATE * 1e5) / 1e5
            raise ConfigError(
                f"PCM datagrams of {self.packet_size} samples, but 1 to {most} of "
                f"{self.channels} channels fit one; "
                f"choose fewer, as in --packet-duration {longest:g}, or Opus"
            )

    @property
    def lookahead(self) -> int:
        """Samples by which the decoded sound lies behind the encoded."""
        return LOOKAHEAD if self.name == "opus" else 0

    @property
    def kind(self) -> PayloadType:
        return _KINDS[self.name, self.channels]

    def largest_packet(self, samples: int) -> int:
        """Return the size of the largest packet that ``samples`` can fill, at most
        `packet_size`; 0 if they fill none."""
        most = min(samples, self.packet_size)
        if self.name == "pcm16":
            return most
        return max((size for size in FRAME_SIZES if size <= most), default=0)

    def for_bandwidth(self, bandwidth: float) -> "Codec":
        """Return this codec for sound of another bandwidth in Hz.

        Opus has four bands. The result carries the narrowest one that holds
        ``bandwidth``, or the widest one below whose packets fit a datagram. A default
        bitrate is adapted to the band, and to a datagram where it is hardly too large
        for one. PCM carries every frequency already.
        """
        if self.name == "pcm16":
            return self
        most = PAYLOAD_SPACE * 8 * CLOCK_RATE // self.packet_size
        default = _default_bitrate(self)
        chosen = self.bitrate_bps not in (default, min(default, most))
        wanted = band_of(bandwidth)
        for band in sorted(BANDS, reverse=True):
            if band > wanted:
                continue
            codec = replace(self, bandwidth=band)
            if chosen:
                return codec
            default = _default_bitrate(codec)
            if most >= LEAST_OF_DEFAULT * default:
                return replace(codec, bitrate_bps=min(default, most))
        return self


def _default_bitrate(codec: Codec) -> int:
    """Return the default bitrate: 96 kbit/s for two channels of 4 kHz, which is 30 dB
    SNR at 5 ms."""
    per_channel = 64_000 if codec.packet_size == FRAME_SIZES[0] else 48_000
    return codec.channels * (
        per_channel if codec.bandwidth <= NARROW_BAND else 2 * per_channel
    )


MAX_PCM_SAMPLES = 240
"""Maximum samples of a packet: two channels fit an unfragmented datagram of 1280 bytes,
with 300 bytes to spare."""


def most_pcm_samples(channels: int) -> int:
    """Return how many samples of each of ``channels`` channels fit one datagram.

    >>> most_pcm_samples(2), most_pcm_samples(10)
    (240, 60)
    """
    return min(MAX_PCM_SAMPLES, PAYLOAD_SPACE // (2 * channels))


_FULL_SCALE = 32_768.0
"""What a sample of 1 is in 16 bits; the greatest sample is one less."""


class PcmEncoder:
    """Encodes samples as 16-bit integers; 16-bit sound is reproduced exactly."""

    def encode(self, samples: FloatArray) -> bytes:
        """Encode ``samples``; values outside [-1, 1) are clipped."""
        # In place, and by the two functions that `clip` calls after a search of its
        # own. A page may send 3e38, which overflows here and is then clipped like 2.
        with np.errstate(over="ignore"):
            integers = samples * _FULL_SCALE
        np.rint(integers, out=integers)
        np.minimum(
            np.maximum(integers, -_FULL_SCALE, out=integers),
            _FULL_SCALE - 1,
            out=integers,
        )
        return integers.astype(">i2").tobytes()

    def adapt(self, *, bandwidth: float, bitrate_bps: int) -> None:
        """PCM has one band and one bitrate: nothing changes."""


class PcmDecoder:
    """Decodes 16-bit samples, and conceals gaps with the sound on both sides."""

    def __init__(self, kind: PayloadType, *, channels: int) -> None:
        self.kind = kind
        self._channels = channels
        self._last = np.zeros((0, channels), np.float32)

    def size(self, content: bytes) -> int:
        """Return the samples in a payload; `PacketError` when it is malformed."""
        width = 2 * self._channels
        if not content or len(content) % width:
            raise PacketError(
                f"{len(content)} bytes of PCM, but {self._channels} channels take "
                f"{width} a sample"
            )
        return len(content) // width

    def decode(self, content: bytes) -> FloatArray:
        self._last = self._read(content)
        return self._last

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        """Conceal ``size`` lost samples, before the payload ``following`` if it has
        arrived."""
        self._last = conceal_gap(
            self._last, self._read(following) if following else self._last[:0], size
        )
        return self._last

    def _read(self, content: bytes) -> FloatArray:
        shape = (self.size(content), self._channels)
        samples = np.ndarray(shape, ">i2", content).astype(np.float32)
        samples *= np.float32(1 / _FULL_SCALE)  # a power of two: exact
        return samples


def conceal_gap(before: FloatArray, after: FloatArray, size: int) -> FloatArray:
    """Fill a gap of ``size`` samples with the mirrored sound of both sides,
    cross-faded.

    Touch sounds like noise, so the cross-fade keeps power, not amplitude, constant: the
    level at the contact gate does not drop. The sound is continuous at both sides, so a
    gap makes no click that the detector would classify. Both sides have the shape
    ``(samples, channels)``, and are repeated back and forth where they are shorter than
    the gap.

    >>> quiet, loud = np.zeros((4, 1), np.float32), np.ones((4, 1), np.float32)
    >>> conceal_gap(quiet, loud, 3).ravel().round(2)
    array([0.38, 0.71, 0.92], dtype=float32)
    """
    angle = np.linspace(0, np.pi / 2, size + 2, dtype=np.float32)[1:-1, np.newaxis]
    sound = (
        np.cos(angle) * mirror(before[::-1], size)
        + np.sin(angle) * mirror(after, size)[::-1]
    )
    return sound.astype(np.float32, copy=False)


def mirror(samples: FloatArray, size: int) -> FloatArray:
    """Return ``size`` samples of ``samples`` forwards and backwards in turn; silence
    when it is empty."""
    if not len(samples):
        return np.zeros((size, samples.shape[1]), np.float32)
    there_and_back = np.concatenate([samples, samples[::-1]])
    return np.resize(there_and_back, (size, samples.shape[1]))


LOOKAHEAD = 120
"""Samples by which the output of restricted low-delay Opus lies behind its input, as
``OPUS_GET_LOOKAHEAD``."""

MOST_BITRATE = 510_000
"""Largest bitrate of one stream of Opus, in bit/s (RFC 6716 section 2.1.1)."""

LARGEST_PACKET = 5_760
"""Samples of the longest packet of Opus, 120 ms (RFC 6716 section 3.2.5): more than any
sender here makes."""

BANDS = MappingProxyType({4_000: 1101, 8_000: 1103, 12_000: 1104, 20_000: 1105})
"""Highest frequency in Hz of each band of Opus, and its number in ``opus_defines.h``.

The fifth one, 6 kHz, does not exist at low delay (RFC 6716, table 2)."""


def band_of(bandwidth: float) -> int:
    """Return the highest frequency of the narrowest band that holds ``bandwidth``, in
    Hz.

    >>> band_of(4_001), band_of(4e9)
    (8000, 20000)
    """
    return next((top for top in BANDS if top >= bandwidth), max(BANDS))


_GET_ENCODER_STATE = 5120
"""Request for the encoder state of one stream (``opus_multistream.h``)."""

_GET_DECODER_STATE = 5122
"""Request for the decoder state of one stream (``opus_multistream.h``)."""

_POINTER = ctypes.c_void_p
_INT = ctypes.c_int
_SIZE = ctypes.c_int32
_ENCODING = (_POINTER, _POINTER, _INT, _POINTER, _SIZE)
"""Arguments of an encoding: state, samples, their count, payload, room in it."""

_DECODING = (_POINTER, ctypes.c_char_p, _SIZE, _POINTER, _INT, _INT)
"""Arguments of a decoding: state, payload, its size, samples, their count, and whether
in-band FEC is decoded."""


COMPLEXITY = 4
"""How hard Opus searches, of 0 to 10 (RFC 6716). Its default of 9 takes 2.3 times the
instructions of 4 for the same signal-to-noise ratio of touch. Below 4 it does not try
both ways to code the energy of the bands, and taps lose 5 to 8 dB in packets of 2.5
ms; from 5 on it searches for a pitch (docs/research/library-defaults.md)."""


class OpusEncoder:
    """Encodes the sound of a packet; each finger in a payload of the same size, since
    the bitrate is constant."""

    def __init__(
        self, *, channels: int, packet_size: int, bandwidth: float, bitrate_bps: int
    ) -> None:
        self._size = packet_size
        self._channels = channels
        self._sound = np.zeros((channels, packet_size), np.float32)
        fingers = fingers_of(channels)
        self._fingers = [
            _FingerEncoder(
                part, bandwidth=bandwidth, bitrate_bps=bitrate_bps // fingers
            )
            for part in np.split(self._sound, fingers)
        ]

    def encode(self, samples: FloatArray) -> bytes:
        """Encode ``samples``, float32 of shape ``(packet_size, channels)`` or of a
        shorter packet, all finite."""
        # Beware: libopus does not check the length, and would read past the end of a
        # short array.
        count = len(samples)
        if (
            samples.shape != (count, self._channels)
            or count not in FRAME_SIZES
            or count > self._size
        ):
            raise ValueError(
                f"samples of shape {samples.shape}, but a packet takes "
                f"{(self._size, self._channels)}"
            )
        self._sound[:, :count] = samples.T
        return b"".join([finger.encode(count) for finger in self._fingers])

    def adapt(self, *, bandwidth: float, bitrate_bps: int) -> None:
        """Encode with another band and bitrate from the next packet on.

        The encoder goes on. A new one would begin from silence, and a decoder that does
        not know of it turns that step into a click.
        """
        for finger in self._fingers:
            finger.adapt(
                bandwidth=bandwidth, bitrate_bps=bitrate_bps // len(self._fingers)
            )


class _FingerEncoder:
    """Encodes the channels of a finger from ``sound``, shape ``(channels,
    packet_size)``, which others fill."""

    def __init__(
        self, sound: FloatArray, *, bandwidth: float, bitrate_bps: int
    ) -> None:
        opus = _libopus()
        channels = len(sound)
        api = opus.api.multistream_encoder
        ctl = opus.api.ctl
        self._state = api.create_state(
            CLOCK_RATE,
            channels,
            channels,
            0,
            range(channels),
            opus.APPLICATION_RESTRICTED_LOWDELAY,
        )
        weakref.finalize(self, api.destroy, self._state)
        api.encoder_ctl(self._state, ctl.set_vbr, 0)
        api.encoder_ctl(self._state, ctl.set_packet_loss_perc, 20)
        api.encoder_ctl(self._state, ctl.set_complexity, COMPLEXITY)
        self._sound = sound
        self.adapt(bandwidth=bandwidth, bitrate_bps=bitrate_bps)
        self._error = opus.OpusError
        self._encode_all = _function(opus, "opus_multistream_encode_float", _ENCODING)
        self._encode = _function(opus, "opus_encode_float", _ENCODING)
        self._payload = bytearray(2 * LARGEST_FRAME)
        self._memory = (ctypes.c_char * len(self._payload)).from_buffer(self._payload)
        self._pointer = ctypes.addressof(self._memory)
        control = _function(opus, "opus_multistream_encoder_ctl", (_POINTER, _INT))
        self._streams = _streams_of(control, self._state, _GET_ENCODER_STATE, sound)

    def adapt(self, *, bandwidth: float, bitrate_bps: int) -> None:
        opus = _libopus()
        control = opus.api.multistream_encoder.encoder_ctl
        ctl = opus.api.ctl
        # A frame holds no more; from libopus 1.6 on the encoder would make two of it.
        bitrate = min(bitrate_bps, MOST_BITRATE * len(self._sound))
        control(self._state, ctl.set_bitrate, bitrate)
        control(self._state, ctl.set_bandwidth, BANDS[band_of(bandwidth)])
        # The next packet is the first of its size: the multistream API computes how
        # its streams share it.
        self._count = self._whole = self._first = 0

    def encode(self, count: int) -> bytes:
        if count != self._count:
            return self._encode_first(count)
        at = 0
        left = self._whole
        if len(self._streams) == 2:
            # The multistream API would set the same limits. The bitrate is constant, so
            # every packet is divided like the first one, which that API made.
            size = 1 if self._first <= LONG_LENGTH else 2
            limit = left - (3 if left > 2 + LONG_LENGTH else 2)
            state, sound = self._streams[0]
            self._check(self._encode(state, sound, count, self._pointer + size, limit))
            # Between the first stream's first byte and its frame stands the length of
            # the frame.
            self._payload[0] = self._payload[size]
            self._payload[1 : 1 + size] = frame_length(self._first - 1)
            at = size + self._first
        state, sound = self._streams[-1]
        self._check(self._encode(state, sound, count, self._pointer + at, left - at))
        return ctypes.string_at(self._pointer, left)

    def _encode_first(self, count: int) -> bytes:
        """Encode the first packet of a size: the multistream API divides the bitrate
        between the streams."""
        samples = np.ascontiguousarray(self._sound[:, :count].T)
        limit = len(self._payload)
        whole = self._check(
            self._encode_all(
                self._state, samples.ctypes.data, count, self._pointer, limit
            )
        )
        payload = ctypes.string_at(self._pointer, whole)
        parts = split_streams(payload, len(self._streams))
        # Without parts the count stays 0, so that the next packet comes here again.
        self._count = count if parts else 0
        self._whole = whole
        self._first = len(parts[0]) if parts else 0
        return payload

    def _check(self, size: int) -> int:
        if size < 0:
            raise self._error(size)
        return size


class OpusDecoder:
    """Decodes payloads of all fingers in order, and conceals the gaps between them."""

    def __init__(self, kind: PayloadType, channels: int) -> None:
        self.kind = kind
        self._sound = np.zeros((channels, LARGEST_PACKET), np.float32)
        self._fingers = [
            _FingerDecoder(part) for part in np.split(self._sound, fingers_of(channels))
        ]

    def size(self, content: bytes) -> int:
        return self._fingers[0].size(self._split(content)[0])

    def decode(self, content: bytes) -> FloatArray:
        """Decode a payload, to shape ``(size, channels)``; `PacketError` when it is
        malformed."""
        if len(self._fingers) == 1:
            size = self._fingers[0].size(content)
            self._fingers[0].decode(content, size)
            return self._sound[:, :size].T.copy()
        parts = self._split(content)
        sizes = [
            finger.size(part) for finger, part in zip(self._fingers, parts, strict=True)
        ]
        if min(sizes) != max(sizes):
            raise PacketError(
                f"fingers of {sorted(set(sizes))} samples in one payload, but all "
                "have the same"
            )
        for finger, part in zip(self._fingers, parts, strict=True):
            finger.decode(part, sizes[0])
        return self._sound[:, : sizes[0]].T.copy()

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        """Conceal ``size`` lost samples, before the payload ``following`` if it has
        arrived."""
        # Opus extrapolates, and smooths the transition to the next packet; it takes
        # multiples of 2.5 ms, at most 20 ms.
        whole = -(-size // FRAME_SIZES[0]) * FRAME_SIZES[0]
        pieces = []
        for done in range(0, whole, FRAME_SIZES[-1]):
            step = min(FRAME_SIZES[-1], whole - done)
            for finger in self._fingers:
                finger.decode(b"", step)
            pieces.append(self._sound[:, :step].T)
        return np.concatenate(pieces)[:size]

    def _split(self, content: bytes) -> list[bytes]:
        fingers = len(self._fingers)
        each, rest = divmod(len(content), fingers)
        if rest or not each:
            raise PacketError(
                f"{len(content)} bytes of Opus, which {fingers} fingers cannot share "
                "evenly"
            )
        return [content[start : start + each] for start in range(0, len(content), each)]


class _FingerDecoder:
    """Decodes the channels of a finger into ``sound``, shape ``(channels,
    LARGEST_PACKET)``."""

    def __init__(self, sound: FloatArray) -> None:
        opus = _libopus()
        channels = len(sound)
        api = opus.api.multistream_decoder
        self._info = opus.api.decoder
        self._error = opus.OpusError
        self._state = api.create_state(
            CLOCK_RATE, channels, channels, 0, range(channels)
        )
        weakref.finalize(self, api.destroy, self._state)
        self._decode_all = _function(opus, "opus_multistream_decode_float", _DECODING)
        self._decode = _function(opus, "opus_decode_float", _DECODING)
        self._sound = sound
        control = _function(opus, "opus_multistream_decoder_ctl", (_POINTER, _INT))
        self._streams = _streams_of(control, self._state, _GET_DECODER_STATE, sound)
        self._sizes: dict[int, int] = {}

    def size(self, content: bytes) -> int:
        if not content:
            raise PacketError("an empty Opus payload, which the encoder never makes")
        # The first byte of the first stream speaks for all streams (RFC 7845 section
        # 5.1.1). Where its last two bits are 0, the packet is a single frame, and the
        # other bits give its size (RFC 6716 section 3.1), so that it can be cached.
        if (known := self._sizes.get(content[0])) is not None:
            return known
        try:
            per_part = self._info.packet_get_samples_per_frame(content, CLOCK_RATE)
            size = int(per_part * self._info.packet_get_nb_frames(content))
        except self._error as error:
            raise PacketError(
                f"an Opus payload that libopus cannot parse: {error}"
            ) from error
        if size > LARGEST_PACKET:
            raise PacketError(
                f"an Opus payload of {size} samples, but at most {LARGEST_PACKET} exist"
            )
        if not content[0] & 3:
            self._sizes[content[0]] = size
        return size

    def decode(self, content: bytes, size: int) -> None:
        """Decode ``size`` samples; without content, conceal as many."""
        if not (parts := split_streams(content, len(self._streams))):
            self._decode_together(content, size)
            return
        for (state, sound), part in zip(self._streams, parts, strict=True):
            self._check(self._decode(state, part, len(part), sound, size, 0))

    def _decode_together(self, content: bytes, size: int) -> None:
        samples = np.empty((size, len(self._streams)), np.float32)
        self._check(
            self._decode_all(
                self._state, content, len(content), samples.ctypes.data, size, 0
            )
        )
        self._sound[:, :size] = samples.T

    def _check(self, decoded: int) -> None:
        if decoded < 0:
            raise PacketError(
                f"an Opus payload that libopus cannot decode: {self._error(decoded)}"
            )


def _function(opus: Any, name: str, arguments: tuple[Any, ...]) -> Any:
    """Return a libopus function that takes the addresses of arrays.

    It is an object of our own: the binding gives its functions other argument types.
    """
    function = opus.api.libopus[name]
    function.argtypes = arguments
    function.restype = _INT
    return function


def _streams_of(
    control: Any, state: Any, request: int, sound: FloatArray
) -> list[tuple[int, int]]:
    """For each stream, return the address of its codec state and of its row of
    samples."""
    streams = []
    for stream, row in enumerate(sound):
        found = _POINTER()
        error = control(state, request, _SIZE(stream), ctypes.byref(found))
        if error or not found.value:
            raise ConfigError(
                "this libopus does not give access to its streams: install libopus "
                "1.3 or newer"
            )
        streams.append((found.value, row.ctypes.data))
    return streams


def _libopus() -> Any:
    """Import the binding, as late as possible: it needs the system's libopus, and PCM
    does not."""
    try:
        import opuslib_next
        import opuslib_next.api.ctl
        import opuslib_next.api.decoder
        import opuslib_next.api.multistream_decoder
        import opuslib_next.api.multistream_encoder
    except ModuleNotFoundError as error:
        raise ConfigError(
            "the Opus codec needs: pip install 'tactophone[link]'; or use --codec pcm16"
        ) from error
    except Exception as error:
        # The binding raises a bare Exception when the shared library itself is missing.
        raise ConfigError(
            f"no libopus here ({error}): apt install libopus0; or use --codec pcm16"
        ) from error
    return opuslib_next


Encoder: TypeAlias = PcmEncoder | OpusEncoder
"""Encodes the sound of one packet as one payload."""

Decoder: TypeAlias = PcmDecoder | OpusDecoder
"""Decodes payloads in order, and conceals the gaps between them."""


def open_encoder(codec: Codec) -> Encoder:
    if codec.name == "pcm16":
        return PcmEncoder()
    return OpusEncoder(
        channels=codec.channels,
        packet_size=codec.packet_size,
        bandwidth=codec.bandwidth,
        bitrate_bps=codec.bitrate_bps,
    )


def open_decoder(kind: PayloadType) -> Decoder:
    """Return a new decoder for a payload type; `PacketError` when it is not sound."""
    if kind not in SOUND_FORMATS:
        raise PacketError(
            f"payload type {kind.name} is not sound; only sound can be decoded"
        )
    codec, channels = SOUND_FORMATS[kind]
    if codec == "pcm16":
        return PcmDecoder(kind, channels=channels)
    return OpusDecoder(kind, channels)


def encode_and_decode(samples: FloatArray, codec: Codec) -> FloatArray:
    """Encode and decode sound at 48 kHz, shape ``(samples, channels)``; the result is
    aligned and of the same shape.

    >>> sound = np.linspace(-1, 1, 1000, dtype=np.float32)[:, None]
    >>> decoded = encode_and_decode(sound, Codec("pcm16", channels=1))
    >>> bool(np.abs(decoded - sound).max() < 1e-4)
    True
    """
    # The codec delays by its look-ahead: the sound is padded at the end and the result
    # cut at the start.
    encoder = open_encoder(codec)
    decoder = open_decoder(codec.kind)
    packets = -(-(len(samples) + codec.lookahead) // codec.packet_size)
    padded = np.zeros((packets * codec.packet_size, samples.shape[1]), np.float32)
    padded[: len(samples)] = samples
    decoded = [
        decoder.decode(encoder.encode(block))
        for block in padded.reshape(packets, codec.packet_size, -1)
    ]
    return np.concatenate(decoded)[codec.lookahead : codec.lookahead + len(samples)]
