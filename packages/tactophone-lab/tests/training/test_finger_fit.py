from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest

from tactophone.core.errors import ModelError
from tactophone.signal.perception.decision import NEVER_ABSTAIN
from tactophone.signal.perception.model_file import (
    FEATURES,
    LOG_PROBABILITIES,
    read_model,
)
from tactophone.signal.perception.models import model_path
from tactophone.signal.perception.no_touch import NO_TOUCH
from tactophone_lab.training.finger_fit import (
    SHIPPED_BOUNDARY,
    ObjectSound,
    SetUpFit,
    collect,
    corrected,
    fit_boundary,
    fit_set_up,
    impulse_columns,
    proves_wrong,
    write_set_up,
)
from tests.models import classifier
from tests.sounds import noise

COLUMNS = impulse_columns(40, 1)


def object(
    name: str,
    rough: bool,
    *,
    impulses: float,
    logit: float,
    unknown: float = 0.0,
    seed: int = 0,
) -> ObjectSound:
    rng = np.random.default_rng(seed)
    features = rng.normal(0, 0.1, (600, 40)).astype(np.float32)
    features[:, COLUMNS] += impulses
    return ObjectSound(name, rough, features, rng.normal(logit, 0.3, 600), unknown)


def objects(*, shown_by: str) -> list[ObjectSound]:
    """Two smooth and two rough objects that only one of the two scores separates, at an
    odd boundary."""
    return [
        object(
            f"{'rough' if rough else 'smooth'} {number}",
            rough,
            impulses=3 + rough * (shown_by == "impulses"),
            logit=2 + 2 * rough * (shown_by == "model"),
            seed=2 * number + rough,
        )
        for rough in (False, True)
        for number in (1, 2)
    ]


@pytest.mark.parametrize("shown_by", ["impulses", "model"])
def test_the_score_that_is_right_on_things_left_out_is_chosen_and_its_boundary_moved(
    shown_by: str,
) -> None:
    fit = fit_set_up(objects(shown_by=shown_by), channels=1, tip="stylus")
    assert fit.score == shown_by
    assert fit.balanced_accuracy > 0.9
    assert fit.balanced_accuracy_before == pytest.approx(0.5, abs=0.01)


def test_a_boundary_that_no_object_proves_wrong_stays_with_the_whole_graph(
    tmp_path: Path,
) -> None:
    sounds = objects(shown_by="model")
    for sound in sounds:
        sound.logit[:] += (
            -2.7 if not sound.rough else -4.0
        )  # rough: half of the windows are right
    fit = fit_set_up(sounds, channels=1, tip="stylus")
    assert (fit.score, fit.keeps) == (SHIPPED_BOUNDARY, True)
    assert {entry.before == entry.after for entry in fit.left_out} == {True}
    start, path = model_path("stylus"), tmp_path / "own.onnx"
    write_set_up(
        path, start, read_model(start), fit, threshold_dbfs=-55.0, tip="stylus"
    )
    own = onnx.load(str(path)).graph
    shipped = onnx.load(str(start)).graph
    # They differ in the model's name, and in nothing that is computed.
    own.name = shipped.name
    own.doc_string = shipped.doc_string
    assert own == shipped
    # Speech is still no touch, but the user's finger need not sound as simulated.
    card = read_model(path).card
    assert card.settings[NO_TOUCH] == read_model(start).card.settings[NO_TOUCH]
    assert not card.tip_is_simulated


def test_a_boundary_that_is_right_is_called_wrong_as_rarely_as_stated() -> None:
    rng = np.random.default_rng(0)
    pieces = [np.repeat(rng.normal(0, 1, 20), 50) for _ in range(2000)]
    called = [
        proves_wrong(
            ObjectSound("", True, np.empty((1000, 0), np.float32), each), error=0.05
        )
        for each in pieces
    ]
    assert np.mean(called) < 0.05


@pytest.mark.parametrize(("wrong", "proven"), [(28, False), (30, True)])
def test_more_seconds_do_not_prove_a_boundary_that_is_right_for_a_third_of_an_object(
    wrong: int, proven: bool
) -> None:
    logit = np.repeat([1.0] * wrong + [-1.0] * (40 - wrong), 50)
    assert (
        proves_wrong(
            ObjectSound("", False, np.empty((2000, 0), np.float32), logit), error=0.02
        )
        is proven
    )


def test_another_score_that_is_hardly_better_on_things_left_out_is_not_taken() -> None:
    sounds = objects(shown_by="impulses")
    for sound in sounds:
        sound.logit[:] += 4 * sound.rough
        sound.features[::25, COLUMNS] -= (
            1 if sound.rough else -1
        )  # 4 % of the impulses are wrong
    assert fit_set_up(sounds, channels=1, tip="stylus").score == "impulses"
    assert fit_set_up(sounds, channels=1, tip="pad").score == "model"


