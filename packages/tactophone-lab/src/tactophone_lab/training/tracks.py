"""Sound and features of whole recordings, by the live stages: resampler, windows,
running statistics.

The running statistics of texture features start with the moments of the average touch,
which are known only once the training recordings are chosen. Their weight at each
window is known in advance, so they are added afterwards.
"""

import functools
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.microphones import CONTACT
from tactophone.core.recordings.sound_file import sound_info
from tactophone.core.recordings.values import Recording
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray, ignore
from tactophone.net.link.codec import Codec, encode_and_decode
from tactophone.signal.perception.levels import ZERO_DBFS
from tactophone.signal.perception.resample import RESAMPLER_LOWEST_RATE, Resampler
from tactophone_lab.training.recipe_options import (
    FEATURE_RATE,
    MIN_VARIANCE,
    NETWORK_RATE,
    SILENT_POWER,
    WINDOWS,
    FeatureSpec,
)

Moments = NDArray[np.float64]
"""Mean and mean square of descriptions, shape ``(2, channels, values)``."""

ChangeMetric = NDArray[np.float64]
"""A matrix for each channel, shape ``(channels, values, values)``. It maps the shift of
the mean to a vector longer than 1 for one window in a hundred on one and the same
surface; zeros never detect a change."""


@dataclass(frozen=True, slots=True, eq=False)
class FeatureTrack:
    """The features of one recording, window by window."""

    recording: Recording
    """Where they come from."""
    description: NDArray[np.float32]
    """Of kind ``texture``: descriptions before the running statistics, shape
    ``(windows, channels, values)``; of other kinds: the features, shape ``(windows,
    features)``."""
    level_dbfs: NDArray[np.float64]
    """Banded level of the contact channel."""
    start: NDArray[np.float64]
    end: NDArray[np.float64]
    """`start` and `end`: of each window, in s."""
    present: NDArray[np.bool_]
    """Whether each channel carries a signal, shape ``(windows, channels)``."""
    varied: bool = False
    """Whether it is a copy."""

    def loud(self, threshold_dbfs: float) -> NDArray[np.bool_]:
        """Whether each window is contact by a threshold.

        A recording without segments is contact throughout; another set's noise says
        nothing about its level. A copy has another gain and other noise, which the live
        threshold would follow.
        """
        if not self.recording.segments:
            threshold_dbfs = ALWAYS_DBFS
        elif self.varied:
            threshold_dbfs = noise_level([self])
        return self.level_dbfs >= threshold_dbfs

    def touching(self) -> NDArray[np.bool_]:
        """Whether the segments label each window's end as contact; true throughout
        where there are no segments."""
        return (
            self._in_contact(self.end)
            if self.recording.segments
            else np.ones(len(self.end), bool)
        )

    def quiet(self) -> NDArray[np.bool_]:
        """Whether each window lies in a segment without contact; false where there are
        no segments."""
        quiet = [each for each in self.recording.segments if not each.contact]
        inside = [(self.start >= each.start) & (self.end <= each.end) for each in quiet]
        return np.asarray(
            np.any([np.zeros(len(self.end), bool), *inside], axis=0)
            & ~self._in_contact(self.start)
        )

    def _in_contact(self, start: NDArray[np.float64]) -> NDArray[np.bool_]:
        touches = [each for each in self.recording.segments if each.contact]
        inside = [(self.end > each.start) & (start <= each.end) for each in touches]
        return np.asarray(np.any([np.zeros(len(self.end), bool), *inside], axis=0))


@dataclass(frozen=True, slots=True, eq=False)
class RunningMoments:
    """The running statistics of a track after each window, without the prior."""

    moments: Moments
    """Shape ``(2, windows, channels, values)``."""
    prior_weight: NDArray[np.float64]
    """Weight of the average touch, shape ``(windows,)``."""

    def features(self, prior: Moments, present: NDArray[np.bool_]) -> FloatArray:
        """Return what the model's graph computes with this prior, shape ``(windows,
        features)``.

        ``prior`` has shape ``(2, channels, values)``; ``present`` is
        :attr:`FeatureTrack.present`.
        """
        # (windows, 1, 1) * (2, 1, channels, values): each window's share of the prior,
        # for both moments.
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
    report: Callable[[int], None] = ignore,
) -> list[FloatArray]:
    """Read usable recordings at a model's sample rate in Hz; those read before come
    from a cache.

    The sound passes through the codec first, as it does on the link. ``microphone`` is
    the one to read where ``channels`` is 1; the file's first, if it has none of that
    name. ``report`` is called with the number read. Returns float32 of shape
    ``(samples, channels)`` for each, channel 0 contact. Raises `DatasetError` if a file
    cannot be read, has too few channels, or not the sample rate of the codec.
    """
    signals = []
    for done, recording in enumerate(recordings, 1):
        signals.append(
            _read(recording, _changed_ns(recording), channels, rate, codec, microphone)
        )
        report(done)
    return signals


