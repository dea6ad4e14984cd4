"""The features of each kind of model."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np

from tactophone.perception.features.handcrafted import cues
from tactophone.perception.features.log_spectrogram import LogSpectrogram
from tactophone.perception.features.loudness import LOUDNESS, LoudnessRule
from tactophone.perception.features.spectrum import magnitudes
from tactophone.perception.features.texture import TextureExtractor
from tactophone.perception.model_file import ModelCard
from tactophone.types import CONTACT, FloatArray


class Extractor(Protocol):
    """Turns windows into the features that a model's network takes: first what each holds, then its place in a touch.

    Several fingers with the same model are described together, and then each pushed to its own extractor.
    """

    def describe(self, windows: FloatArray) -> Sequence[Any]:
        """Return a description of each window; shape ``(windows, samples, channels)``. It depends on that one alone."""

    def push(self, description: Any, *, contact: bool) -> FloatArray:
        """Return the features, shape ``(features,)``, of the newest window by its description."""

    def reset(self) -> None:
        """Return to the initial state."""


class MemorylessExtractor:
    """Returns what a function computes from each window alone."""

    def __init__(self, features_of: Callable[[FloatArray], FloatArray]) -> None:
        self._features_of = features_of

    def describe(self, windows: FloatArray) -> list[FloatArray]:
        """Return the features of each window."""
        return [self._features_of(window) for window in windows]

    def push(self, description: FloatArray, *, contact: bool) -> FloatArray:
        """Return the description: it is the features."""
        del contact
        return description

    def reset(self) -> None:
        """Do nothing: there is no state."""


EXTRACTORS: Mapping[str, Callable[[ModelCard], Extractor]] = MappingProxyType(
    {
        "paper": lambda card: MemorylessExtractor(magnitudes),
        "texture": TextureExtractor,
        "cues": lambda card: MemorylessExtractor(lambda window: cues(window, card.sample_rate).astype(np.float32)),
        "scalogram": lambda card: MemorylessExtractor(LogSpectrogram(card.sample_rate).of),
    }
)
"""The extractor of each kind of model."""

SUPPORTS_MISSING_CHANNEL = frozenset({"texture", "cues"})
"""Kinds whose features are NaN where a channel is missing, and whose networks can do without it."""


def level_meter(extractor: Extractor, rule: LoudnessRule) -> Callable[[FloatArray, Any], float]:
    """Return the function that measures a window's level in dBFS by a rule, from the window and its description.

    It is the extractor's own method where the extractor computes the spectrum that the rule needs.
    """
    if isinstance(extractor, TextureExtractor) and rule == "banded":
        return extractor.level_dbfs
    loudness = LOUDNESS[rule]
    return lambda window, description: loudness(window[:, CONTACT])