def test_the_boundary_lies_between_the_tails_that_face_each_other() -> None:
    """Rough sound spreads wide: midway between the middles, much of the rough class
    would be smooth."""
    rng = np.random.default_rng(0)
    sounds = [
        ObjectSound(
            name,
            rough,
            np.zeros((2000, 40), np.float32),
            rng.normal(middle, spread, 2000),
        )
        for name, rough, middle, spread in (
            ("smooth", False, -1.0, 0.1),
            ("rough", True, 2.0, 1.5),
        )
    ]
    correction = fit_boundary(sounds, "model", channels=1)
    wrong = [
        float(np.mean((correction.logit(sound) > 0) != sound.rough)) for sound in sounds
    ]
    assert wrong[0] < 0.01
    assert wrong[1] < 0.06
    longer = replace(
        sounds[0],
        logit=np.tile(sounds[0].logit, 9),
        features=np.zeros((18_000, 40), np.float32),
    )
    assert fit_boundary([longer, sounds[1]], "model", channels=1).bias == pytest.approx(
        correction.bias, abs=0.01
    )


def test_under_a_rubber_tip_impulses_are_not_used() -> None:
    assert (
        fit_set_up(objects(shown_by="impulses"), channels=1, tip="rubber").score
        == "model"
    )


@pytest.mark.parametrize(
    ("tip", "score"),
    [("stylus", "impulses"), ("plastic", "impulses"), ("pad", "model")],
)
def test_one_thing_of_a_kind_has_a_boundary_by_the_tips_own_score_but_no_estimate(
    tip: str, score: str
) -> None:
    first, _, third, _ = objects(shown_by=score)
    fit = fit_set_up([first, third], channels=1, tip=tip)
    assert fit.score == score
    assert np.isnan(fit.balanced_accuracy)
    right = (
        (fit.correction.logit(third) > 0).mean(),
        (fit.correction.logit(first) < 0).mean(),
    )
    assert right == pytest.approx((1.0, 1.0), abs=0.01)


def test_things_of_one_label_are_refused() -> None:
    with pytest.raises(ValueError, match="smooth and a rough"):
        fit_set_up(objects(shown_by="model")[:2], channels=1, tip="pad")


def test_a_graph_with_the_correction_gives_its_logit_also_without_the_air_microphone(
    tmp_path: Path,
) -> None:
    start = model_path("texture")
    model = read_model(start)
    rng = np.random.default_rng(1)
    features = rng.normal(0, 1, (60, 80)).astype(np.float32)
    before = classifier(start).run([LOG_PROBABILITIES], {FEATURES: features})[0]
    sounds = [
        ObjectSound(
            name,
            name == "rough",
            features[part],
            (before[part, 2] - before[part, 1]).astype(np.float64),
            0.5,
        )
        for name, part in (("smooth", slice(0, 30)), ("rough", slice(30, 60)))
    ]
    fit = SetUpFit(fit_boundary(sounds, "model", channels=2), "model", (), unknown=0.5)
    path = tmp_path / "own.onnx"
    write_set_up(path, start, model, fit, threshold_dbfs=-55.0, tip="pad")
    own = read_model(path)
    after = classifier(path).run([LOG_PROBABILITIES], {FEATURES: features})[0]
    wanted = np.concatenate([fit.correction.logit(sound) for sound in sounds])
    assert after[:, 2] - after[:, 1] == pytest.approx(wanted, abs=1e-3)
    features[:, 40:] = np.nan
    assert np.isfinite(
        classifier(path).run([LOG_PROBABILITIES], {FEATURES: features})[0]
    ).all()
    card = own.card
    assert (card.name, card.tip, card.gate.threshold_dbfs) == ("own", "pad", -55.0)
    assert card.decision.abstain_from == NEVER_ABSTAIN
    assert card.training["set_up"]["from"] == "texture"


def test_silence_is_refused_by_the_things_name() -> None:
    model = read_model(model_path("texture"))
    with pytest.raises(ModelError, match="brick: no contact"):
        collect(
            model,
            noise(level_dbfs=-80),
            sample_rate=48_000,
            threshold_dbfs=-40.0,
            name="brick",
            rough=True,
        )


def test_models_without_texture_features_are_refused() -> None:
    with pytest.raises(ModelError, match="kind texture"):
        impulse_columns(514, 2)


def test_the_graph_that_is_corrected_stays_as_it_was() -> None:
    graph = onnx.load(str(model_path("texture")))
    before = graph.SerializeToString()
    sounds = [
        ObjectSound(
            "a", rough, np.zeros((5, 80), np.float32) + rough, np.zeros(5) + rough
        )
        for rough in (False, True)
    ]
    corrected(graph, fit_boundary(sounds, "both", channels=2))
    assert graph.SerializeToString() == before
