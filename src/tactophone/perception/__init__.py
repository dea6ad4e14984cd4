"""Sound to belief: resample, window, judge, decide."""

from tactophone.perception.contact import Contact, ContactGate
from tactophone.perception.decision import Decision, DecisionRule, rough_share
from tactophone.perception.detector import WindowDetector
from tactophone.perception.extractors import FORGIVING
from tactophone.perception.guarded import AnyJudge, GuardedJudge, guard
from tactophone.perception.judge import Judge
from tactophone.perception.model import Gate, Model, ModelCard, read_model
from tactophone.perception.shipped import (
    KINDS,
    default_model,
    detector_for,
    model_path,
    open_detector,
    open_judge,
    shipped_models,
)

__all__ = [
    "FORGIVING",
    "KINDS",
    "AnyJudge",
    "Contact",
    "ContactGate",
    "Decision",
    "DecisionRule",
    "Gate",
    "GuardedJudge",
    "Judge",
    "Model",
    "ModelCard",
    "WindowDetector",
    "default_model",
    "detector_for",
    "guard",
    "model_path",
    "open_detector",
    "open_judge",
    "read_model",
    "rough_share",
    "shipped_models",
]
