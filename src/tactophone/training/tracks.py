"""Sound and features of whole recordings, by the live stages: resampler, windows, running statistics.

The running statistics of texture features start with the moments of the average touch, which are known only once the
training recordings are chosen. Their weight at each window is known in advance, so they are added afterwards.
"""

import functools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.dataset.values import Recording
from tactophone.errors import DatasetError
from tactophone.link.codec import Codec, encode_and_decode
from tactophone.perception.features import BAND_VALUES, EXTRACTORS, BandFeatures
from tactophone.perception.levels import banded_dbfs
from tactophone.perception.model_file import Gate, ModelCard
from tactophone.perception.resample import Resampler
from tactophone.perception.texture import (
    MEMORY,
    SILENT_POWER,
    ChangeMetric,
    Moments,
    RunningStatistics,
    fading_of,
    texture_features,
)
from tactophone.training.recipes import NETWORK_RATE, FeatureKind, Microphone, Offset, silent
from tactophone.types import CONTACT, LIVE_SAMPLE_RATE, FloatArray

FEATURE_RATE = 16_000
"""Sample rate in Hz that all of these features are computed at."""

WINDOWS: dict[FeatureKind, tuple[int, Fraction]] = {
    "texture": (512, Fraction(160)),
    "cues": (4096, Fraction(512, 3)),
    "scalogram": (4096, Fraction(512, 3)),
}
"""Window and hop in samples: 32 ms a hundred times a second, or the paper's 256 ms at every sound buffer."""

_TEXTURE_HOP = float(WINDOWS["texture"][1] / FEATURE_RATE)


@dataclass(frozen=True, slots=True)
class FeatureSpec:
    """Which features are extracted, from what sound."""

    kind: FeatureKind = "texture"
    channels: int = 2
    codec: Codec | None = None
    """Codec that the sound passes through first."""
    microphone: Microphone = "contact"
    """The microphone used where ``channels`` is 1; the file's first, if it has none of that name."""
    change_detection: bool = True
    """Whether the running statistics restart where the surface changes."""
    memory: float = MEMORY
    """Of the running statistics, in s."""
    unevenness: bool = False
    """Whether texture features hold the unevenness of the treble: for hard tips."""

    @property
    def values(self) -> int:
        """Values that describe one channel of a window in texture features."""
        return BAND_VALUES + self.unevenness


@dataclass(frozen=True, slots=True, eq=False)
class FeatureTrack:
    """The features of one recording, window by window."""

    recording: Recording
    """Where they come from."""
    description: NDArray[np.float32]
    """Of kind ``texture``: descriptions before the running statistics, shape ``(windows, channels, values)``; of
    other kinds: the features, shape ``(windows, features)``."""
    level_dbfs: NDArray[np.float64]
    """Banded level of the contact channel."""
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    """`start` and `end`: of each window, in s."""
    present: NDArray[np.bool_]
    """Whether each channel carries a signal, shape ``(windows, channels)``."""

    def touching(self) -> NDArray[np.bool_]:
        """Whether the segments label each window's end as contact; true throughout where there are no segments."""
        return self._in_contact(self.end) if self.recording.segments else np.ones(len(self.end), bool)

    def quiet(self) -> NDArray[np.bool_]:
        """Whether each window lies in a segment without contact; false where there are no segments."""
        inside = np.zeros(len(self.end), bool)
        for segment in self.recording.segments:
            if not segment.contact:
                inside |= (self.start >= segment.start) & (self.end <= segment.end)
        return inside & ~self._in_contact(self.start)

    def _in_contact(self, start: NDArray[np.float64]) -> NDArray[np.bool_]:
        inside = np.zeros(len(self.end), bool)
        for segment in self.recording.segments:
            if segment.contact:
                inside |= (self.end > segment.start) & (start <= segment.end)
        return inside


@dataclass(frozen=True, slots=True, eq=False)
class RunningMoments:
    """The running statistics of a track after each window, without the prior."""

    moments: Moments
    """Shape ``(2, windows, channels, values)``."""
    prior_weight: NDArray[np.float64]
    """Weight of the average touch, shape ``(windows,)``."""

    def offset(self, offset: Offset) -> "RunningMoments":
        """Return the moments as they are with an offset added to every description.

        With weights that sum to w, one less that of the prior: m becomes m + w a, and s becomes s + 2 a m + w a^2.
        """
        mean, square = self.moments
        weight = 1 - self.prior_weight[:, None, None]
        moved = np.stack((mean + weight * offset, square + 2 * offset * mean + weight * offset * offset))
        return RunningMoments(moved, self.prior_weight)

    def features(self, prior: Moments, present: NDArray[np.bool_]) -> FloatArray:
        """Return what the live extractor returns with this prior, shape ``(windows, features)``.

        ``prior`` has shape ``(2, channels, values)``; ``present`` is :attr:`FeatureTrack.present`.
        """
        # (windows, 1, 1) * (2, 1, channels, values): each window's share of the prior, for both moments.
        features = texture_features(self.moments + self.prior_weight[:, None, None] * prior[:, None])
        features[~present] = np.nan
        return features.reshape(len(features), -1)


def read_signals(
    recordings: Sequence[Recording],
    *,
    channels: int,
    rate: int = NETWORK_RATE,
    codec: Codec | None = None,
    microphone: str = "contact",
    report: Callable[[int], None] = silent,
) -> list[FloatArray]:
    """Read recordings at a model's sample rate; those read before come from a cache.

    Parameters
    ----------
    recordings
        Usable ones: :func:`tactophone.dataset.usable` leaves the others out.
    channels
        2, or 1.
    rate
        In Hz.
    codec
        Codec that the sound passes through first, as it does on the link.
    microphone
        Which microphone to read where ``channels`` is 1; the file's first, if it has none of that name.
    report
        Called with the number of recordings read.

    Returns
    -------
    list of ndarray
        A recording each, float32, shape ``(samples, channels)``, channel 0 contact.

    Raises `DatasetError` if a file cannot be read, has too few channels, or not the sample rate of the codec.
    """
    signals = []
    for done, recording in enumerate(recordings, 1):
        changed = recording.path.stat().st_mtime_ns if recording.path.is_file() else 0
        signals.append(_read(recording, changed, channels, rate, codec, microphone))
        report(done)
    return signals


