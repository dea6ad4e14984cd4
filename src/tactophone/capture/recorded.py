"""A recording as a live source: at the live sample rate, with its labels as the ground truth."""

from collections.abc import Callable, Iterator
from typing import Self

from tactophone.capture.files import FileSource
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray


class RecordedSource:
    """A `tactophone.types.Source` that resamples a file to `LIVE_SAMPLE_RATE`.

    ``resample`` takes and returns arrays of shape ``(samples, channels)``; ``label_at`` returns the touch at a time in
    s of the recording, or -1 where it is unknown.
    """

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(
        self, source: FileSource, *, resample: Callable[[FloatArray], FloatArray], label_at: Callable[[float], int]
    ) -> None:
        self._source, self._resample, self._label_at = source, resample, label_at
        self._time = 0.0

    @property
    def channels(self) -> int:
        """Number of channels of the recording."""
        return self._source.channels

    def __enter__(self) -> Self:
        self._source.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._source.__exit__(*error)

    def __iter__(self) -> Iterator[AudioBlock]:
        start = 0
        for block in self._source:
            samples = self._resample(block.samples)
            # A looped file counts on at its end; its labels start again.
            self._time = block.end / block.sample_rate % self._source.duration
            yield AudioBlock(samples, LIVE_SAMPLE_RATE, start)
            start += len(samples)

    def truth_now(self) -> int:
        """Return the recording's label at the end of the last block; -1 where it is unknown."""
        return self._label_at(self._time)
