"""The features of each kind of model."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

from tactophone.perception.features.handcrafted import HandcraftedExtractor
from tactophone.perception.features.log_spectrogram import LogSpectrogramExtractor
from tactophone.perception.features.loudness import LOUDNESS, LoudnessRule
from tactophone.perception.features.spectrum import magnitudes
from tactophone.perception.features.texture import TextureExtractor
from tactophone.perception.model_file import ModelCard
from tactophone.types import CONTACT, FloatArray


class Extractor(Protocol):
    """Turns windows into the features that a model's network takes."""

    def push(self, window: FloatArray, *, contact: bool) -> FloatArray:
        """Return the features, shape ``(features,)``, of the newest window, shape ``(samples, channels)``."""

    def reset(self) -> None:
        """Return to the initial state."""


class MagnitudesExtractor:
    """Returns the paper's features: magnitudes of each channel's spectrum."""

    def __init__(self, card: ModelCard) -> None:
        del card

    def push(self, window: FloatArray, *, contact: bool) -> FloatArray:
        """Return the magnitudes."""
        del contact
        return magnitudes(window)

    def reset(self) -> None:
        """Do nothing: there is no state."""


EXTRACTORS: Mapping[str, Callable[[ModelCard], Extractor]] = MappingProxyType(
    {
        "paper": MagnitudesExtractor,
        "texture": TextureExtractor,
        "cues": HandcraftedExtractor,
        "scalogram": LogSpectrogramExtractor,
    }
)
"""The extractor of each kind of model."""

SUPPORTS_MISSING_CHANNEL = frozenset({"texture", "cues"})
"""Kinds whose features are NaN where a channel is missing, and whose networks can do without it."""


def level_meter(extractor: Extractor, rule: LoudnessRule) -> Callable[[FloatArray], float]:
    """Return the function that measures a window's level in dBFS by a rule.

    It is the extractor's own method where the extractor computes the spectrum that the rule needs.
    """
    if isinstance(extractor, TextureExtractor) and rule == "banded":
        return extractor.level_dbfs
    loudness = LOUDNESS[rule]
    return lambda window: loudness(window[:, CONTACT])