# A cross-validation reads every file in every fold; at 2 kHz the paper's whole set
# takes 67 MB.
@functools.lru_cache(maxsize=1 << 14)
def _read(
    recording: Recording,
    changed_ns: int,
    channels: int,
    rate: int,
    codec: Codec | None,
    microphone: str,
) -> FloatArray:
    return _read_at(recording, channels, rate, codec, microphone)


def _read_at(
    recording: Recording,
    channels: int,
    rate: int,
    codec: Codec | None,
    microphone: str,
    speed: float = 1.0,
) -> FloatArray:
    blocks = list(recording.blocks(channels=channels, single=microphone))
    if not blocks:
        return np.zeros((0, channels), np.float32)
    sample_rate = blocks[0].sample_rate
    pieces = [block.samples for block in blocks]
    if codec:
        if sample_rate != LIVE_SAMPLE_RATE:
            raise DatasetError(
                f"{recording.path}: {sample_rate} Hz, but Opus works at "
                f"{LIVE_SAMPLE_RATE} Hz; leave out opus_bitrate"
            )
        # The codec's state runs through the whole recording, so it gets it in one
        # piece.
        pieces = [encode_and_decode(np.concatenate(pieces), codec)]
    # As if recorded at another rate; in whole kHz, as kernels of two rates without a
    # common divisor are huge.
    played = sample_rate if speed == 1 else round(speed * sample_rate / 1000) * 1000
    resampler = Resampler(played, rate, channels=channels)
    signal = np.concatenate([*map(resampler.push, pieces), resampler.flush()])
    gain_db = float(recording.known("gain_db") or 0)
    if gain_db and (channels > 1 or microphone == "contact"):
        # Rendered more quietly so that it does not clip; models expect the
        # preamplifier's usual gain.
        signal[:, CONTACT] *= 10 ** (-gain_db / 20)
    return signal


def extract_features(
    recordings: Sequence[Recording], spec: FeatureSpec
) -> list[FeatureTrack]:
    """Extract the features of recordings; those extracted before come from a cache."""
    return [
        _extract_track(recording, _changed_ns(recording), spec)
        for recording in recordings
    ]


def _changed_ns(recording: Recording) -> int:
    return recording.path.stat().st_mtime_ns if recording.path.is_file() else 0


@functools.lru_cache(maxsize=1 << 13)
def _extract_track(
    recording: Recording, changed_ns: int, spec: FeatureSpec
) -> FeatureTrack:
    number = spec.copy[1]
    if number and spec.augmentation:
        rng = np.random.default_rng(
            [
                *spec.copy,
                zlib.crc32(f"{recording.surface} {recording.path.name}".encode()),
            ]
        )
        # Played as slowly as it can be resampled, where it holds little over 2 kHz.
        slowest = RESAMPLER_LOWEST_RATE / sound_info(recording.path).sample_rate
        speed = max(spec.augmentation.draw_speed(rng), slowest)
        # Not kept: a copy is described once.
        signal = _read_at(
            recording, spec.channels, FEATURE_RATE, spec.codec, spec.microphone, speed
        )
        signal = spec.augmentation.vary(signal, FEATURE_RATE, rng)
        segments = (
            replace(each, start=each.start / speed, end=each.end / speed)
            for each in recording.segments
        )
        recording = replace(recording, segments=tuple(segments))
    else:
        (signal,) = read_signals(
            [recording],
            channels=spec.channels,
            rate=FEATURE_RATE,
            codec=spec.codec,
            microphone=spec.microphone,
        )
    size, hop = WINDOWS[spec.kind]
    count = max(0, int((len(signal) - size) / hop) + 1)
    # The hop may be a fraction of a sample; each start is rounded down, as in the live
    # stage.
    starts = np.arange(count) * hop.numerator // hop.denominator
    windows = sliding_window_view(
        np.pad(signal, ((0, max(0, size - len(signal))), (0, 0))), size, axis=0
    )
    windows = windows[starts].swapaxes(1, 2)
    level_dbfs = banded_levels(windows[:, :, CONTACT])
    present = np.square(windows).sum(axis=1) >= SILENT_POWER * size
    start = starts / FEATURE_RATE
    end = (starts + size) / FEATURE_RATE
    from tactophone_lab.training import features  # here, as it needs torch

    return FeatureTrack(
        recording,
        features.describe(windows, spec),
        level_dbfs,
        start,
        end,
        present,
        number > 0,
    )


