"""Sound and features of whole recordings, by the live stages: resampler, windows, running statistics.

The running statistics of texture features start with the moments of the average touch, which are known only once the
training recordings are chosen. Their weight at each window is known in advance, so they are added afterwards.
"""

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.dataset.values import Recording
from tactophone.errors import DatasetError
from tactophone.link.codec import Codec, encode_and_decode
from tactophone.perception.levels import banded_dbfs
from tactophone.perception.resample import Resampler
from tactophone.training.recipes import BAND_VALUES, MEMORY, NETWORK_RATE, FeatureKind, Microphone, Offset, silent
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

MIN_VARIANCE = 1e-4
"""Keeps the root of a variance from being NaN after rounding; negligible beside any real variance."""

SILENT_POWER = 1e-14
"""Mean square, -140 dBFS, under which a channel carries no signal: even a good microphone's noise is far over it."""

Moments = NDArray[np.float64]
"""Mean and mean square of descriptions, shape ``(2, channels, values)``."""

ChangeMetric = NDArray[np.float64]
"""A matrix for each channel, shape ``(channels, values, values)``. It maps the shift of the mean to a vector longer
than 1 for one window in a hundred on one and the same surface; zeros never detect a change."""


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
    def fading(self) -> float:
        """The memory in windows.

        >>> FeatureSpec(memory=0.25).fading
        25.0
        """
        return self.memory / _TEXTURE_HOP

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
        """Return what the model's graph computes with this prior, shape ``(windows, features)``.

        ``prior`` has shape ``(2, channels, values)``; ``present`` is :attr:`FeatureTrack.present`.
        """
        # (windows, 1, 1) * (2, 1, channels, values): each window's share of the prior, for both moments.
        mean, square = self.moments + self.prior_weight[:, None, None] * prior[:, None]
        deviation = np.sqrt(np.maximum(square - mean * mean, MIN_VARIANCE))
        features = np.concatenate((mean, deviation), axis=-1).astype(np.float32)
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
    from tactophone.training import features  # here, as it needs torch

    return FeatureTrack(recording, features.describe(windows, spec), level_dbfs, start, end, present)


def accumulate(
    tracks: Sequence[FeatureTrack], thresholds_dbfs: Sequence[float], change_metric: ChangeMetric, *, fading: float
) -> list[RunningMoments]:
    """Return the running statistics of tracks; contact begins at the threshold of each."""
    found = []
    for track, (_, states) in zip(tracks, _run(tracks, thresholds_dbfs, change_metric, fading), strict=True):
        # The moments come first, as everywhere else: (windows, 2, ...) to (2, windows, ...).
        moments = states["running"].reshape(-1, 2, *track.description.shape[1:])
        found.append(RunningMoments(np.moveaxis(moments, 1, 0).copy(), 1 - states["evidence"][:, 0]))
    return found


def mean_shifts(
    tracks: Sequence[FeatureTrack], thresholds_dbfs: Sequence[float], *, fading: float
) -> list[NDArray[np.float32]]:
    """Return how far the newest mean lies from the running one on one surface, ``(windows, channels, values)``."""
    from tactophone.training.features import BEFORE, SETTLED, shift_of

    channels, values = tracks[0].description.shape[1:]
    shifts = []
    for loud, states in _run(tracks, thresholds_dbfs, np.zeros((channels, values, values)), fading):
        settled = loud & (states["count"][:, 0] >= BEFORE + SETTLED)
        shift = shift_of({name: each[settled] for name, each in states.items()})
        shifts.append(shift.reshape(-1, channels, values).astype(np.float32))
    return shifts


def _run(
    tracks: Sequence[FeatureTrack], thresholds_dbfs: Sequence[float], change_metric: ChangeMetric, fading: float
) -> Iterator[tuple[NDArray[np.bool_], Mapping[str, NDArray[np.float64]]]]:
    from tactophone.training.features import run_statistics

    loud = [track.level_dbfs >= threshold for track, threshold in zip(tracks, thresholds_dbfs, strict=True)]
    descriptions = [track.description for track in tracks]
    return zip(loud, run_statistics(descriptions, loud, change_metric, fading=fading), strict=True)
