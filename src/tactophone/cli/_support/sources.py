"""Sources that are no device, fit for the live line: a recording, or the simulated finger over five stones."""

from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Self

import numpy as np

from tactophone.capture import FileSource
from tactophone.config import Settings
from tactophone.dataset import touch_at, truth_of
from tactophone.errors import ConfigError
from tactophone.perception.features.resample import Resampler
from tactophone.runtime.wiring import SAMPLE_RATE, open_device
from tactophone.types import AlwaysOpen, AudioBlock, Source, Touch

AHEAD = 1.0
"""Seconds of movement that the simulated finger is told beforehand."""


def open_source(settings: Settings) -> Source:
    """Make whatever source the settings name."""
    capture = settings.capture
    if capture.source == "finger":
        return StrokingFinger(capture.block_size, seed=_seed(capture.device))
    if capture.source != "file":
        return open_device(settings)
    if not capture.device:
        raise ConfigError("capture.source = 'file', but no file is named: give --device RECORDING")
    return Recorded(FileSource(capture.device, block_size=capture.block_size, loop=capture.loop))


class Recorded:
    """A recording at the live line's rate, whatever its own, with the truth that its data set tells of it."""

    def __init__(self, source: FileSource) -> None:
        self._source = source
        self._truth = truth_of(source.path, duration=source.duration)
        self._time = 0.0
        self._resources = ExitStack()
        self.sample_rate = SAMPLE_RATE

    @property
    def channels(self) -> int:
        """As the source within."""
        return self._source.channels

    def __enter__(self) -> Self:
        self._resources.enter_context(self._source)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._resources.close()

    def __iter__(self) -> Iterator[AudioBlock]:
        resampler = Resampler(self._source.sample_rate, SAMPLE_RATE, channels=self.channels)
        start = 0
        for block in self._source:
            samples = resampler.push(block.samples)
            self._time = block.end / block.sample_rate % self._source.duration
            yield AudioBlock(samples, SAMPLE_RATE, start)
            start += len(samples)

    def truth_now(self) -> int:
        """What the recording's label says of the end of the last block; -1 where it says nothing."""
        return touch_at(self._time, self._truth)


class StrokingFinger(AlwaysOpen):
    """The simulated finger, going from stone to stone for ever, as one who looks for the rough ones would."""

    channels = 2
    sample_rate = SAMPLE_RATE

    def __init__(self, block_size: int, *, seed: int = 0) -> None:
        from tactophone.simulation import SimulatedFinger, five_stones, shuffled
        from tactophone.simulation.content.movement import Script

        self._rng = np.random.default_rng([0x57, seed])
        self._scene = five_stones(shuffled(seed))
        place = self._scene.placed[0].centre
        self._finger = SimulatedFinger(self._scene, seed=seed, block_size=block_size, place=place)
        self._script = Script(self._rng, x=place[0], y=place[1])
        self._told = 0

    def __iter__(self) -> Iterator[AudioBlock]:
        for block in self._finger:
            yield block
            if self._script.time < block.end / SAMPLE_RATE + AHEAD:
                self._visit_next()

    def truth_now(self) -> int:
        """What the finger truly touched at the end of the last block."""
        return int(self._finger.truth.touch[-1]) if len(self._finger.truth.touch) else int(Touch.NONE)

    def _visit_next(self) -> None:
        from tactophone.simulation.content.movement import Visit, explore

        stone = self._scene.placed[self._rng.integers(len(self._scene.placed))]
        force, speed = self._rng.uniform(0.8, 2.5), self._rng.uniform(0.04, 0.12)
        explore(
            self._script, stone, Visit(self._rng.uniform(1.5, 3.0), force, speed, slips=bool(self._rng.random() < 0.2))
        )
        for move in self._script.moves[self._told :]:
            self._finger.move(move.x, move.y, move.force, move.time)
        self._told = len(self._script.moves)


def _seed(text: str) -> int:
    try:
        return int(text or 0)
    except ValueError:
        raise ConfigError(
            f"capture.device = {text!r}, but for the simulated finger it is a seed, a whole number"
        ) from None
