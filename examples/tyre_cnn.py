"""A network on pictures of the sound, as for tyre noise, scored: ``python
examples/tyre_cnn.py DIR [SPLIT]``.

Log spectrograms of 256 ms of the contact microphone, two convolutions, one logit; the
paper names it as related work.
"""

import sys
from collections.abc import Sequence

import numpy as np
import torch
from numpy.lib.stride_tricks import sliding_window_view
from torch import nn

from tactophone.core.recordings.values import Recording
from tactophone_lab.benchmark.folds import cross_validate
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split
from tactophone_lab.evaluation.predict import Predictor, TakePredictions
from tactophone_lab.evaluation.scores import make_report
from tactophone_lab.training.sets import even_weights

WINDOW = 0.256
"""Seconds of sound in a picture."""

HOP = 0.032
"""Seconds from one picture to the next."""

SLICE = 0.016
"""Seconds of sound in one of a picture's 16 columns."""

BANDS = 32
"""Frequency bands in a picture, evenly spaced over the logarithm."""

CONTACT_DB = 12.0
"""Level in dB over the noise floor from which a window counts as contact."""


def pictures(recording: Recording) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the end in s, the picture (16 times 32 bands in log power) and the level
    in dB of each window."""
    sound = recording.read(channels=1)
    rate, size = sound.sample_rate, round(SLICE * sound.sample_rate)
    slices = sound.samples[: len(sound.samples) // size * size, 0].reshape(-1, size)
    powers = np.abs(np.fft.rfft(slices * np.hanning(size))) ** 2 / size
    edges = np.geomspace(60, min(8000, rate / 2), BANDS + 1)
    bins = np.searchsorted(edges, np.fft.rfftfreq(size, 1 / rate)).clip(1, BANDS) - 1
    bands = np.stack(
        [powers[:, bins == band].sum(axis=1) for band in range(BANDS)], axis=1
    )
    wide, step = round(WINDOW / SLICE), round(HOP / SLICE)
    shown = (
        sliding_window_view(np.log(bands + 1e-9), wide, axis=0)[::step]
        .transpose(0, 2, 1)
        .astype(np.float32)
    )
    level = 10 * np.log10(
        sliding_window_view((slices**2).mean(axis=1), wide)[::step].mean(axis=1) + 1e-12
    )
    return WINDOW + HOP * np.arange(len(shown)), shown, level


class TyreNetwork:
    """A `Method`: ``fit`` trains on labelled recordings and returns what predicts
    others."""

    name, identity = "tyre-cnn", "tyre-cnn 1"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        found = [pictures(recording) for recording in recordings]
        floor = float(np.median([np.quantile(level, 0.1) for *_, level in found]))
        kept = [shown[level > floor + CONTACT_DB] for _, shown, level in found]
        surfaces = sorted({recording.surface for recording in recordings})
        sizes, images = [len(each) for each in kept], np.concatenate(kept)
        rough = np.repeat([bool(recording.rough) for recording in recordings], sizes)
        surface = np.repeat(
            [surfaces.index(recording.surface) for recording in recordings], sizes
        )
        centre, scale = images.mean(), images.std()
        torch.manual_seed(0)
        network = nn.Sequential(
            nn.Conv2d(1, 16, 3, padding=1),
            nn.ReLU(),
            nn.MaxPool2d(2),
            nn.Conv2d(16, 32, 3, padding=1),
            nn.ReLU(),
            nn.AdaptiveAvgPool2d(1),
            nn.Flatten(),
            nn.Linear(32, 1),
        )
        optimiser, draw = (
            torch.optim.AdamW(network.parameters(), 2e-3),
            np.random.default_rng(0),
        )
        weights = even_weights(rough, surface)
        for _ in range(400):
            which = draw.choice(len(images), 128, p=weights / weights.sum())
            seen = torch.from_numpy((images[which] - centre) / scale)[:, None]
            wanted = torch.from_numpy(rough[which].astype(np.float32))
            loss = nn.functional.binary_cross_entropy_with_logits(
                network(seen)[:, 0], wanted
            )
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()

        def predict(recording: Recording) -> TakePredictions:
            time, shown, level = pictures(recording)
            with torch.no_grad():
                share = torch.sigmoid(
                    network(torch.from_numpy((shown - centre) / scale)[:, None])[:, 0]
                ).numpy()
            probabilities = np.stack(
                [np.zeros_like(share), 1 - share, share], axis=1
            ).astype(np.float32)
            return TakePredictions(
                recording, time, probabilities, level > floor + CONTACT_DB
            )

        return predict


if __name__ == "__main__":
    folds = split(
        open_dataset(sys.argv[1]),
        sys.argv[2] if len(sys.argv) > 2 else "leave-one-surface-out",
    )
    report = make_report(cross_validate(TyreNetwork(), folds))
    print(report.windows["balanced_accuracy"])
