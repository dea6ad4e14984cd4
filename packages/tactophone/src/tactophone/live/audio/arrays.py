"""Sound that a program already holds, as a source: arrays and open files."""

import io
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.recordings.sound_file import (
    FILE_HIGHEST_RATE,
    read_content,
    refuse_rate,
)
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.live.audio.files import FILE_LOWEST_RATE


@runtime_checkable
class SupportsArray(Protocol):
    """What NumPy makes an array of: its own arrays, and tensors of torch or JAX."""

    def __array__(self, *args: Any, **kwargs: Any) -> NDArray[Any]: ...


class ArraySource:
    """Sound in memory as a `tactophone.core.types.Source`.

    Parameters
    ----------
    samples
        float32, shape ``(samples, channels)``, as a file's reader returns them.
    sample_rate
        In Hz; 2 kHz or more.
    block_size
        Samples a block; the last one may be shorter.
    channels
        Which channels are contact and air, counted from 0; by default there are only
        these.
    name
        What messages call it.
    notes
        Sentences on what is missing from it.

    Raises `DatasetError` if it is empty, or its rate or channels cannot be used.
    """

    path = None

    def __init__(
        self,
        samples: FloatArray,
        sample_rate: int,
        *,
        block_size: int = 4096,
        channels: Sequence[int] = (),
        name: str = "the array",
        notes: Sequence[str] = (),
    ) -> None:
        held = samples.shape[1]
        if not len(samples):
            raise DatasetError(f"{name}: no sound at all; record it again")
        if not FILE_LOWEST_RATE <= sample_rate < float("inf"):
            raise DatasetError(
                f"{name}: {sample_rate:g} Hz, but {FILE_LOWEST_RATE} Hz or more is "
                "needed; record at a higher rate"
            )
        if sample_rate > FILE_HIGHEST_RATE:
            refuse_rate(sample_rate, name)
        if (len(channels) or held) > len(MICROPHONES) or not held:
            raise DatasetError(
                f"{name}: {held} channels, but contact, or contact and air, are "
                "needed; name them by their places, such as channels=(0, 1)"
            )
        if channels and not 0 <= min(channels) <= max(channels) < held:
            raise DatasetError(
                f"{name}: channels={tuple(channels)}, but it has {held}, counted from "
                "0; name others"
            )
        self._samples = samples[:, list(channels)] if channels else samples
        self._block_size = block_size
        self.sample_rate = int(sample_rate)
        self.size = len(samples)
        self.channels = len(channels) or held
        self.notes = list(notes)

    @property
    def duration(self) -> float:
        """Length, in s."""
        return self.size / self.sample_rate

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def __iter__(self) -> Iterator[AudioBlock]:
        for start in range(0, self.size, self._block_size):
            # A copy: a detector keeps it, while the caller may write into the array.
            samples = self._samples[start : start + self._block_size].copy()
            yield AudioBlock(samples, self.sample_rate, start)


def source_of_array(
    sound: SupportsArray,
    sample_rate: float | None,
    *,
    block_size: int = 4096,
    channels: Sequence[int] = (),
) -> ArraySource:
    """Return an array as a source.

    It has shape ``(samples, channels)``, or ``(samples,)`` for contact alone. Floats
    are in [-1, 1]; integers of 16 or 32 bits are scaled as a file's reader does.

    Raises `ConfigError` without a rate, and `DatasetError` if the array is no sound.
    """
    if sample_rate is None:
        raise ConfigError("an array has no sample rate: give sample_rate=48000")
    if sample_rate != int(sample_rate):
        raise ConfigError(f"sample_rate={sample_rate}: give a whole number of Hz")
    array = np.asarray(sound)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise DatasetError(
            f"an array of shape {array.shape}, but sound has shape (samples, channels)"
        )
    size, held = array.shape
    if 0 < size < held:
        raise DatasetError(
            f"an array of shape {array.shape} has fewer samples than channels: "
            "librosa and torchaudio put channels first; give the transposed array, x.T"
        )
    return ArraySource(
        _as_floats(array), int(sample_rate), block_size=block_size, channels=channels
    )


def source_of_open_file(
    file: BinaryIO, *, block_size: int = 4096, channels: Sequence[int] = ()
) -> ArraySource:
    """Return the sound of a file that is open for reading bytes, from where it stands;
    it is read whole.

    Raises `ConfigError` for a file of text, and `DatasetError` if it is no sound.
    """
    name = str(getattr(file, "name", "the open file"))
    content = file.read()
    if not isinstance(content, bytes):
        raise ConfigError(f"{name}: opened as text; open it with mode 'rb'")
    samples, sample_rate, length = read_content(content, name)
    notes = [length.words(len(samples) / sample_rate)] if length.cut else []
    return ArraySource(
        samples,
        sample_rate,
        block_size=block_size,
        channels=channels,
        name=name,
        notes=notes,
    )


def is_open_file(sound: object) -> bool:
    """Whether it can be read, as a file or `io.BytesIO`."""
    return isinstance(sound, io.IOBase) or callable(getattr(sound, "read", None))


def _as_floats(array: NDArray[Any]) -> FloatArray:
    if array.dtype in (np.int16, np.int32):
        # As libsndfile: the most negative number is -1.
        full_scale = -float(np.iinfo(array.dtype).min)
        return (array / full_scale).astype(np.float32)
    if not np.issubdtype(array.dtype, np.floating):
        raise DatasetError(
            f"an array of {array.dtype}, but sound is floats in [-1, 1], or integers "
            "of 16 or 32 bits; convert it"
        )
    return array.astype(np.float32)
