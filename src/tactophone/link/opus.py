"""Opus by libopus: the sound of a finger as uncoupled streams in one packet, a hand as its fingers one after another.

Payloads are those of libopus's multistream API, equal to the bit. But each stream is encoded and decoded by a call of
its own, on the state that the multistream API made: that API computes sizes of states at every packet, which executes
four CPUID instructions, and in a virtual machine each of these takes 20 µs (measured; caches are cold afterwards). It
serves where there is more to do than to call each stream: for the first packet of a size, for concealment, and for
packets of several frames, which no sender here makes.
"""

import ctypes
import weakref
from typing import Any

import numpy as np

from tactophone.errors import ConfigError, PacketError
from tactophone.link.packet import CLOCK_RATE, PayloadType
from tactophone.opus_packets import FRAME_SIZES, LARGEST_FRAME, LONG_LENGTH, frame_length, split_streams
from tactophone.types import FloatArray

LOOKAHEAD = 120
"""Samples by which the output of restricted low-delay Opus lies behind its input, as ``OPUS_GET_LOOKAHEAD``."""

LARGEST_PACKET = 5_760
"""Samples of the longest packet of Opus, 120 ms (RFC 6716 section 3.2.5): more than any sender here makes."""

_BANDWIDTHS = {4_000: 1101, 8_000: 1103, 12_000: 1104, 20_000: 1105}
"""Highest frequency in Hz, and its number in ``opus_defines.h``; 6 kHz does not exist at low delay (RFC 6716)."""

_GET_ENCODER_STATE, _GET_DECODER_STATE = 5120, 5122
"""Requests of ``opus_multistream.h`` for the state of one stream."""

_POINTER, _INT, _SIZE = ctypes.c_void_p, ctypes.c_int, ctypes.c_int32
_ENCODING = (_POINTER, _POINTER, _INT, _POINTER, _SIZE)
_DECODING = (_POINTER, ctypes.c_char_p, _SIZE, _POINTER, _INT, _INT)


