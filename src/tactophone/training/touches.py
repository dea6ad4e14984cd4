"""What recordings sound like to our own detector: every window described, and every touch remembered.

The stages are the live ones, a whole recording at a time. A touch's memory begins with the average touch, which is
only known once the training recordings are chosen; as it fades out by known weights, it is added afterwards.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.link import Codec
from tactophone.perception.bands import VALUES, Bands
from tactophone.perception.loudness import banded_dbfs
from tactophone.perception.texture import SILENT_PEAK, Memory, texture_features
from tactophone.training.sound import read_signals
from tactophone.types import CONTACT, FloatArray

RATE = 16_000
SIZE, HOP = 512, 160
"""Of kind ``texture``: windows of 32 ms, a hundred a second."""


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One recording, window by window.

    Parameters
    ----------
    recording
        What was heard.
    description
        Shape ``(windows, channels, VALUES)``.
    level_dbfs
        Banded level of the contact channel.
    end
        End of each window, in s.
    present
        Whether each channel carries anything, shape ``(windows, channels)``.
    """

    recording: Recording
    description: NDArray[np.float32]
    level_dbfs: NDArray[np.float64]
    end: NDArray[np.float64]
    present: NDArray[np.bool_]

    def touching(self) -> NDArray[np.bool_]:
        """Whether the finger touches anything at each window's end, by the segments; throughout, if there are none."""
        return self._in_contact(self.end, self.end) if self.recording.segments else np.ones(len(self.end), bool)

    def quiet(self) -> NDArray[np.bool_]:
        """Whether each window lies wholly where nothing is touched, by the segments; nowhere, if there are none."""
        told = bool(self.recording.segments)
        return ~self._in_contact(self.end - SIZE / RATE, self.end) & told

    def _in_contact(self, start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.bool_]:
        inside = np.zeros(len(end), bool)
        for one in self.recording.segments:
            if one.contact:
                inside |= (end > one.start) & (start <= one.end)
        return inside


@dataclass(frozen=True, slots=True, eq=False)
class Memories:
    """What the memory of a track's touches holds after each window, with a prior of zero; ``left`` is its weight."""

    mean: NDArray[np.float64]
    square: NDArray[np.float64]
    left: NDArray[np.float64]

    def features(self, prior: NDArray[np.float64], present: NDArray[np.bool_]) -> FloatArray:
        """Give what the extractor gives with this prior: shape ``(windows, features)``."""
        left = self.left[:, None, None]
        features = texture_features(self.mean + left * prior[0], self.square + left * prior[1])
        features[~present] = np.nan
        return features.reshape(len(features), -1)


def listen(
    recordings: Sequence[Recording],
    *,
    channels: int,
    codec: Codec | None = None,
    report: Callable[[int], None] = lambda done: None,
) -> list[Track]:
    """Describe every window of recordings; those heard before are remembered."""
    tracks = []
    for done, recording in enumerate(recordings, 1):
        changed = recording.path.stat().st_mtime_ns if recording.path.is_file() else 0
        tracks.append(_listen(recording, changed, channels, codec))
        report(done)
    return tracks


def remember(track: Track, threshold_dbfs: float) -> Memories:
    """Remember a track's touches; contact begins at a threshold."""
    return _remember(track, threshold_dbfs)


@functools.lru_cache(maxsize=1 << 13)
def _listen(recording: Recording, changed_ns: int, channels: int, codec: Codec | None) -> Track:
    (signal,) = read_signals([recording], channels=channels, rate=RATE, codec=codec)
    windows = sliding_window_view(signal, SIZE, axis=0)[::HOP].swapaxes(1, 2)
    level_dbfs = np.array([banded_dbfs(window[:, CONTACT]) for window in windows])
    description = Bands(SIZE, RATE).describe(windows).reshape(-1, channels, VALUES).astype(np.float32)
    present = np.abs(windows).max(axis=1) >= SILENT_PEAK
    return Track(recording, description, level_dbfs, (np.arange(len(windows)) * HOP + SIZE) / RATE, present)


# A cross-validation asks in every fold; thresholds are whole decibels, so that the answer is mostly known.
@functools.lru_cache(maxsize=1 << 13)
def _remember(track: Track, threshold_dbfs: float) -> Memories:
    memory = Memory(np.zeros((2, *track.description.shape[1:])))
    kept: list[tuple[NDArray[np.float64], NDArray[np.float64], float]] = []
    for description, level_dbfs in zip(track.description, track.level_dbfs, strict=True):
        memory.push(description, contact=bool(level_dbfs >= threshold_dbfs))
        kept.append((memory.mean, memory.square, memory.left))
    shape = (0, *track.description.shape[1:])
    mean, square, left = zip(*kept, strict=True) if kept else (np.empty(shape), np.empty(shape), np.empty(0))
    return Memories(np.array(mean), np.array(square), np.array(left))
