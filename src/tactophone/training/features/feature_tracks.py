"""What recordings sound like to detectors that are shown features: every window described, every touch remembered.

The stages are the live ones, a whole recording at a time. The average touch, with which a memory begins, is only known
once the training recordings are chosen; as it fades out by known weights, it is added afterwards.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.dataset import Recording
from tactophone.link import Codec
from tactophone.perception import Gate, ModelCard
from tactophone.perception.features.bands import VALUES, Bands
from tactophone.perception.features.extractors import EXTRACTORS
from tactophone.perception.features.loudness import banded_dbfs
from tactophone.perception.features.texture import SILENT_POWER, Moments, RunningStatistics, Surprise, texture_features
from tactophone.training.sound import read_signals
from tactophone.types import CONTACT, FloatArray

RATE = 16_000
"""Hz at which all of these kinds hear."""

Kind = Literal["texture", "cues", "scalogram"]

Microphone = Literal["contact", "air"]

WINDOWS: dict[Kind, tuple[int, Fraction]] = {
    "texture": (512, Fraction(160)),
    "cues": (4096, Fraction(512, 3)),
    "scalogram": (4096, Fraction(512, 3)),
}
"""Window and hop in samples: 32 ms a hundred times a second, or the paper's 256 ms at every sound buffer."""


@dataclass(frozen=True, slots=True)
class FeatureSpec:
    """How recordings are heard.

    Parameters
    ----------
    kind
        Of the features.
    channels
        2, or 1.
    codec
        Sound is passed through it and back.
    alone
        The microphone that is heard where there is one channel; the file's first, if it has none such.
    calm
        Whether no memory of its is ever surprised.
    """

    kind: Kind = "texture"
    channels: int = 2
    codec: Codec | None = None
    # Not shown: benchmarks keep results by a way's name and how its ear is written, and only one way differs here.
    alone: Microphone = field(default="contact", repr=False)
    calm: bool = field(default=False, repr=False)


@dataclass(frozen=True, slots=True, eq=False)
class FeatureTrack:
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
class RunningMoments:
    """What the memory of a track's touches holds after each window: ``moments`` of shape ``(2, windows, channels,
    values)``, and ``left``, the weight of the average touch."""

    moments: Moments
    left: NDArray[np.float64]

    def features(self, prior: Moments, present: NDArray[np.bool_]) -> FloatArray:
        """Give what the extractor gives with this average touch: shape ``(windows, features)``."""
        features = texture_features(self.moments + self.left[:, None, None] * prior[:, None])
        features[~present] = np.nan
        return features.reshape(len(features), -1)


def listen(
    recordings: Sequence[Recording], ear: FeatureSpec, *, report: Callable[[int], None] = lambda done: None
) -> list[FeatureTrack]:
    """Describe every window of recordings; those heard before are remembered."""
    tracks = []
    for done, recording in enumerate(recordings, 1):
        changed = recording.path.stat().st_mtime_ns if recording.path.is_file() else 0
        tracks.append(_listen(recording, changed, ear))
        report(done)
    return tracks


@functools.lru_cache(maxsize=1 << 13)
def _listen(recording: Recording, changed_ns: int, ear: FeatureSpec) -> FeatureTrack:
    (signal,) = read_signals([recording], channels=ear.channels, rate=RATE, codec=ear.codec, alone=ear.alone)
    size, hop = WINDOWS[ear.kind]
    count = max(0, int((len(signal) - size) / hop) + 1)
    starts = np.array([int(k * hop) for k in range(count)], np.intp)
    windows = sliding_window_view(np.pad(signal, ((0, max(0, size - len(signal))), (0, 0))), size, axis=0)
    windows = windows[starts].swapaxes(1, 2)
    level_dbfs = np.array([banded_dbfs(window[:, CONTACT]) for window in windows])
    present = np.square(windows).sum(axis=1) >= SILENT_POWER * size
    return FeatureTrack(recording, _describe(windows, ear), level_dbfs, starts / RATE, (starts + size) / RATE, present)


def _describe(windows: FloatArray, ear: FeatureSpec) -> NDArray[np.float32]:
    size, hop = WINDOWS[ear.kind]
    if ear.kind == "texture":
        bands = Bands(size, RATE)
        return bands.describe(bands.hear(windows)).reshape(-1, ear.channels, VALUES)
    extractor = EXTRACTORS[ear.kind](ModelCard("", ear.kind, RATE, size, hop, ear.channels, Gate(0.0)))
    return np.array([extractor.push(window, contact=True) for window in windows], np.float32)


def remember(track: FeatureTrack, threshold_dbfs: float, surprise: Surprise) -> RunningMoments:
    """Remember a track's touches; contact begins at a threshold."""
    memory = RunningStatistics(surprise)
    moments = np.empty((len(track.description), 2, *track.description.shape[1:]))
    left = np.empty(len(moments))
    for number, (description, contact) in enumerate(_windows(track, threshold_dbfs)):
        memory.push(description, contact=contact)
        moments[number], left[number] = memory.moments, memory.left
    return RunningMoments(np.moveaxis(moments, 1, 0), left)


# A cross-validation asks in every fold; thresholds are whole decibels, so that the answer is mostly known.
@functools.lru_cache(maxsize=1 << 13)
def movements(track: FeatureTrack, threshold_dbfs: float) -> NDArray[np.float32]:
    """Tell how far a memory that nothing surprises moves on one surface, shape ``(windows, channels, values)``."""
    memory = RunningStatistics(np.zeros((*track.description.shape[1:], VALUES)))
    told = []
    for description, contact in _windows(track, threshold_dbfs):
        memory.push(description, contact=contact)
        if contact and (moved := memory.moved()) is not None:
            told.append(moved)
    return np.array(told, np.float32).reshape(-1, *track.description.shape[1:])


def _windows(track: FeatureTrack, threshold_dbfs: float) -> Iterator[tuple[FloatArray, bool]]:
    return zip(track.description, (track.level_dbfs >= threshold_dbfs).tolist(), strict=True)
