"""The windows of several fingers at once: one call for their features, and one of the network.

A detector takes a block of sound as a generator. Where windows fall due it yields them, and it is sent their
predictions; without any it just ends. So whoever has several detectors collects what all of them wait for, and a single
detector is the case of one. What a call computes for a window does not depend on the other windows in it, bit for bit.
"""

from collections.abc import Generator, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tactophone.types import FloatArray, Prediction

if TYPE_CHECKING:
    from tactophone.perception.detector import WindowDetector

PendingWindows: TypeAlias = "tuple[WindowDetector, list[tuple[int, FloatArray]]]"
"""A detector and the windows that it waits for, oldest first: the sample after the last, and the sound."""

Processing: TypeAlias = Generator[PendingWindows, list[Prediction], list[Prediction]]
"""A detector at work on a block: yields windows, is sent their predictions, and returns those of the block."""


def process_together(processings: Sequence[Processing]) -> list[list[Prediction]]:
    """Let several detectors process their blocks; returns the predictions of each."""
    results: list[list[Prediction]] = [[] for _ in processings]
    running = list(enumerate(processings))
    answers: list[list[Prediction] | None] = [None] * len(running)
    while running:
        waiting, pending = [], []
        for (number, processing), answer in zip(running, answers, strict=True):
            try:
                # A generator is started by None.
                pending.append(processing.send(answer))  # type: ignore[arg-type]
                waiting.append((number, processing))
            except StopIteration as end:
                results[number] = end.value
        running, answers = waiting, list(_predict(pending))
    return results


def _predict(pending: Sequence[PendingWindows]) -> list[list[Prediction]]:
    """Return the predictions of each entry."""
    by_network: dict[object, list[int]] = {}
    for number, (detector, _) in enumerate(pending):
        by_network.setdefault(detector.network, []).append(number)
    results: list[list[Prediction]] = [[] for _ in pending]
    for numbers in by_network.values():
        for number, predictions in zip(numbers, _predict_alike([pending[number] for number in numbers]), strict=True):
            results[number] = predictions
    return results


def _predict_alike(pending: Sequence[PendingWindows]) -> list[list[Prediction]]:
    """Do so for detectors of one model."""
    first = pending[0][0]
    entries = [(detector, end, window) for detector, windows in pending for end, window in windows]
    # Channels first and each contiguous: the result of a sum may depend on how its numbers lie in memory.
    sound = np.empty((len(entries), *entries[0][2].shape[::-1]), np.float32)
    for place, (_, _, window) in zip(sound, entries, strict=True):
        place[:] = window.T
    windows = sound.swapaxes(1, 2)
    measured = [
        detector.measure(window, description)
        for (detector, _, _), window, description in zip(entries, windows, first.describe(windows), strict=True)
    ]
    found = first.classify([features for _, _, features in measured])
    predictions = iter(
        detector.decide(end, probabilities, *each)
        for (detector, end, _), each, probabilities in zip(entries, measured, found, strict=True)
    )
    return [[next(predictions) for _ in windows] for _, windows in pending]
