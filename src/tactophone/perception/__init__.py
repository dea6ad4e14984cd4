"""Sound to belief: resample, window, judge, decide."""

from tactophone.perception.contact import Contact, ContactGate
from tactophone.perception.decision import Decision, DecisionRule, rough_share
from tactophone.perception.detector import WindowDetector
from tactophone.perception.features.extractors import SUPPORTS_MISSING_CHANNEL
from tactophone.perception.model_file import Gate, Model, ModelCard, read_model
from tactophone.perception.model_registry import (
    KINDS,
    default_model,
    detector_for,
    model_path,
    open_detector,
    open_window_detector,
    shipped_models,
)
from tactophone.perception.sensor_health.fallback import AnyTouchDetector, FallbackDetector, guard
from tactophone.perception.touch_detector import TouchDetector

__all__ = [
    "KINDS",
    "SUPPORTS_MISSING_CHANNEL",
    "AnyTouchDetector",
    "Contact",
    "ContactGate",
    "Decision",
    "DecisionRule",
    "FallbackDetector",
    "Gate",
    "Model",
    "ModelCard",
    "TouchDetector",
    "WindowDetector",
    "default_model",
    "detector_for",
    "guard",
    "model_path",
    "open_detector",
    "open_window_detector",
    "read_model",
    "rough_share",
    "shipped_models",
]
