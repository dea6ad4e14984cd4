"""What recordings sound like to detectors that are shown features: every window described, every touch remembered.

The stages are the live ones, a whole recording at a time. A touch's memory begins with the average touch, which is
only known once the training recordings are chosen; as it fades out by known weights, it is added afterwards.
"""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.link import Codec
from tactophone.perception import Gate, ModelCard
from tactophone.perception.bands import VALUES, Bands
from tactophone.perception.extractors import EXTRACTORS
from tactophone.perception.loudness import banded_dbfs
from tactophone.perception.texture import SILENT_PEAK, Memory, texture_features
from tactophone.training.sound import read_signals
from tactophone.types import CONTACT, FloatArray

RATE = 16_000
"""Hz at which all of these kinds hear."""

Kind = Literal["texture", "cues", "scalogram"]

WINDOWS: dict[Kind, tuple[int, Fraction]] = {
    "texture": (512, Fraction(160)),
    "cues": (4096, Fraction(512, 3)),
    "scalogram": (4096, Fraction(512, 3)),
}
"""Window and hop in samples: 32 ms a hundred times a second, or the paper's 256 ms at every sound buffer."""


@dataclass(frozen=True, slots=True)
class Ear:
    """How recordings are heard.

    Parameters
    ----------
    kind
        Of the features.
    channels
        2, or 1: contact, or air where there is no contact microphone.
    codec
        Sound is passed through it and back.
    """

    kind: Kind = "texture"
    channels: int = 2
    codec: Codec | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Track:
    """One recording, window by window.

    Parameters
    ----------
    recording
        What was heard.
    description
        Of kind ``texture``: shape ``(windows, channels, VALUES)``; of others: their features.
    level_dbfs
        Banded level of the contact channel.
    start, end
        Of each window, in s.
    present
        Whether each channel carries anything, shape ``(windows, channels)``.
    """

    recording: Recording
    description: NDArray[np.float32]
    level_dbfs: NDArray[np.float64]
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    present: NDArray[np.bool_]

    def touching(self) -> NDArray[np.bool_]:
        """Whether the finger touches anything at each window's end, by the segments; throughout, if there are none."""
        return self._in_contact(self.end) if self.recording.segments else np.ones(len(self.end), bool)

    def quiet(self) -> NDArray[np.bool_]:
        """Whether each window lies wholly where nothing is touched, by the segments; not where they do not tell."""
        inside = np.zeros(len(self.end), bool)
        for one in self.recording.segments:
            if not one.contact:
                inside |= (self.start >= one.start) & (self.end <= one.end)
        return inside & ~self._in_contact(self.start)

    def _in_contact(self, start: NDArray[np.float64]) -> NDArray[np.bool_]:
        inside = np.zeros(len(self.end), bool)
        for one in self.recording.segments:
            if one.contact:
                inside |= (self.end > one.start) & (start <= one.end)
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
    recordings: Sequence[Recording], ear: Ear, *, report: Callable[[int], None] = lambda done: None
) -> list[Track]:
    """Describe every window of recordings; those heard before are remembered."""
    tracks = []
    for done, recording in enumerate(recordings, 1):
        changed = recording.path.stat().st_mtime_ns if recording.path.is_file() else 0
        tracks.append(_listen(recording, changed, ear))
        report(done)
    return tracks


@functools.lru_cache(maxsize=1 << 13)
def _listen(recording: Recording, changed_ns: int, ear: Ear) -> Track:
    (signal,) = read_signals([recording], channels=ear.channels, rate=RATE, codec=ear.codec)
    size, hop = WINDOWS[ear.kind]
    count = max(0, int((len(signal) - size) / hop) + 1)
    starts = np.array([int(k * hop) for k in range(count)], np.intp)
    windows = sliding_window_view(np.pad(signal, ((0, max(0, size - len(signal))), (0, 0))), size, axis=0)
    windows = windows[starts].swapaxes(1, 2)
    level_dbfs = np.array([banded_dbfs(window[:, CONTACT]) for window in windows])
    present = np.abs(windows).max(axis=1, initial=0.0) >= SILENT_PEAK
    return Track(recording, _describe(windows, ear), level_dbfs, starts / RATE, (starts + size) / RATE, present)


def _describe(windows: FloatArray, ear: Ear) -> NDArray[np.float32]:
    size, hop = WINDOWS[ear.kind]
    if ear.kind == "texture":
        return Bands(size, RATE).describe(windows).reshape(-1, ear.channels, VALUES).astype(np.float32)
    extractor = EXTRACTORS[ear.kind](ModelCard("", ear.kind, RATE, size, hop, ear.channels, Gate(0.0)))
    return np.array([extractor.push(window, contact=True) for window in windows], np.float32)


# A cross-validation asks in every fold; thresholds are whole decibels, so that the answer is mostly known.
@functools.lru_cache(maxsize=1 << 13)
def remember(track: Track, threshold_dbfs: float) -> Memories:
    """Remember a track's touches; contact begins at a threshold."""
    memory = Memory(np.zeros((2, *track.description.shape[1:])))
    kept: list[tuple[NDArray[np.float64], NDArray[np.float64], float]] = []
    for description, level_dbfs in zip(track.description, track.level_dbfs, strict=True):
        memory.push(description, contact=bool(level_dbfs >= threshold_dbfs))
        kept.append((memory.mean, memory.square, memory.left))
    shape = (0, *track.description.shape[1:])
    mean, square, left = zip(*kept, strict=True) if kept else (np.empty(shape), np.empty(shape), np.empty(0))
    return Memories(np.array(mean), np.array(square), np.array(left))
