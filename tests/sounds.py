"""Test sounds, and odd block sizes."""

from collections.abc import Iterator

import numpy as np

from tactophone.core.types import AudioBlock, FloatArray

ODD_SIZES = (1, 17, 480, 509)


def tone(
    frequency: float,
    *,
    amplitude: float = 0.5,
    duration: float = 1.0,
    sample_rate: int = 48_000,
) -> FloatArray:
    """One channel of a sine, shape ``(samples, 1)``."""
    time = np.arange(round(duration * sample_rate)) / sample_rate
    return (amplitude * np.sin(2 * np.pi * frequency * time)).astype(np.float32)[
        :, None
    ]


def noise(
    *,
    level_dbfs: float = -20.0,
    duration: float = 1.0,
    channels: int = 2,
    seed: int = 0,
) -> FloatArray:
    """White Gaussian noise at 48 kHz, shape ``(samples, channels)``."""
    samples = np.random.default_rng(seed).standard_normal(
        (round(duration * 48_000), channels)
    )
    return (samples * 10 ** (level_dbfs / 20)).astype(np.float32)


def blocks(
    samples: FloatArray, size: int, *, sample_rate: int = 48_000
) -> Iterator[AudioBlock]:
    """Cut sound into blocks of a size."""
    for start in range(0, len(samples), size):
        yield AudioBlock(samples[start : start + size], sample_rate, start)


def strokes(*, duration: float = 2.0) -> FloatArray:
    """A rough stroke from 0.5 to 1.0 s, a smooth one from 1.5 s to the end, 60 dB over
    silence."""
    samples = noise(level_dbfs=-80, duration=duration, channels=1)
    samples[24_000:48_000] += tone(400, duration=0.5)
    samples[72_000:] += tone(100, duration=duration - 1.5)
    return samples
