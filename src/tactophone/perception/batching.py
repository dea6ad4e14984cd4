"""The windows of several fingers at once: one call for their features, and one of the network for every three.

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
    results: list[list[Prediction]] = []
    waiting: dict[int, PendingWindows] = {}
    for number, processing in enumerate(processings):
        try:
            waiting[number] = next(processing)
            results.append([])
        except StopIteration as end:
            results.append(end.value)
    while waiting:
        answers, pending = _predict(list(waiting.values())), waiting
        waiting = {}
        for number, answer in zip(pending, answers, strict=True):
            try:
                waiting[number] = processings[number].send(answer)
            except StopIteration as end:
                results[number] = end.value
    return results


def _predict(pending: Sequence[PendingWindows]) -> list[list[Prediction]]:
    """Return the predictions of each entry."""
    results: list[list[Prediction]] = [[] for _ in pending]
    by_network: dict[object, list[tuple[int, WindowDetector, int, FloatArray]]] = {}
    for number, (detector, windows) in enumerate(pending):
        entries = by_network.setdefault(detector.network, [])
        for end, window in windows:
            entries.append((number, detector, end, window))
    for entries in by_network.values():
        _, alike, _, window = entries[0]
        # Channels first and each contiguous: the result of a sum may depend on how its numbers lie in memory.
        sound = np.empty((len(entries), *window.shape[::-1]), np.float32)
        for place, (_, _, _, window) in zip(sound, entries, strict=True):
            place[:] = window.T
        described = zip(entries, sound, alike.describe(sound.swapaxes(1, 2)), strict=True)
        measured = [detector.measure(place.T, description) for (_, detector, _, _), place, description in described]
        found = alike.classify([features for _, _, features in measured])
        for (number, detector, end, _), each, probabilities in zip(entries, measured, found, strict=True):
            results[number].append(detector.decide(end, probabilities, *each))
    return results
