"""A recording as a source: WAV, FLAC and every other format of libsndfile, block by block, as fast as it is read."""

from collections.abc import Iterator
from pathlib import Path
from typing import Self

import soundfile

from tactophone.errors import DatasetError
from tactophone.types import AudioBlock, FloatArray

LOWEST_RATE = 2000
"""Hz, the lowest rate at which a detector works (the paper's works at 2 kHz)."""


class FileSource:
    """A recording as a `tactophone.types.Source`; memory does not grow with its length.

    Parameters
    ----------
    path
        One or two channels: contact, or contact and air; a rate of 2 kHz or more.
    block_size
        Samples a block; the last one may be shorter.
    loop
        Start again at the end, for ever; ``start`` keeps counting.

    Raises
    ------
    DatasetError
        If the file is missing, empty, not a sound file, or of other channels or rates; while iterating, if it is
        damaged.
    """

    def __init__(self, path: Path | str, *, block_size: int = 4096, loop: bool = False) -> None:
        self.path = Path(path)
        self._block_size, self._loop = block_size, loop
        self._file: soundfile.SoundFile | None = None
        with self._opened() as file:
            self.sample_rate: int = file.samplerate
            self.channels: int = file.channels
            self.size: int = file.frames
        self._check_format()

    @property
    def duration(self) -> float:
        """Length of the recording, in s."""
        return self.size / self.sample_rate

    def __enter__(self) -> Self:
        self._file = self._opened()
        return self

    def __exit__(self, *_: object) -> None:
        if self._file:
            self._file.close()
        self._file = None

    def __iter__(self) -> Iterator[AudioBlock]:
        start = 0
        while self._file:
            samples = self._read(self._file, start)
            if len(samples):
                yield AudioBlock(samples, self.sample_rate, start)
                start += len(samples)
            elif not self._loop:
                return
            elif self._file:
                self._file.seek(0)

    def _read(self, file: soundfile.SoundFile, start: int) -> FloatArray:
        try:
            samples: FloatArray = file.read(self._block_size, dtype="float32", always_2d=True)
            return samples
        except soundfile.LibsndfileError as error:
            raise DatasetError(f"{self.path}: damaged {start / self.sample_rate:.1f} s in ({error})") from error

    def _opened(self) -> soundfile.SoundFile:
        if not self.path.is_file():
            found = "a folder" if self.path.is_dir() else "no such file"
            raise DatasetError(f"{self.path}: {found}; give a WAV or FLAC recording")
        try:
            return soundfile.SoundFile(self.path)
        except soundfile.LibsndfileError as error:
            raise DatasetError(f"{self.path}: cannot be read as sound ({error}); give a WAV or FLAC file") from error

    def _check_format(self) -> None:
        if self.channels > 2:
            raise DatasetError(
                f"{self.path}: {self.channels} channels, but contact, or contact and air, are needed; extract those"
            )
        if self.sample_rate < LOWEST_RATE:
            raise DatasetError(
                f"{self.path}: {self.sample_rate} Hz, but {LOWEST_RATE} Hz or more is needed; record at a higher rate"
            )
        if not self.size:
            raise DatasetError(f"{self.path}: no sound at all; record it again")
