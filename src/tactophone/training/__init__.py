"""Training of detectors: the registry of recipes, recipes on features, the paper's network, fine-tuning.

A recipe (:mod:`~tactophone.training.recipes`) with its options is a job, which reads recordings as the live system
does (:mod:`~tactophone.training.sound`), trains, and writes a model file
(:mod:`~tactophone.training.model_export`). ``features/`` holds the recipes on features, ``network/`` the paper's
network, the only part that needs torch besides the recipe ``scalogram-cnn``.

Names are imported on first use, as torch alone takes seconds.
"""

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactophone.training.features.baselines import fit_height as fit_height
    from tactophone.training.features.examples import even_weights as even_weights
    from tactophone.training.features.feature_tracks import FEATURE_RATE as FEATURE_RATE
    from tactophone.training.features.feature_tracks import FeatureSpec as FeatureSpec
    from tactophone.training.features.feature_tracks import extract_features as extract_features
    from tactophone.training.features.job import FeatureJob as FeatureJob
    from tactophone.training.features.training_set import TrainingSet as TrainingSet
    from tactophone.training.features.training_set import build_training_set as build_training_set
    from tactophone.training.model_export import add_scores as add_scores
    from tactophone.training.model_export import set_decision as set_decision
    from tactophone.training.network.export import read_weights as read_weights
    from tactophone.training.network.job import NetworkJob as NetworkJob
    from tactophone.training.network.published import import_published as import_published
    from tactophone.training.network.settings import LABEL_LEVEL_DBFS as LABEL_LEVEL_DBFS
    from tactophone.training.network.settings import NETWORK_HOP as NETWORK_HOP
    from tactophone.training.network.settings import NETWORK_RATE as NETWORK_RATE
    from tactophone.training.network.settings import NETWORK_WINDOW_SIZE as NETWORK_WINDOW_SIZE
    from tactophone.training.network.settings import OPEN_GATE as OPEN_GATE
    from tactophone.training.network.settings import PRECISIONS as PRECISIONS
    from tactophone.training.network.settings import REFERENCE_GATE as REFERENCE_GATE
    from tactophone.training.network.settings import VARIANTS as VARIANTS
    from tactophone.training.network.settings import NetworkSettings as NetworkSettings
    from tactophone.training.network.settings import network_settings as network_settings
    from tactophone.training.provenance import tip_of as tip_of
    from tactophone.training.recipes import FEATURE_RECIPES as FEATURE_RECIPES
    from tactophone.training.recipes import RECIPES as RECIPES
    from tactophone.training.recipes import Job as Job
    from tactophone.training.recipes import Recipe as Recipe
    from tactophone.training.recipes import TrainingOptions as TrainingOptions
    from tactophone.training.sound import read_signals as read_signals

_HOMES = {
    "features.baselines": ("fit_height",),
    "features.examples": ("even_weights",),
    "features.feature_tracks": ("FEATURE_RATE", "FeatureSpec", "extract_features"),
    "features.job": ("FeatureJob",),
    "features.training_set": ("TrainingSet", "build_training_set"),
    "model_export": ("add_scores", "set_decision"),
    "network.export": ("read_weights",),
    "network.job": ("NetworkJob",),
    "network.published": ("import_published",),
    "network.settings": (
        "LABEL_LEVEL_DBFS", "NETWORK_HOP", "NETWORK_RATE", "NETWORK_WINDOW_SIZE", "OPEN_GATE", "PRECISIONS",
        "REFERENCE_GATE", "VARIANTS", "NetworkSettings", "network_settings",
    ),
    "provenance": ("tip_of",),
    "recipes": ("FEATURE_RECIPES", "RECIPES", "Job", "Recipe", "TrainingOptions"),
    "sound": ("read_signals",),
}  # fmt: skip
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


# OpenMP threads that spin while they wait slow each other down: a training step took ten times as long beside one busy
# process. OpenMP reads this when torch is first imported, which is after this line.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME_OF[name]}"), name)
