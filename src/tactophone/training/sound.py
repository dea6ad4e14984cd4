"""Reads recordings as the live system hears them: through the same resampler, to the model's rate."""

import functools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import soundfile

from tactophone.dataset import Recording, channel_order
from tactophone.errors import DatasetError
from tactophone.link import Codec, round_trip
from tactophone.perception.features.resample import Resampler
from tactophone.types import FloatArray

RATE = 2000
"""Hz, at which the paper's network hears."""

READ_SIZE = 1 << 15
"""Samples read at once; the resampler's working memory grows with it."""

OPUS_RATE = 48_000


def read_signals(
    recordings: Sequence[Recording],
    *,
    channels: int,
    rate: int = RATE,
    codec: Codec | None = None,
    alone: str = "contact",
    report: Callable[[int], None] = lambda done: None,
) -> list[FloatArray]:
    """Read recordings at a model's rate, each of shape ``(samples, channels)``; those read before are remembered.

    Parameters
    ----------
    recordings
        Usable ones: :func:`tactophone.dataset.usable` leaves the others out.
    channels
        2, or 1.
    rate
        In Hz.
    codec
        Sound is passed through it and back, as the network will hear it behind the link.
    alone
        Which microphone to hear where there is one channel; the file's first, if it has none such.
    report
        Called with the number of recordings read.

    Raises
    ------
    DatasetError
        If a file cannot be read, or has not the channels, or the rate that the codec wants.
    """
    signals = []
    for done, recording in enumerate(recordings, 1):
        order = channel_order(recording, wanted=channels, alone=alone)
        try:
            signals.append(_read(recording.path, recording.path.stat().st_mtime_ns, order, rate, codec))
        except (soundfile.LibsndfileError, OSError) as error:
            raise DatasetError(f"{recording.path}: {error}; run `tactophone dataset check` on its folder") from error
        report(done)
    return signals


# A cross-validation reads every file in every fold; at 2 kHz the paper's whole set takes 67 MB.
@functools.lru_cache(maxsize=1 << 14)
def _read(path: Path, changed_ns: int, order: tuple[int, ...], rate: int, codec: Codec | None) -> FloatArray:
    with soundfile.SoundFile(path) as file:
        if max(order) >= file.channels:
            raise DatasetError(f"{path}: has {file.channels} channel, but {len(order)} are wanted; use one-channel")
        resampler = Resampler(file.samplerate, rate, channels=len(order))
        read = file.blocks(READ_SIZE, dtype="float32", always_2d=True)
        blocks: Iterable[FloatArray] = (np.ascontiguousarray(block[:, order]) for block in read)
        if codec:
            # The codec remembers what came before, so it gets the recording in one piece.
            blocks = [_through(codec, np.concatenate(list(blocks)), path, file.samplerate)]
        taken = [resampler.push(block) for block in blocks]
        return np.concatenate([*taken, resampler.flush()])


def _through(codec: Codec, samples: FloatArray, path: Path, sample_rate: int) -> FloatArray:
    if sample_rate != OPUS_RATE:
        raise DatasetError(f"{path}: {sample_rate} Hz, but Opus works at {OPUS_RATE} Hz; leave --opus away")
    return round_trip(samples, codec)
