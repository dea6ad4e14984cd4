"""Training of detectors: recipes, features, the paper's network, fine-tuning, model files.

A recipe with its options (:mod:`~tactophone.training.recipes`) reads recordings as the live system does
(:mod:`~tactophone.training.tracks`), trains, and writes a model file (:mod:`~tactophone.training.export`). Only
:mod:`~tactophone.training.trainer`, the network itself, the import of the authors' models and the recipe
``scalogram-cnn`` need torch.

Names are imported on first use, as torch alone takes seconds.
"""

import importlib
import os
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactophone.training.baselines import fit_height as fit_height
    from tactophone.training.export import add_scores as add_scores
    from tactophone.training.export import read_weights as read_weights
    from tactophone.training.export import set_decision as set_decision
    from tactophone.training.export import tip_of as tip_of
    from tactophone.training.paper_models import import_published as import_published
    from tactophone.training.recipes import FEATURE_RECIPES as FEATURE_RECIPES
    from tactophone.training.recipes import LABEL_LEVEL_DBFS as LABEL_LEVEL_DBFS
    from tactophone.training.recipes import NETWORK_HOP as NETWORK_HOP
    from tactophone.training.recipes import NETWORK_RATE as NETWORK_RATE
    from tactophone.training.recipes import NETWORK_WINDOW_SIZE as NETWORK_WINDOW_SIZE
    from tactophone.training.recipes import OPEN_GATE as OPEN_GATE
    from tactophone.training.recipes import PRECISIONS as PRECISIONS
    from tactophone.training.recipes import RECIPES as RECIPES
    from tactophone.training.recipes import REFERENCE_GATE as REFERENCE_GATE
    from tactophone.training.recipes import VARIANTS as VARIANTS
    from tactophone.training.recipes import ConfiguredRecipe as ConfiguredRecipe
    from tactophone.training.recipes import NetworkSettings as NetworkSettings
    from tactophone.training.recipes import Recipe as Recipe
    from tactophone.training.recipes import RecipeFile as RecipeFile
    from tactophone.training.recipes import TrainingOptions as TrainingOptions
    from tactophone.training.recipes import network_settings as network_settings
    from tactophone.training.sets import FeatureRecipe as FeatureRecipe
    from tactophone.training.sets import TrainingSet as TrainingSet
    from tactophone.training.sets import build_training_set as build_training_set
    from tactophone.training.sets import even_weights as even_weights
    from tactophone.training.tracks import FEATURE_RATE as FEATURE_RATE
    from tactophone.training.tracks import FeatureSpec as FeatureSpec
    from tactophone.training.tracks import extract_features as extract_features
    from tactophone.training.tracks import read_signals as read_signals
    from tactophone.training.trainer import NetworkRecipe as NetworkRecipe

_HOMES = {
    "baselines": ("fit_height",),
    "export": ("add_scores", "read_weights", "set_decision", "tip_of"),
    "paper_models": ("import_published",),
    "recipes": (
        "FEATURE_RECIPES", "LABEL_LEVEL_DBFS", "NETWORK_HOP", "NETWORK_RATE", "NETWORK_WINDOW_SIZE", "OPEN_GATE",
        "PRECISIONS", "RECIPES", "REFERENCE_GATE", "VARIANTS", "ConfiguredRecipe", "NetworkSettings", "Recipe",
        "RecipeFile", "TrainingOptions", "network_settings",
    ),
    "sets": ("FeatureRecipe", "TrainingSet", "build_training_set", "even_weights"),
    "tracks": ("FEATURE_RATE", "FeatureSpec", "extract_features", "read_signals"),
    "trainer": ("NetworkRecipe",),
}  # fmt: skip
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names}


# OpenMP threads that spin while they wait slow each other down: a training step took ten times as long beside one busy
# process. OpenMP reads this when torch is first imported, which is after this line.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")


def __getattr__(name: str) -> Any:
    if name not in _HOME_OF:
        raise AttributeError(f"module {__name__} has no attribute {name}")
    return getattr(importlib.import_module(f"{__name__}.{_HOME_OF[name]}"), name)
