import numpy as np
import onnxruntime
import pytest

from tactophone.signal.perception.model_file import (
    CONTACT_INPUT,
    FEATURES,
    SOUND,
    STATE,
    STATE_OUT,
)
from tactophone_lab.training.features import (
    BEFORE,
    FORGET_AFTER,
    PRIOR_WINDOWS,
    STATISTICS_SETTLED,
    front,
    parts,
    run_statistics,
)
from tactophone_lab.training.recipe_options import BAND_VALUES, FeatureSpec

NEVER = np.zeros((1, BAND_VALUES, BAND_VALUES))
FIRST = np.zeros_like(NEVER)
FIRST[0, 0, 0] = 0.5  # a movement of 2 of the first value is the limit
States = dict[str, np.ndarray]


def fed(
    values: list[float],
    *,
    contact: list[bool] | None = None,
    metric: np.ndarray = NEVER,
) -> States:
    """Return the states after windows whose every value is the one given."""
    descriptions = np.repeat(np.float32(values), BAND_VALUES).reshape(
        -1, 1, BAND_VALUES
    )
    (states,) = run_statistics(
        [descriptions], [np.array(contact or [True] * len(values))], metric, fading=10.0
    )
    return states


def mean(states: States) -> np.ndarray:
    return states["running"][:, 0] / states["evidence"][:, 0]


def test_a_touch_begins_with_the_prior_and_moves_at_once() -> None:
    states = fed([1.0])
    assert states["running"] == pytest.approx(
        np.full((1, 2 * BAND_VALUES), 1 / (1 + PRIOR_WINDOWS))
    )
    assert 1 - states["evidence"] == pytest.approx(PRIOR_WINDOWS / (1 + PRIOR_WINDOWS))


def test_the_weight_of_the_prior_makes_all_weights_sum_to_one() -> None:
    states = fed([7.0] * 30, contact=[number % 7 != 0 for number in range(30)])
    assert states["running"][:, 0] + (
        1 - states["evidence"][:, 0]
    ) * 7.0 == pytest.approx(np.full(30, 7.0))


def test_a_stroke_that_turns_is_the_same_touch_and_one_that_ends_is_not() -> None:
    states = fed([1.0] + [9.0] * FORGET_AFTER, contact=[True] + [False] * FORGET_AFTER)
    assert states["evidence"][-2] > 0
    assert not any(each[-1].any() for each in states.values())


def test_an_edge_restarts_the_statistics_and_drift_does_not() -> None:
    jumped, faded = (
        fed([1.0] * 30 + [9.0] * 3, metric=metric) for metric in (FIRST, NEVER)
    )
    assert mean(jumped)[-1] > 5 > mean(faded)[-1]
    assert jumped["evidence"][-1] < 0.8
    drifted = fed([1.0 + 0.05 * step for step in range(60)], metric=FIRST)
    assert drifted["evidence"][-1] > 0.99


def test_no_change_is_detected_before_the_statistics_have_settled() -> None:
    states = fed(
        [1.0] * (BEFORE + STATISTICS_SETTLED - 2) + [9.0, 9.0], metric=2 * FIRST
    )
    assert states["count"][:, 0].tolist()[-2:] == [BEFORE + STATISTICS_SETTLED - 1, 3]


def test_recordings_of_several_lengths_together_are_what_each_is_alone() -> None:
    random = np.random.default_rng(0)
    descriptions = [
        random.standard_normal((size, 1, BAND_VALUES)).astype(np.float32)
        for size in (3, 50, 20)
    ]
    contact = [random.random(len(each)) < 0.8 for each in descriptions]
    together = run_statistics(descriptions, contact, FIRST, fading=25.0)
    for states, each, loud in zip(together, descriptions, contact, strict=True):
        (alone,) = run_statistics([each], [loud], FIRST, fading=25.0)
        for name, values in states.items():
            assert values == pytest.approx(alone[name], abs=1e-9), name


def features_of(sound: np.ndarray, *, unevenness: bool = False) -> np.ndarray:
    """Return the features of a first window, ``(channels, 2, values)``, of a whole
    graph with a prior of noughts."""
    values = BAND_VALUES + unevenness
    prior = np.stack((np.zeros((2, values)), np.ones((2, values))))
    constants = {
        "prior": prior,
        "change_metric": np.zeros((2, values, values)),
        "fading": np.array(10.0),
    }
    graph = front(FeatureSpec(unevenness=unevenness), constants)
    session = onnxruntime.InferenceSession(graph.SerializeToString())
    size = next(each.shape[1] for each in session.get_inputs() if each.name == STATE)
    inputs = {
        SOUND: sound[None],
        CONTACT_INPUT: np.ones(1, np.float32),
        STATE: np.zeros((1, size)),
    }
    features, state = session.run([FEATURES, STATE_OUT], inputs)
    assert parts(state, 2, values)["count"].tolist() == [[1.0]]
    return np.asarray(features.reshape(2, 2, values))


def window() -> np.ndarray:
    return 0.1 * np.random.default_rng(0).standard_normal((2, 512)).astype(np.float32)


def test_a_dead_channel_is_distinguished_from_a_quiet_one() -> None:
    quiet = window()
    quiet[1] *= 1e-4
    assert np.isfinite(features_of(quiet)).all()
    quiet[1] = 0
    features = features_of(quiet)
    assert np.isfinite(features[0]).all()
    assert np.isnan(features[1]).all()


def test_the_unevenness_of_the_treble_is_one_value_more() -> None:
    plain, more = (
        features_of(window(), unevenness=unevenness) for unevenness in (False, True)
    )
    assert more[..., :-1] == pytest.approx(plain, abs=1e-6)
    assert (more[:, 0, -1] < -0.1).all()
