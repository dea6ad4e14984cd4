"""The sound and the predictions of a run: live, or as a log tells them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lerobot_camera_tactophone.picture import Picture
from tactophone import AudioBlock
from tactophone.app.logged_run import SoundDecoder, decoded_blocks
from tactophone.core.prediction_fields import prediction_of
from tactophone.live.log.mcap import LoggedPrediction, read_log
from tactophone.live.telemetry.records import read_records
from tactophone.live.telemetry.watcher import Watcher


class LiveSound:
    """Draws what a run hears; silence while nothing comes, so that a dead run is no
    frozen touch.

    It joins a run of any age, and goes on after any pause: sound that the run's memory
    no longer holds is left out.
    """

    def __init__(
        self, run: str, picture: Picture, *, clock: Callable[[], float]
    ) -> None:
        self._watcher, self._picture, self._clock = Watcher(run), picture, clock
        self._count = 0
        self._decoder = SoundDecoder()
        self._drawn = clock()

    def draw(self) -> None:
        """Draw what is new."""
        now = self._clock()
        if self._watcher.follow():
            self._count = 0
        before = self._count
        log, self._count = self._watcher.log(before)
        if len(log) < self._count - before:
            # Records are missing: what comes next continues no stream from before.
            self._decoder = SoundDecoder()
        drawn = 0
        for block in self._decoder.push(read_records(log)):
            if isinstance(block, AudioBlock):
                self._picture.hear(two(block))
                drawn += len(block.samples)
        rows, _ = self._watcher.new_predictions()
        for row in rows[-1:]:
            prediction, command = prediction_of(row)
            self._picture.feel(prediction, command.amplitude)
        self._drawn = now if drawn else self._drawn
        if now - self._drawn > 0.1:
            silent = min(round((now - self._drawn) * 48_000), 100_000)
            self._picture.hear(np.zeros((silent, 2), np.float32))
            self._drawn = now


def two(block: AudioBlock) -> NDArray[np.float32]:
    """Return contact and air of the first finger; a single channel twice."""
    samples = block.samples[:, :2]
    return samples if samples.shape[1] == 2 else np.repeat(samples, 2, axis=1)


class LoggedSound:
    """Draws a log, ``1 / fps`` s at each call."""

    def __init__(self, log: Path, picture: Picture, *, fps: int) -> None:
        self._picture, self._step = picture, 48_000 // fps
        self._sound = np.concatenate(
            [two(block) for _, block in decoded_blocks(read_log(log))]
        )
        found = [
            entry for entry in read_log(log) if isinstance(entry, LoggedPrediction)
        ]
        self._predictions = [entry for entry in found if entry.finger == 0]
        self._position, self._next = 0, 0

    def draw(self) -> None:
        """Draw the next part."""
        until = self._position + self._step
        while (
            self._next < len(self._predictions)
            and self._predictions[self._next].prediction.end * 48_000 <= until
        ):
            entry = self._predictions[self._next]
            self._picture.feel(entry.prediction, entry.command.amplitude)
            self._next += 1
        self._picture.hear(self._sound[self._position : until])
        self._position = until
