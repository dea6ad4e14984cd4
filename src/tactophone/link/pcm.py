"""Lossless sound: 16 bits, most significant byte first, channels interleaved (L16 of RFC 3551 section 4.5.11)."""

import numpy as np

from tactophone.errors import PacketError
from tactophone.link.packet import PayloadType
from tactophone.types import FloatArray

LARGEST_PCM = 240
"""Samples of a packet at most: two channels of it, with 300 bytes to spare, fit an unfragmented datagram of 1280."""

_FULL_SCALE = 32_768.0


class PcmEncoder:
    """Writes samples as they are; sound that was 16-bit comes out bit-equal."""

    def encode(self, samples: FloatArray) -> bytes:
        """Code ``samples``; what lies outside [-1, 1) is clipped."""
        whole = np.clip(np.rint(samples * _FULL_SCALE), -_FULL_SCALE, _FULL_SCALE - 1)
        return bytes(whole.astype(">i2"))


class PcmDecoder:
    """Reads samples as they are, and bridges holes from both sides."""

    def __init__(self, kind: PayloadType, *, channels: int) -> None:
        self.kind = kind
        self._channels = channels
        self._last = np.zeros((0, channels), np.float32)

    def size(self, content: bytes) -> int:
        """Samples in a payload."""
        width = 2 * self._channels
        if not content or len(content) % width:
            raise PacketError(f"{len(content)} bytes of PCM, but {self._channels} channels take {width} a sample")
        return len(content) // width

    def decode(self, content: bytes) -> FloatArray:
        """Give the sound of a payload."""
        self._last = self._read(content)
        return self._last

    def conceal(self, size: int, following: bytes | None) -> FloatArray:
        """Guess ``size`` samples that were lost, before the payload ``following`` where that is here."""
        self._last = bridge(self._last, self._read(following) if following else self._last[:0], size)
        return self._last

    def _read(self, content: bytes) -> FloatArray:
        shape = (self.size(content), self._channels)
        return np.frombuffer(content, ">i2").reshape(shape).astype(np.float32) / np.float32(_FULL_SCALE)


def bridge(before: FloatArray, after: FloatArray, size: int) -> FloatArray:
    """Fill a hole with the mirrored sound of both its banks, each fading into the other.

    Touch sounds like noise, so the fade keeps power, not amplitude, constant: the level that the contact gate sees
    does not dip. At both banks the sound is continuous, so that a hole makes no click for the detector to hear.

    Parameters
    ----------
    before, after
        Of shape ``(samples, channels)``; repeated back and forth where they are shorter than the hole.

    Examples
    --------
    >>> quiet, loud = np.zeros((4, 1), np.float32), np.ones((4, 1), np.float32)
    >>> bridge(quiet, loud, 3).ravel().round(2)
    array([0.38, 0.71, 0.92], dtype=float32)
    """
    angle = np.linspace(0, np.pi / 2, size + 2, dtype=np.float32)[1:-1, np.newaxis]
    sound = np.cos(angle) * mirror(before[::-1], size) + np.sin(angle) * mirror(after, size)[::-1]
    return sound.astype(np.float32, copy=False)


def mirror(samples: FloatArray, size: int) -> FloatArray:
    """Pipeline ``size`` samples into ``samples``, and back and forth when it ends; silence when it is empty."""
    if not len(samples):
        return np.zeros((size, samples.shape[1]), np.float32)
    there_and_back = np.concatenate([samples, samples[::-1]])
    return np.resize(there_and_back, (size, samples.shape[1]))
