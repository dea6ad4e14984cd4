"""The classifiers of the recipes on features by name, and the baselines: hand-made rules and standard classifiers.

The only place where level and median frequency are turned into detectors; their values come from
:mod:`tactophone.lab.training.features`.
"""

from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

import numpy as np
import onnx
from onnx import helper

from tactophone.core.errors import DatasetError
from tactophone.lab.training.export import Floats, build_known, build_linear, fill_missing
from tactophone.lab.training.linear import build_texture
from tactophone.lab.training.recipes import CUES
from tactophone.lab.training.sets import TrainingSet

RULE_FEATURES = ("level_db", "crest_db", "transients_db", "centroid_octaves", "air_to_contact_db")
"""Cues that vote; the median frequency is a recipe of its own."""

VOTE_STEEPNESS = 8.0
"""A cue's vote is a step, softened over an eighth of the distance between its class medians."""


def build_rules(training_set: TrainingSet) -> onnx.ModelProto:
    """Let each cue vote for the class whose median is nearer; the majority wins."""
    examples = training_set.examples
    columns = [CUES.index(name) for name in RULE_FEATURES if np.isfinite(examples.features[:, CUES.index(name)]).all()]
    smooth, rough = (np.median(examples.features[examples.rough == label], axis=0) for label in (False, True))
    gap = np.where(np.abs(rough - smooth) < 1e-3, 1e-3, rough - smooth)
    slopes = np.zeros(len(CUES))
    slopes[columns] = VOTE_STEEPNESS / gap[columns]
    nodes = [
        *fill_missing("centre"),
        helper.make_node("Sub", ["whole", "centre"], ["off"]),
        helper.make_node("Mul", ["off", "slopes"], ["steep"]),
        helper.make_node("Tanh", ["steep"], ["votes"]),
        helper.make_node("ReduceSum", ["votes", "one"], ["logit"], keepdims=1),
    ]
    tensors = {"centre": np.nan_to_num((rough + smooth) / 2), "slopes": slopes}
    return build_known(nodes, tensors, features=len(CUES))


def build_logistic(training_set: TrainingSet) -> onnx.ModelProto:
    """Fit scikit-learn's logistic regression with its defaults, both classes weighted the same."""
    from sklearn.linear_model import LogisticRegression

    examples = training_set.examples.thinned()
    centre, scale = examples.moments()
    model = LogisticRegression(class_weight="balanced", solver="newton-cholesky", max_iter=50)
    model.fit(examples.standardised(centre, scale), examples.rough)
    return build_linear(centre, model.coef_[0] / scale, float(model.intercept_[0]))


def build_surface(training_set: TrainingSet) -> onnx.ModelProto:
    """Regress log Ra on the features; rough is what exceeds the middle between smooth and rough surfaces."""
    weights, centre, bias, spread = fit_height(training_set)
    rough, height = training_set.examples.rough, training_set.height
    boundary = float(np.mean([np.nanmean(height[rough == label & np.isfinite(height)]) for label in (False, True)]))
    # A normal error of this spread, taken as a logistic one (logistic scale = spread * sqrt(3) / pi).
    slope = np.pi / np.sqrt(3) / spread
    return build_linear(centre, slope * weights, float(slope * (bias - boundary)))


def fit_height(training_set: TrainingSet) -> tuple[Floats, Floats, float, float]:
    """Fit log10 Ra (Ra in micrometres) to features by ridge regression, every surface weighted the same.

    Returns weights, centre, bias and spread: ``bias + (features - centre) @ weights`` is the estimate, and the spread
    its root mean square error in training. Raises `DatasetError` if no recording has the property ``ra_um``.
    """
    from sklearn.linear_model import Ridge

    known = np.isfinite(training_set.height)
    if not known.any():
        raise DatasetError(
            "no recording states its surface's Ra, which this recipe learns: add the column ra_um to the manifest, by "
            "hand or by `tactophone roughness --write-metadata`"
        )
    examples, height = training_set.examples.where(known), training_set.height[known]
    centre, scale = examples.moments()
    standard, weights = examples.standardised(centre, scale), examples.weights()
    model = Ridge(alpha=0.01 * len(standard)).fit(standard, height, sample_weight=weights)
    errors = model.predict(standard) - height
    spread = float(np.sqrt(np.average(np.square(errors), weights=weights)))
    return model.coef_ / scale, centre, float(model.intercept_), spread


def _single_cue(training_set: TrainingSet, *, cue: str) -> onnx.ModelProto:
    """Fit a threshold of one cue between smooth and rough."""
    from sklearn.linear_model import LogisticRegression

    column, examples = CUES.index(cue), training_set.examples.thinned()
    model = LogisticRegression().fit(examples.features[:, [column]], examples.rough, sample_weight=examples.weights())
    weights = np.zeros(len(CUES))
    weights[column] = model.coef_[0, 0]
    return build_linear(np.zeros(len(CUES)), weights, float(model.intercept_[0]))


BUILDERS: Mapping[str, Callable[[TrainingSet], onnx.ModelProto]] = MappingProxyType(
    {
        "texture": build_texture,
        "level": partial(_single_cue, cue="level_db"),
        "rules": build_rules,
        # It drives the stimulus in Svensson et al. 2021.
        "median-frequency": partial(_single_cue, cue="median_octaves"),
        "surface": build_surface,
        "logistic": build_logistic,
    }
)
"""What fits the classifier of each recipe on features and returns the graph of a model file, by the recipe's name."""
