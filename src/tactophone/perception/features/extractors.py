"""What the network of each kind of model is shown of a window."""

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
    """Window to features, as a model's network wants them."""

    def push(self, window: FloatArray, *, contact: bool) -> FloatArray:
        """Give the features, shape ``(features,)``, of the newest window, shape ``(samples, channels)``."""
        ...

    def reset(self) -> None:
        """Become as new."""
        ...


class MagnitudesExtractor:
    """Gives the paper's features: magnitudes of each channel's spectrum."""

    def __init__(self, card: ModelCard) -> None:
        del card

    def push(self, window: FloatArray, *, contact: bool) -> FloatArray:
        """Give the magnitudes."""
        del contact
        return magnitudes(window)

    def reset(self) -> None:
        """Do nothing: each window speaks for itself."""


EXTRACTORS: Mapping[str, Callable[[ModelCard], Extractor]] = MappingProxyType(
    {
        "paper": MagnitudesExtractor,
        "texture": TextureExtractor,
        "cues": HandcraftedExtractor,
        "scalogram": LogSpectrogramExtractor,
    }
)
"""The extractor of each kind of model."""


def level_of(extractor: Extractor, rule: LoudnessRule) -> Callable[[FloatArray], float]:
    """Give what tells a window's level by a rule: the extractor itself, where it takes the spectrum that it needs."""
    if isinstance(extractor, TextureExtractor) and rule == "banded":
        return extractor.level_dbfs
    loudness = LOUDNESS[rule]
    return lambda window: loudness(window[:, CONTACT])


SUPPORTS_MISSING_CHANNEL = frozenset({"texture", "cues"})
"""Kinds whose features are NaN where a channel is missing, and whose networks can do without it."""
