"""The classical ways: rules that people made by hand, and standard learners on the features of our own detector."""

from collections.abc import Sequence

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import NodeProto, helper

from tactophone.perception.features.bands import CREST, VALUES
from tactophone.perception.features.handcrafted import CUES
from tactophone.perception.model_file import FEATURES
from tactophone.training.features.linear_classifier import Examples, even_weights
from tactophone.training.features.onnx_graph import answer_nodes, build
from tactophone.training.features.training_set import TrainingSet

Floats = NDArray[np.float64]

RULES = ("level_db", "crest_db", "transients_db", "centroid_octaves", "air_to_contact_db")
"""Cues that vote; the median frequency is a method of its own."""

VOTE_STEEPNESS = 8.0
"""A cue's vote is a step, softened over an eighth of the distance between its class medians."""

KNOWN = -20.0
"""Logit of *unknown* for ways that never abstain."""


def build_level(lesson: TrainingSet) -> onnx.ModelProto:
    """Find the level that parts rough from smooth."""
    return _linear_cue(lesson, "level_db")


def build_median_frequency(lesson: TrainingSet) -> onnx.ModelProto:
    """Find the median frequency that parts rough from smooth (Svensson et al. 2021 let it drive the stimulus)."""
    return _linear_cue(lesson, "median_octaves")


def build_rules(lesson: TrainingSet) -> onnx.ModelProto:
    """Let each cue vote whether it is nearer to what is common on rough or on smooth surfaces; the majority wins."""
    examples = lesson.examples
    columns = [CUES.index(name) for name in RULES if np.isfinite(examples.features[:, CUES.index(name)]).all()]
    smooth, rough = (np.median(examples.features[examples.rough == called], axis=0) for called in (False, True))
    gap = np.where(np.abs(rough - smooth) < 1e-3, 1e-3, rough - smooth)
    slopes, middle = np.zeros(len(CUES)), (rough + smooth) / 2
    slopes[columns] = VOTE_STEEPNESS / gap[columns]
    nodes = [
        *_filled("middle"),
        helper.make_node("Sub", ["whole", "middle"], ["off"]),
        helper.make_node("Mul", ["off", "slopes"], ["steep"]),
        helper.make_node("Tanh", ["steep"], ["votes"]),
        helper.make_node("ReduceSum", ["votes", "one"], ["logit"], keepdims=1),
        *_never_unknown(),
    ]
    tensors = {"middle": np.nan_to_num(middle), "slopes": slopes}
    return _model(nodes, tensors, features=len(CUES))


def build_logistic(lesson: TrainingSet) -> onnx.ModelProto:
    """Fit scikit-learn's logistic regression as it comes, both classes weighing the same."""
    from sklearn.linear_model import LogisticRegression

    examples = lesson.examples.thinned()
    centre, scale = _moments(examples)
    model = LogisticRegression(class_weight="balanced", solver="newton-cholesky", max_iter=50)
    model.fit(_standard(examples, centre, scale), examples.rough)
    return _linear(centre, model.coef_[0] / scale, float(model.intercept_[0]))


def build_surface(lesson: TrainingSet) -> onnx.ModelProto:
    """Regress log Ra on the features, and call rough what lies over the middle between smooth and rough surfaces."""
    weights, centre, bias, spread = fit_height(lesson)
    heights = [
        np.nanmean(lesson.height[lesson.examples.rough == called & np.isfinite(lesson.height)])
        for called in (False, True)
    ]
    boundary = float(np.mean(heights))
    # A normal error of this spread, read as a logistic one (logistic scale = spread * sqrt(3) / pi).
    slope = np.pi / np.sqrt(3) / spread
    return _linear(centre, slope * weights, float(slope * (bias - boundary)))


def fit_height(lesson: TrainingSet) -> tuple[Floats, Floats, float, float]:
    """Fit log10 Ra (Ra in micrometres) to features by ridge regression, every surface weighing the same.

    Returns
    -------
    weights, centre, bias, spread
        ``bias + (features - centre) @ weights`` is the estimate; ``spread`` is its root mean square error in training.

    Raises
    ------
    ValueError
        If no recording tells its ``ra_um``.
    """
    from sklearn.linear_model import Ridge

    known = np.isfinite(lesson.height)
    if not known.any():
        raise ValueError("no recording tells its surface's Ra (property ra_um)")
    examples = lesson.examples.where(known)
    centre, scale = _moments(examples)
    standard, weigh = _standard(examples, centre, scale), even_weights(examples.rough, examples.surface)
    model = Ridge(alpha=0.01 * len(standard)).fit(standard, lesson.height[known], sample_weight=weigh)
    errors = model.predict(standard) - lesson.height[known]
    spread = float(np.sqrt(np.average(np.square(errors), weights=weigh)))
    return model.coef_ / scale, centre, float(model.intercept_), spread


def build_impulses(lesson: TrainingSet) -> onnx.ModelProto:
    """Let the crest of the sound and how it changes say together how rough: both up, and by as much.

    What spectra and levels say of roughness in simulated sound, real sound of another finger and microphone
    contradicts. That rough is more transient holds in both (and in the paper, section III-C); so nothing is learnt here
    but the boundary and how sure to be around it (docs/detector.md). Two cues of equal weight are hard to improve on
    where samples differ from practice (Dawes, "The robust beauty of improper linear models", 1979).
    """
    from sklearn.linear_model import LogisticRegression

    examples = lesson.examples.thinned()
    centre, scale = _moments(examples)
    direction = np.zeros(len(centre))
    direction[[CREST, VALUES + CREST]] = 0.5
    direction /= scale
    peaking = (examples.features - centre) @ direction
    weigh = even_weights(examples.rough, examples.surface)
    model = LogisticRegression().fit(peaking[:, None], examples.rough, sample_weight=weigh)
    return _linear(centre, model.coef_[0, 0] * direction, float(model.intercept_[0]))