class OpusEncoder:
    """Encodes the sound of a packet; each finger in a payload of the same size, since the bitrate is constant."""

    def __init__(self, *, channels: int, packet_size: int, bandwidth: float, bitrate_bps: int) -> None:
        self._size, self._channels = packet_size, channels
        self._sound = np.zeros((channels, packet_size), np.float32)
        fingers = max(1, channels // 2)
        self._fingers = [
            _FingerEncoder(part, bandwidth=bandwidth, bitrate_bps=bitrate_bps // fingers)
            for part in np.split(self._sound, fingers)
        ]

    def encode(self, samples: FloatArray) -> bytes:
        """Encode ``samples``, float32 of shape ``(packet_size, channels)`` or of a shorter packet, all finite."""
        # libopus does not check the length: it would read past the end of a short array.
        count = len(samples)
        if samples.shape != (count, self._channels) or count not in FRAME_SIZES or count > self._size:
            raise ValueError(f"samples of shape {samples.shape}, but a packet takes {(self._size, self._channels)}")
        self._sound[:, :count] = samples.T
        return b"".join([finger.encode(count) for finger in self._fingers])


class _FingerEncoder:
    """Encodes the channels of a finger from ``sound``, shape ``(channels, packet_size)``, which others fill."""

    def __init__(self, sound: FloatArray, *, bandwidth: float, bitrate_bps: int) -> None:
        opus, channels = _libopus(), len(sound)
        api, ctl = opus.api.multistream_encoder, opus.api.ctl
        self._state = api.create_state(
            CLOCK_RATE, channels, channels, 0, range(channels), opus.APPLICATION_RESTRICTED_LOWDELAY
        )
        weakref.finalize(self, api.destroy, self._state)
        for setting, value in (
            (ctl.set_bitrate, bitrate_bps),
            (ctl.set_vbr, 0),
            (ctl.set_bandwidth, next((number for top, number in _BANDWIDTHS.items() if top >= bandwidth), 1105)),
            (ctl.set_packet_loss_perc, 20),
        ):
            api.encoder_ctl(self._state, setting, value)
        self._error = opus.OpusError
        self._encode_all = _function(opus, "opus_multistream_encode_float", _ENCODING)
        self._encode = _function(opus, "opus_encode_float", _ENCODING)
        self._sound, self._payload = sound, bytearray(2 * LARGEST_FRAME)
        self._memory = (ctypes.c_char * len(self._payload)).from_buffer(self._payload)
        self._pointer = ctypes.addressof(self._memory)
        control = _function(opus, "opus_multistream_encoder_ctl", (_POINTER, _INT))
        self._streams = [
            (_state_of(control, self._state, _GET_ENCODER_STATE, stream), row.ctypes.data)
            for stream, row in enumerate(sound)
        ]
        self._count = self._whole = self._first = 0

    def encode(self, count: int) -> bytes:
        """Encode the first ``count`` samples."""
        if count != self._count:
            return self._encode_first(count)
        at, left = 0, self._whole
        if len(self._streams) == 2:
            # The limits are those of the multistream API; at constant bitrate the sizes are those of its first packet.
            size, limit = 1 if self._first <= LONG_LENGTH else 2, left - (3 if left > 2 + LONG_LENGTH else 2)
            state, sound = self._streams[0]
            self._check(self._encode(state, sound, count, self._pointer + size, limit))
            # Between the first stream's first byte and its frame stands the length of the frame.
            self._payload[0] = self._payload[size]
            self._payload[1 : 1 + size] = frame_length(self._first - 1)
            at = size + self._first
        state, sound = self._streams[-1]
        self._check(self._encode(state, sound, count, self._pointer + at, left - at))
        return ctypes.string_at(self._pointer, left)

    def _encode_first(self, count: int) -> bytes:
        """Encode the first packet of a size: the multistream API divides the bitrate between the streams."""
        samples = np.ascontiguousarray(self._sound[:, :count].T)
        limit = len(self._payload)
        whole = self._check(self._encode_all(self._state, samples.ctypes.data, count, self._pointer, limit))
        payload = ctypes.string_at(self._pointer, whole)
        parts = split_streams(payload, len(self._streams))
        self._count = count if parts else 0
        self._whole, self._first = whole, len(parts[0]) if parts else 0
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
        self._fingers = [_FingerDecoder(part) for part in np.split(self._sound, max(1, channels // 2))]

    def size(self, content: bytes) -> int:
        """Return the samples in a payload; `PacketError` when it is malformed."""
        return self._fingers[0].size(self._split(content)[0])

    def decode(self, content: bytes) -> FloatArray:
        """Decode a payload, to shape ``(size, channels)``; `PacketError` when it is malformed."""
        if len(self._fingers) == 1:
            size = self._fingers[0].size(content)
            self._fingers[0].decode(content, size)
            return self._sound[:, :size].T.copy()
        parts = self._split(content)
        sizes = [finger.size(part) for finger, part in zip(self._fingers, parts, strict=True)]
        if min(sizes) != max(sizes):
            raise PacketError(f"fingers of {sorted(set(sizes))} samples in one payload, but all have the same")
        for finger, part in zip(self._fingers, parts, strict=True):
            finger.decode(part, sizes[0])
        return self._sound[:, : sizes[0]].T.copy()

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        """Conceal ``size`` lost samples, before the payload ``following`` if it has arrived."""
        # Opus extrapolates, and smooths the transition to the next packet; it takes multiples of 2.5 ms, at most 20 ms.
        whole, pieces = -(-size // FRAME_SIZES[0]) * FRAME_SIZES[0], []
        for done in range(0, whole, FRAME_SIZES[-1]):
            step = min(FRAME_SIZES[-1], whole - done)
            for finger in self._fingers:
                finger.decode(b"", step)
            pieces.append(self._sound[:, :step].T)
        return np.concatenate(pieces)[:size]

    def _split(self, content: bytes) -> list[bytes]:
        """Return the payload of each finger."""
        fingers = len(self._fingers)
        each, rest = divmod(len(content), fingers)
        if rest or not each:
            raise PacketError(f"{len(content)} bytes of Opus, which {fingers} fingers cannot share evenly")
        return [content[start : start + each] for start in range(0, len(content), each)]


class _FingerDecoder:
    """Decodes the channels of a finger into ``sound``, shape ``(channels, LARGEST_PACKET)``."""

    def __init__(self, sound: FloatArray) -> None:
        opus, channels = _libopus(), len(sound)
        api, self._info, self._error = opus.api.multistream_decoder, opus.api.decoder, opus.OpusError
        self._state = api.create_state(CLOCK_RATE, channels, channels, 0, range(channels))
        weakref.finalize(self, api.destroy, self._state)
        self._decode_all = _function(opus, "opus_multistream_decode_float", _DECODING)
        self._decode = _function(opus, "opus_decode_float", _DECODING)
        self._sound = sound
        control = _function(opus, "opus_multistream_decoder_ctl", (_POINTER, _INT))
        self._streams = [
            (_state_of(control, self._state, _GET_DECODER_STATE, stream), row.ctypes.data)
            for stream, row in enumerate(sound)
        ]
        self._sizes: dict[int, int] = {}

    def size(self, content: bytes) -> int:
        """Return the samples in a payload; `PacketError` when it is malformed."""
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
        if size > LARGEST_PACKET:
            raise PacketError(f"an Opus payload of {size} samples, but at most {LARGEST_PACKET} exist")
        if not content[0] & 3:
            self._sizes[content[0]] = size
        return size

    def decode(self, content: bytes, size: int) -> None:
        """Decode ``size`` samples; without content, conceal as many."""
        if not (parts := split_streams(content, len(self._streams))):
            self._decode_together(content, size)
            return
        for (state, sound), part in zip(self._streams, parts, strict=True):
            if (decoded := self._decode(state, part, len(part), sound, size, 0)) < 0:
                self._check(decoded)

    def _decode_together(self, content: bytes, size: int) -> None:
        samples = np.empty((size, len(self._streams)), np.float32)
        self._check(self._decode_all(self._state, content, len(content), samples.ctypes.data, size, 0))
        self._sound[:, :size] = samples.T

    def _check(self, decoded: int) -> None:
        if decoded < 0:
            raise PacketError(f"an Opus payload that libopus cannot decode: {self._error(decoded)}")


def _function(opus: Any, name: str, arguments: tuple[Any, ...]) -> Any:
    """Return a function of libopus that takes the addresses of arrays; of its own, as the binding types its own."""
    function = opus.api.libopus[name]
    function.argtypes, function.restype = arguments, _INT
    return function


def _state_of(control: Any, state: Any, request: int, stream: int) -> int:
    """Return the address of one stream's state within that of the multistream API."""
    found = _POINTER()
    if control(state, request, _SIZE(stream), ctypes.byref(found)) or not found.value:
        raise ConfigError("this libopus does not give access to its streams: install libopus 1.3 or newer")
    return found.value


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
