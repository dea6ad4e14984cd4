"""The fingers of a hand from as many sources: recordings, or simulated fingers, side by side."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import Protocol, Self

import numpy as np

from tactophone.types import AudioBlock, FloatArray, Source


class LabelledSource(Source, Protocol):
    """A source whose true touch is known."""

    def truth_now(self) -> int:
        """Return the `Touch` at the end of the newest block; -1 when it is not known."""


class CombinedSource:
    """Sources of one rate and block size as one, with contact and air of each in turn; it ends with the first of them.

    A source of a single channel has silence for air.
    """

    def __init__(self, sources: Sequence[LabelledSource]) -> None:
        self._sources = list(sources)
        self._resources = ExitStack()
        self.sample_rate = self._sources[0].sample_rate

    @property
    def channels(self) -> int:
        """Two for each finger."""
        return 2 * len(self._sources)

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
            samples = np.concatenate([_pair(block.samples[:size]) for block in blocks], axis=1)
            yield AudioBlock(samples, blocks[0].sample_rate, blocks[0].start)

    def truth_of(self, finger: int) -> int:
        """Return the `Touch` of a finger at the end of the newest block; -1 when it is not known."""
        return self._sources[finger].truth_now()


def _pair(samples: FloatArray) -> FloatArray:
    return samples if samples.shape[1] == 2 else np.pad(samples, ((0, 0), (0, 1)))
