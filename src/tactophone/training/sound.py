"""Reads recordings as the live system does: through the same resampler, to the model's sample rate."""

import functools
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np
import soundfile

from tactophone.dataset import Recording, channel_order
from tactophone.errors import DatasetError
from tactophone.link import Codec, encode_and_decode
from tactophone.perception import Resampler
from tactophone.training.network.settings import NETWORK_RATE
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray

READ_SIZE = 1 << 15
"""Samples read at once; the resampler's working memory grows with it."""


def read_signals(
    recordings: Sequence[Recording],
    *,
    channels: int,
    rate: int = NETWORK_RATE,
    codec: Codec | None = None,
    microphone: str = "contact",
    report: Callable[[int], None] = lambda done: None,
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

    Raises
    ------
    DatasetError
        If a file cannot be read, has too few channels, or not the sample rate of the codec.
    """
    signals = []
    for done, recording in enumerate(recordings, 1):
        order = channel_order(recording, count=channels, single=microphone)
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
            raise DatasetError(
                f"{path}: has {file.channels} channel, but {len(order)} are needed; train on one: "
                "--channels 1, or with the recipe paper --variant one-channel"
            )
        resampler = Resampler(file.samplerate, rate, channels=len(order))
        read = file.blocks(READ_SIZE, dtype="float32", always_2d=True)
        blocks: Iterable[FloatArray] = (np.ascontiguousarray(block[:, order]) for block in read)
        if codec:
            # The codec's state runs through the whole recording, so it gets it in one piece.
            blocks = [_through(codec, np.concatenate(list(blocks)), path, file.samplerate)]
        return np.concatenate([*map(resampler.push, blocks), resampler.flush()])


def _through(codec: Codec, samples: FloatArray, path: Path, sample_rate: int) -> FloatArray:
    if sample_rate != LIVE_SAMPLE_RATE:
        raise DatasetError(
            f"{path}: {sample_rate} Hz, but Opus works at {LIVE_SAMPLE_RATE} Hz; leave out --opus-bitrate"
        )
    return encode_and_decode(samples, codec)
