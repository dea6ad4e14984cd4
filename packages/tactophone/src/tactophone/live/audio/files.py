"""Recordings as sources: any format of libsndfile, at its own rate or the live one,
alone or as a hand's fingers."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Self

import numpy as np
import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.recordings.sound_file import length_of, open_file
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    AudioBlock,
    ChangedSource,
    FloatArray,
    LabelledSource,
    Source,
)

FILE_LOWEST_RATE = 2000
"""Hz, the lowest rate at which a detector works (the paper's works at 2 kHz)."""


class FileSource:
    """A recording as a `tactophone.core.types.Source`; memory does not grow with its
    length.

    Parameters
    ----------
    path
        One or two channels: contact, or contact and air; a rate of 2 kHz or more.
    block_size
        Samples a block; the last one may be shorter.
    loop
        Start again at the end, for ever; ``start`` keeps counting.
    channels
        Which of the file's channels are contact and air, counted from 0, for a file of
        more than two; by default the file has only these.

    Attributes
    ----------
    notes
        Sentences on what the file lacks of what its header claims.

    Raises
    ------
    DatasetError
        If the file is missing, empty or not a sound file, or if its channels or its
        rate cannot be used; while iterating, if it is damaged.
    """

    def __init__(
        self,
        path: Path | str,
        *,
        block_size: int = 4096,
        loop: bool = False,
        channels: Sequence[int] = (),
    ) -> None:
        self.path: Path = Path(path)
        self._block_size = block_size
        self._loop = loop
        self._picked = list(channels)
        self._file: soundfile.SoundFile | None = None
        with open_file(self.path) as file:
            self.sample_rate: int = file.samplerate
            self.channels: int = len(self._picked) or file.channels
            self.size: int = file.frames
            self._check_channels(file.channels)
        self._check_format()
        length = length_of(self.path)
        self.notes: list[str] = [length.words(self.duration)] if length.cut else []

    @property
    def duration(self) -> float:
        """Length of the recording, in s."""
        return self.size / self.sample_rate

    def __enter__(self) -> Self:
        self._file = open_file(self.path)
        return self

    def __exit__(self, *_: object) -> None:
        if self._file:
            self._file.close()
        self._file = None

    def __iter__(self) -> Iterator[AudioBlock]:
        start = 0
        rewound = False
        while self._file:
            samples = self._read(self._file, start)
            if len(samples):
                yield AudioBlock(samples, self.sample_rate, start)
                start += len(samples)
                rewound = False
            elif not self._loop:
                return
            elif rewound:
                raise DatasetError(
                    f"{self.path}: no sound is left in it; it was changed while it "
                    "was played"
                )
            elif self._file:
                self._file.seek(0)
                rewound = True

    def _read(self, file: soundfile.SoundFile, start: int) -> FloatArray:
        try:
            samples: FloatArray = file.read(
                self._block_size, dtype="float32", always_2d=True
            )
            # A copy, contiguous as all others are.
            return samples[:, self._picked].copy() if self._picked else samples
        except soundfile.LibsndfileError as error:
            raise DatasetError(
                f"{self.path}: damaged {start / self.sample_rate:.1f} s in ({error})"
            ) from error

    def _check_channels(self, count: int) -> None:
        if self.channels > len(MICROPHONES):
            raise DatasetError(
                f"{self.path}: {count} channels, but contact, or contact and air, are "
                "needed; name these with --channels, such as --channels "
                f"{count - 1},{count}"
            )
        if self._picked and max(self._picked) >= count:
            raise DatasetError(
                f"{self.path}: no channel {max(self._picked) + 1}, as it has {count}; "
                "name others with --channels"
            )

    def _check_format(self) -> None:
        if self.sample_rate < FILE_LOWEST_RATE:
            raise DatasetError(
                f"{self.path}: {self.sample_rate} Hz, but {FILE_LOWEST_RATE} Hz or "
                "more is needed; "
                "record at a higher rate"
            )
        if not self.size:
            raise DatasetError(f"{self.path}: no sound at all; record it again")


class RecordedSource(ChangedSource):
    """A `tactophone.core.types.Source` that resamples a recording of ``duration`` s to
    `LIVE_SAMPLE_RATE`.

    ``resample`` takes and returns arrays of shape ``(samples, channels)``; ``label_at``
    returns the touch at a time in s of the recording, or -1 where it is unknown.
    """

    def __init__(
        self,
        source: Source,
        *,
        duration: float,
        resample: Callable[[FloatArray], FloatArray],
        label_at: Callable[[float], int],
    ) -> None:
        super().__init__(source)
        self.sample_rate = LIVE_SAMPLE_RATE
        self._resample = resample
        self._label_at = label_at
        self._time = 0.0
        self._duration = duration

    def __iter__(self) -> Iterator[AudioBlock]:
        start = 0
        for block in self._source:
            samples = self._resample(block.samples)
            # A looped file counts on at its end; its labels start again.
            self._time = block.end / block.sample_rate % self._duration
            yield AudioBlock(samples, LIVE_SAMPLE_RATE, start)
            start += len(samples)

    def truth_of(self, finger: int = 0) -> int:
        return self._label_at(self._time)


class CombinedSource:
    """Sources of one rate and block size as one, with contact and air of each in turn;
    it ends with the first of them.

    A source of a single channel has silence for air.
    """

    def __init__(self, sources: Sequence[LabelledSource]) -> None:
        self._sources = list(sources)
        self._resources = ExitStack()
        self.sample_rate = self._sources[0].sample_rate
        self.channels = len(MICROPHONES) * len(self._sources)

    def __enter__(self) -> Self:
        for source in self._sources:
            self._resources.enter_context(source)
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def __iter__(self) -> Iterator[AudioBlock]:
        # The first to end ends the hand, so nothing is checked for equal length.
        for blocks in zip(*self._sources, strict=False):
            size = min(block.size for block in blocks)
            missing = (
                ((0, 0), (0, len(MICROPHONES) - block.channels)) for block in blocks
            )
            parts = [
                np.pad(block.samples[:size], each)
                for block, each in zip(blocks, missing, strict=True)
            ]
            samples = np.concatenate(parts, axis=1)
            yield AudioBlock(samples, blocks[0].sample_rate, blocks[0].start)

    def truth_of(self, finger: int = 0) -> int:
        return self._sources[finger].truth_of()
