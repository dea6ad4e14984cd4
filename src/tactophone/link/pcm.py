"""Lossless PCM: 16 bits, big-endian, channels interleaved (L16 of RFC 3551 section 4.5.11)."""

import numpy as np

from tactophone.errors import PacketError
from tactophone.link.packet import PAYLOAD_SPACE, PayloadType
from tactophone.types import FloatArray

MAX_PCM_SAMPLES = 240
"""Maximum samples of a packet: two channels fit an unfragmented datagram of 1280 bytes, with 300 bytes to spare."""


def most_pcm_samples(channels: int) -> int:
    """Return the greatest number of samples of so many channels in one datagram.

    >>> most_pcm_samples(2), most_pcm_samples(10)
    (240, 60)
    """
    return min(MAX_PCM_SAMPLES, PAYLOAD_SPACE // (2 * channels))


_FULL_SCALE = 32_768.0


class PcmEncoder:
    """Encodes samples as 16-bit integers; 16-bit sound is reproduced exactly."""

    def encode(self, samples: FloatArray) -> bytes:
        """Encode ``samples``; values outside [-1, 1) are clipped."""
        # In place, and by the two functions that `clip` calls after a search of its own.
        integers = samples * _FULL_SCALE
        np.rint(integers, out=integers)
        np.minimum(np.maximum(integers, -_FULL_SCALE, out=integers), _FULL_SCALE - 1, out=integers)
        return integers.astype(">i2").tobytes()


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
            raise PacketError(f"{len(content)} bytes of PCM, but {self._channels} channels take {width} a sample")
        return len(content) // width

    def decode(self, content: bytes) -> FloatArray:
        """Decode a payload."""
        self._last = self._read(content)
        return self._last

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        """Conceal ``size`` lost samples, before the payload ``following`` if it has arrived."""
        self._last = conceal_gap(self._last, self._read(following) if following else self._last[:0], size)
        return self._last

    def _read(self, content: bytes) -> FloatArray:
        shape = (self.size(content), self._channels)
        samples = np.ndarray(shape, ">i2", content).astype(np.float32)
        samples *= np.float32(1 / _FULL_SCALE)  # a power of two: exact
        return samples


def conceal_gap(before: FloatArray, after: FloatArray, size: int) -> FloatArray:
    """Fill a gap of ``size`` samples with the mirrored sound of both sides, cross-faded.

    Touch sounds like noise, so the cross-fade keeps power, not amplitude, constant: the level at the contact gate does
    not drop. The sound is continuous at both sides, so a gap makes no click that the detector would classify. Both
    sides have the shape ``(samples, channels)``, and are repeated back and forth where they are shorter than the gap.

    Examples
    --------
    >>> quiet, loud = np.zeros((4, 1), np.float32), np.ones((4, 1), np.float32)
    >>> conceal_gap(quiet, loud, 3).ravel().round(2)
    array([0.38, 0.71, 0.92], dtype=float32)
    """
    angle = np.linspace(0, np.pi / 2, size + 2, dtype=np.float32)[1:-1, np.newaxis]
    sound = np.cos(angle) * mirror(before[::-1], size) + np.sin(angle) * mirror(after, size)[::-1]
    return sound.astype(np.float32, copy=False)


def mirror(samples: FloatArray, size: int) -> FloatArray:
    """Return ``size`` samples of ``samples`` forwards and backwards in turn; silence when it is empty."""
    if not len(samples):
        return np.zeros((size, samples.shape[1]), np.float32)
    there_and_back = np.concatenate([samples, samples[::-1]])
    return np.resize(there_and_back, (size, samples.shape[1]))
