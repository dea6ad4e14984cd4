"""Synthetic surfaces, one second each, so smooth or so rough that every working
detector classifies them."""

from pathlib import Path

import numpy as np
import soundfile

from tactophone.core.recordings.values import Dataset, Recording, Segment
from tactophone.core.types import FloatArray, Touch

RATE = 16_000
DURATION = 1.2
TOUCHED = (0.3, 1.0)
"""Seconds of each recording in which there is contact."""


def scrape(*, rough: bool, seed: int, channels: int = 2) -> FloatArray:
    """Sound of a finger that comes, slides and goes: hiss, and on rough surfaces
    separate impacts too."""
    rng = np.random.default_rng(seed)
    size = round(DURATION * RATE)
    time = np.arange(size) / RATE
    touched = (time >= TOUCHED[0]) & (time < TOUCHED[1])
    hiss = rng.standard_normal(size) * 10 ** rng.uniform(-2.2, -1.6)
    bumps = np.zeros(size)
    if rough:
        places = rng.choice(np.flatnonzero(touched), 60, replace=False)
        bumps[places] = rng.uniform(2, 4, 60)
        bumps = (
            np.convolve(
                bumps, np.exp(-np.arange(40) / 8) * np.cos(np.arange(40)), mode="same"
            )
            * 0.1
        )
    contact = (hiss + bumps) * touched + rng.standard_normal(size) * 1e-4
    air = 0.2 * contact + rng.standard_normal(size) * 1e-4
    return np.stack([contact, air], axis=1)[:, :channels].astype(np.float32)


def surfaces(folder: Path, *, each: int = 4, channels: int = 2) -> Dataset:
    """Write some smooth and as many rough surfaces, a recording each, with the times of
    contact."""
    return Dataset(
        "scrapes",
        folder,
        tuple(_surface(folder, number, channels) for number in range(2 * each)),
    )


def _surface(folder: Path, number: int, channels: int) -> Recording:
    rough = bool(number % 2)
    path = folder / f"{number}.wav"
    soundfile.write(
        path, scrape(rough=rough, seed=number, channels=channels), RATE, subtype="FLOAT"
    )
    word = "rough" if rough else "smooth"
    begin, end = TOUCHED
    segments = (
        Segment(0, begin, "none"),
        Segment(begin, end, word),
        Segment(end, DURATION, "none"),
    )
    names = ("contact", "air")[:channels]
    return Recording(
        path,
        f"{word} {number}",
        Touch.ROUGH if rough else Touch.SMOOTH,
        names,
        segments=segments,
    )