def banded_levels(windows: FloatArray) -> NDArray[np.float64]:
    """Return :func:`signal.perception.levels.banded_dbfs` of many windows ``(windows,
    samples)``, at once."""
    size = windows.shape[1]
    taper = np.hanning(size + 1)[:-1].astype(np.float32)
    spectra = (
        np.fft.rfft(part * taper)[:, size // 64 : size // 4]
        for part in _pieces(windows)
    )
    powers = np.concatenate(
        [np.square(np.abs(each)).sum(axis=1, dtype=np.float64) for each in spectra]
    )
    levels = 10 * np.log10(2 * powers / (3 / 8 * size * size) + 1e-30)
    return np.asarray(np.maximum(levels, ZERO_DBFS))


def _pieces(windows: FloatArray) -> Iterator[FloatArray]:
    return (windows[at : at + 256] for at in range(0, max(1, len(windows)), 256))


FALSE_CONTACTS = 0.01
"""Share of windows without contact that pass the gate's threshold."""

ALWAYS_DBFS = -120.0
"""Threshold where the recordings hold no silence to learn one from: every window counts
as contact."""


def noise_level(tracks: Sequence[FeatureTrack]) -> float:
    """Return the banded level, in whole dBFS, that one quiet window in a hundred
    exceeds."""
    quiet = np.concatenate([track.level_dbfs[track.quiet()] for track in tracks])
    return (
        float(np.ceil(np.quantile(quiet, 1 - FALSE_CONTACTS)))
        if len(quiet)
        else ALWAYS_DBFS
    )


def accumulate(
    tracks: Sequence[FeatureTrack],
    threshold_dbfs: float,
    change_metric: ChangeMetric,
    *,
    fading: float,
) -> list[RunningMoments]:
    """Return the running statistics of tracks; contact begins at the threshold."""
    found = []
    for track, (_, states) in zip(
        tracks, _run(tracks, threshold_dbfs, change_metric, fading), strict=True
    ):
        # The moments come first, as everywhere else: (windows, 2, ...) to (2, windows,
        # ...).
        moments = states["running"].reshape(-1, 2, *track.description.shape[1:])
        found.append(
            RunningMoments(
                np.moveaxis(moments, 1, 0).copy(), 1 - states["evidence"][:, 0]
            )
        )
    return found


def mean_shifts(
    tracks: Sequence[FeatureTrack], threshold_dbfs: float, *, fading: float
) -> list[NDArray[np.float32]]:
    """Return how far the newest mean lies from the running one on one surface,
    ``(windows, channels, values)``."""
    from tactophone_lab.training.features import BEFORE, STATISTICS_SETTLED, shift_of

    channels, values = tracks[0].description.shape[1:]
    shifts = []
    for loud, states in _run(
        tracks, threshold_dbfs, np.zeros((channels, values, values)), fading
    ):
        settled = loud & (states["count"][:, 0] >= BEFORE + STATISTICS_SETTLED)
        shift = shift_of({name: each[settled] for name, each in states.items()})
        shifts.append(shift.reshape(-1, channels, values).astype(np.float32))
    return shifts


def _run(
    tracks: Sequence[FeatureTrack],
    threshold_dbfs: float,
    change_metric: ChangeMetric,
    fading: float,
) -> Iterator[tuple[NDArray[np.bool_], Mapping[str, NDArray[np.float64]]]]:
    from tactophone_lab.training.features import run_statistics

    loud = [track.loud(threshold_dbfs) for track in tracks]
    descriptions = [track.description for track in tracks]
    return zip(
        loud,
        run_statistics(descriptions, loud, change_metric, fading=fading),
        strict=True,
    )