def build_boosting(lesson: TrainingSet) -> onnx.ModelProto:
    """Fit scikit-learn's histogram gradient boosting with mild settings, and write its trees out."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    examples = lesson.examples.thinned()
    centre, _ = _moments(examples)
    features = np.where(np.isnan(examples.features), centre, examples.features)
    model = HistGradientBoostingClassifier(
        max_iter=150, max_leaf_nodes=15, learning_rate=0.05, min_samples_leaf=100, l2_regularization=5.0,
        max_features=0.3, class_weight="balanced", early_stopping=False, random_state=0,
    )  # fmt: skip
    model.fit(features, examples.rough)
    trees = [stage[0].nodes for stage in model._predictors]
    nodes = [
        *_filled("middle"),
        _trees_node(trees, base=float(model._baseline_prediction[0, 0])),
        *_never_unknown(),
    ]
    return _model(nodes, {"middle": centre}, features=features.shape[1])


def _trees_node(trees: Sequence[NDArray[np.void]], *, base: float) -> NodeProto:
    """Write trees as ONNX has them: node by node, children by number, a value at each leaf."""
    every = np.concatenate(trees)
    number = np.concatenate([np.arange(len(tree)) for tree in trees])
    tree = np.repeat(np.arange(len(trees)), [len(one) for one in trees])
    leaf = every["is_leaf"].astype(bool)
    return helper.make_node(
        "TreeEnsembleRegressor", ["whole"], ["logit"], domain="ai.onnx.ml", n_targets=1, base_values=[base],
        nodes_treeids=tree.tolist(), nodes_nodeids=number.tolist(),
        nodes_modes=np.where(leaf, "LEAF", "BRANCH_LEQ").tolist(),
        nodes_featureids=np.where(leaf, 0, every["feature_idx"]).tolist(),
        nodes_values=_not_above(every["num_threshold"]).tolist(),
        nodes_truenodeids=np.where(leaf, 0, every["left"]).tolist(),
        nodes_falsenodeids=np.where(leaf, 0, every["right"]).tolist(),
        target_treeids=tree[leaf].tolist(), target_nodeids=number[leaf].tolist(),
        target_ids=[0] * int(leaf.sum()), target_weights=every["value"][leaf].tolist(),
    )  # fmt: skip


def _not_above(thresholds: Floats) -> NDArray[np.float32]:
    """Round thresholds to float32 downwards: features are float32, and what was over must stay over."""
    near = thresholds.astype(np.float32)
    return np.where(near > thresholds, np.nextafter(near, np.float32(-np.inf)), near)


def _linear_cue(lesson: TrainingSet, cue: str) -> onnx.ModelProto:
    from sklearn.linear_model import LogisticRegression

    column, examples = CUES.index(cue), lesson.examples.thinned()
    weigh = even_weights(examples.rough, examples.surface)
    values = examples.features[:, [column]]
    model = LogisticRegression().fit(values, examples.rough, sample_weight=weigh)
    weights = np.zeros(len(CUES))
    weights[column] = model.coef_[0, 0]
    return _linear(np.zeros(len(CUES)), weights, float(model.intercept_[0]))


def _linear(centre: Floats, weights: Floats, bias: float) -> onnx.ModelProto:
    nodes = [
        *_filled("middle"),
        helper.make_node("Sub", ["whole", "middle"], ["off"]),
        helper.make_node("MatMul", ["off", "weights"], ["weighed"]),
        helper.make_node("Add", ["weighed", "bias"], ["logit"]),
        *_never_unknown(),
    ]
    return _model(nodes, {"middle": centre, "weights": weights[:, None], "bias": np.array([bias])}, len(centre))


def _filled(middle: str) -> list[NodeProto]:
    """Put the average where a feature is missing."""
    return [
        helper.make_node("IsNaN", [FEATURES], ["missing"]),
        helper.make_node("Where", ["missing", middle, FEATURES], ["whole"]),
    ]


def _never_unknown() -> list[NodeProto]:
    return [
        helper.make_node("Mul", ["logit", "zero"], ["nothing"]),
        helper.make_node("Add", ["nothing", "known"], ["unknown"]),
        *answer_nodes(logit="logit", unknown="unknown"),
    ]


def _model(nodes: Sequence[NodeProto], tensors: dict[str, Floats], features: int) -> onnx.ModelProto:
    constants = {"zero": np.zeros(1), "known": np.array([KNOWN]), "one": np.array([1])}
    return build(list(nodes), {**constants, **tensors}, features=features)


def _moments(examples: Examples) -> tuple[Floats, Floats]:
    wide = examples.features.astype(np.float64)
    return np.nanmean(wide, axis=0), np.maximum(np.nanstd(wide, axis=0), 1e-6)


def _standard(examples: Examples, centre: Floats, scale: Floats) -> Floats:
    return np.asarray(np.nan_to_num((examples.features - centre) / scale))
