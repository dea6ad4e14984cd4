"""``tactophone set-threshold``: the decision rule of a model, chosen for a rate of
false bumps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import ignore
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.model_file import Model, read_model
from tactophone.signal.perception.models import model_path, shipped_models
from tactophone_lab.app.evaluate import Progress
from tactophone_lab.evaluation import decision_rules as trials
from tactophone_lab.evaluation.bootstrap import Estimate
from tactophone_lab.evaluation.decision_rules import Goal, OperatingPoint
from tactophone_lab.evaluation.predict import (
    TakePredictions,
    by_label,
    model_predictor,
    recording_predictor,
)
from tactophone_lab.evaluation.scores import rendered_scores


@dataclass(frozen=True, slots=True)
class LeftOutScores:
    """Share of smooth that is rendered as rough, on objects that took no part in the
    choice of their rule."""

    before: Estimate
    chosen: Estimate


@dataclass(frozen=True, slots=True)
class ThresholdChoice:
    """The operating point before and the one chosen, and what was written."""

    before: OperatingPoint
    chosen: OperatingPoint
    left_out: LeftOutScores | None
    """``None`` where a class has one object only: nothing can be left out."""
    refused: bool
    """Whether the rule is worse on objects left out, and was not written."""
    files: tuple[Path, ...]
    """What was written: the model, unless refused or not asked for, and the figure."""


def set_threshold(
    name: str,
    dataset: Dataset,
    *,
    goal: Goal,
    limit: float,
    out: Path | None = None,
    figure: Path | None = None,
    dry_run: bool = False,
    anyway: bool = False,
    warn: Callable[[str], None] = ignore,
    report: Progress = ignore,
) -> ThresholdChoice:
    """Choose the decision rule of a model that keeps a rate under a limit, and write it
    into the model file.

    - ``name``: a model file, or the name of a shipped one.
    - ``goal``, ``limit``: the rate to keep under the limit, in a minute or as a share.
    - ``out``: the model file to write; the model itself unless it ships.
    - ``figure``: where the trade-off is drawn; beside the model file unless given.
    - ``dry_run``: choose and draw only.
    - ``anyway``: write the rule even if it is worse on objects left out.
    """
    path = model_path(name)
    if out is None:
        # The package's own files stay as they are: other programs of this installation
        # use them.
        out = Path(path.name) if name in shipped_models() else path
    figure = figure or out.with_suffix(".trade-off.png")
    model = read_model(path)
    if model.card.training.get("sha256") == dataset.fingerprint:
        warn(
            "warning: the model was trained on these recordings, so the rates are too "
            "good"
        )
    rules = trials.candidate_rules(model.card.decision)
    outcomes = trials.try_rules(_predict(model, dataset, report), rules)
    place = trials.choose_rule(outcomes, rules, goal=goal, limit=limit)
    # The first candidate is the model's own rule.
    before = trials.measure_rule(outcomes, 0, rules[0])
    chosen = trials.measure_rule(outcomes, place, rules[place])
    trials.draw_trade_off(
        figure, outcomes, rules, chosen=chosen, before=before, limit=(goal, limit)
    )
    left_out = None
    refused = False
    of_others = trials.choose_left_out(outcomes, rules, goal=goal, limit=limit)
    if of_others:
        unchanged = [rules[0]] * len(of_others)
        left_out = LeftOutScores(
            smooth_as_rough(model, outcomes.recordings, unchanged, report),
            smooth_as_rough(model, outcomes.recordings, of_others, report),
        )
        # A share that was asked for may be more than before.
        asked = goal == "false_positive_rate" and left_out.chosen.value <= limit
        worse = left_out.before.is_exceeded_by(left_out.chosen.value)
        refused = worse and not (anyway or asked)
    if dry_run or refused:
        return ThresholdChoice(before, chosen, left_out, refused, (figure,))
    from tactophone_lab.training.onnx_export import set_decision

    scores = {
        "dataset": dataset.name,
        "sha256": dataset.fingerprint,
        **chosen.as_json(),
    }
    set_decision(path, chosen.rule, scores, out=out)
    return ThresholdChoice(before, chosen, left_out, refused, (out, figure))


def smooth_as_rough(
    model: Model,
    recordings: Sequence[Recording],
    rules: Sequence[DecisionRule],
    report: Progress = ignore,
) -> Estimate:
    """Return the share of smooth that is rendered as rough, with a rule for each
    recording."""
    takes = []
    for recording, rule in zip(recordings, rules, strict=True):
        card = replace(model.card, decision=rule)
        predict = recording_predictor(replace(model, card=card))
        takes.append(predict(recording))
        report("rendering", len(takes), len(recordings), recording.path.name)
    return rendered_scores(takes, rules[0]).smooth_as_rough


def _predict(model: Model, dataset: Dataset, report: Progress) -> list[TakePredictions]:
    """Predict every recording; one with several labels is cut into its segments."""
    predict = model_predictor(model)
    parts: list[TakePredictions] = []
    for count, recording in enumerate(dataset.recordings, start=1):
        parts += by_label(predict(recording))
        report("predicting", count, len(dataset.recordings), recording.path.name)
    return parts