# A cross-validation reads every file in every fold; at 2 kHz the paper's whole set takes 67 MB.
@functools.lru_cache(maxsize=1 << 14)
def _read(
    recording: Recording, changed_ns: int, channels: int, rate: int, codec: Codec | None, microphone: str
) -> FloatArray:
    blocks = list(recording.blocks(channels=channels, single=microphone))
    if not blocks:
        return np.zeros((0, channels), np.float32)
    sample_rate, pieces = blocks[0].sample_rate, [block.samples for block in blocks]
    if codec:
        if sample_rate != LIVE_SAMPLE_RATE:
            raise DatasetError(
                f"{recording.path}: {sample_rate} Hz, but Opus works at {LIVE_SAMPLE_RATE} Hz; leave out opus_bitrate"
            )
        # The codec's state runs through the whole recording, so it gets it in one piece.
        pieces = [encode_and_decode(np.concatenate(pieces), codec)]
    resampler = Resampler(sample_rate, rate, channels=channels)
    return np.concatenate([*map(resampler.push, pieces), resampler.flush()])


def extract_features(
    recordings: Sequence[Recording], spec: FeatureSpec, *, report: Callable[[int], None] = silent
) -> list[FeatureTrack]:
    """Extract the features of recordings; those extracted before come from a cache."""
    tracks = []
    for done, recording in enumerate(recordings, 1):
        changed = recording.path.stat().st_mtime_ns if recording.path.is_file() else 0
        tracks.append(_extract_track(recording, changed, spec))
        report(done)
    return tracks


@functools.lru_cache(maxsize=1 << 13)
def _extract_track(recording: Recording, changed_ns: int, spec: FeatureSpec) -> FeatureTrack:
    (signal,) = read_signals(
        [recording], channels=spec.channels, rate=FEATURE_RATE, codec=spec.codec, microphone=spec.microphone
    )
    size, hop = WINDOWS[spec.kind]
    count = max(0, int((len(signal) - size) / hop) + 1)
    # The hop may be a fraction of a sample; each start is rounded down, as in the live stage.
    starts = np.array([int(k * hop) for k in range(count)], np.intp)
    windows = sliding_window_view(np.pad(signal, ((0, max(0, size - len(signal))), (0, 0))), size, axis=0)
    windows = windows[starts].swapaxes(1, 2)
    level_dbfs = np.array([banded_dbfs(window[:, CONTACT]) for window in windows])
    present = np.square(windows).sum(axis=1) >= SILENT_POWER * size
    start, end = starts / FEATURE_RATE, (starts + size) / FEATURE_RATE
    return FeatureTrack(recording, _describe(windows, spec), level_dbfs, start, end, present)


def _describe(windows: FloatArray, spec: FeatureSpec) -> NDArray[np.float32]:
    size, hop = WINDOWS[spec.kind]
    if spec.kind == "texture":
        bands = BandFeatures(size, FEATURE_RATE, unevenness=spec.unevenness)
        return bands.describe(bands.spectrum(windows)).reshape(-1, spec.channels, spec.values)
    extractor = EXTRACTORS[spec.kind](ModelCard("", spec.kind, FEATURE_RATE, size, hop, spec.channels, Gate(0.0)))
    descriptions = extractor.describe(windows)
    return np.array([extractor.push(description, contact=True) for description in descriptions], np.float32)


def accumulate(
    track: FeatureTrack, threshold_dbfs: float, change_metric: ChangeMetric, *, memory: float = MEMORY
) -> RunningMoments:
    """Return the running statistics of a track; contact begins at a threshold."""
    statistics = RunningStatistics(change_metric, fading=fading_of(memory, _TEXTURE_HOP))
    moments = np.empty((len(track.description), 2, *track.description.shape[1:]))
    prior_weight = np.empty(len(moments))
    for number, (description, contact) in enumerate(_windows(track, threshold_dbfs)):
        statistics.push(description, contact=contact)
        moments[number], prior_weight[number] = statistics.moments, statistics.prior_weight
    # The moments come first, as everywhere else: (windows, 2, ...) to (2, windows, ...).
    return RunningMoments(np.moveaxis(moments, 1, 0), prior_weight)


# A cross-validation asks in every fold; thresholds are whole decibels, so that most answers are in the cache.
@functools.lru_cache(maxsize=1 << 13)
def mean_shifts(track: FeatureTrack, threshold_dbfs: float, memory: float = MEMORY) -> NDArray[np.float32]:
    """Return how far the newest mean lies from the running one on one surface, ``(windows, channels, values)``."""
    channels, values = track.description.shape[1:]
    nothing = np.zeros((channels, values, values))
    statistics = RunningStatistics(nothing, fading=fading_of(memory, _TEXTURE_HOP))
    shifts = []
    for description, contact in _windows(track, threshold_dbfs):
        statistics.push(description, contact=contact)
        if contact and (shift := statistics.shift()) is not None:
            shifts.append(shift)
    return np.array(shifts, np.float32).reshape(-1, *track.description.shape[1:])


def _windows(track: FeatureTrack, threshold_dbfs: float) -> Iterator[tuple[FloatArray, bool]]:
    return zip(track.description, (track.level_dbfs >= threshold_dbfs).tolist(), strict=True)
