"""``tactophone finetune``: a model adapted to new objects, written only if it does not
call more smooth surfaces rough elsewhere."""

import math
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import FloatArray, ignore
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import read_model
from tactophone_lab.app.evaluate import Progress
from tactophone_lab.datasets.splits import split
from tactophone_lab.evaluation.bootstrap import Change, accuracy_of, compare_models
from tactophone_lab.evaluation.predict import TakePredictions, model_predictor
from tactophone_lab.training import finetuning
from tactophone_lab.training.finetuning import FinetuningData, Strategy
from tactophone_lab.training.trainer import NetworkRecipe

MOST_REPLAYED = 40
"""Recordings of the general set that are trained on again. With takes of 30 s, this
and the next two keep the whole verb under five minutes on two cores."""

MOST_VALIDATED = 12
"""Recordings of the general set by which the mixture is chosen."""

MOST_TESTED = 21
"""Recordings of the general set that are scored before and after."""

MOST_LOST = 0.005
"""Largest loss of balanced accuracy on the few validation surfaces, so that others lose
at most `MOST_LOST_ELSEWHERE`."""

MOST_LOST_ELSEWHERE = 0.02
"""Largest loss of balanced accuracy on the general test set before the new model is
not worth having."""

NEW_OBJECTS = "new objects, held-out takes"
"""The part of the result that shows what was gained."""

GENERAL = "general test set"
"""The part of the result that shows what was lost elsewhere."""


@dataclass(frozen=True, slots=True)
class FinetunedModel:
    """What a fine-tuning changed, and the file, unless it was refused."""

    changes: Mapping[str, Mapping[str, Change]]
    """Changes of scores by their name, for `NEW_OBJECTS` and `GENERAL`."""
    share: float
    """Share of the new parameters in the mixture, 0 to 1."""
    seconds: float
    """How long it took."""
    file: Path | None
    """The model file; ``None`` where smooth is called rough more often elsewhere."""

    @property
    def worthwhile(self) -> bool:
        """Whether the new objects gained, and the others lost little."""
        gained = self.changes[NEW_OBJECTS]["balanced_accuracy"]
        elsewhere = self.changes[GENERAL]["balanced_accuracy"]
        wanted = min(1.0, gained.before.value + 1e-9)
        # A score that is unknown (NaN) speaks for nothing, so neither against it.
        no_better = gained.after.value < wanted
        worse_elsewhere = elsewhere.difference.value < -MOST_LOST_ELSEWHERE
        return not (no_better or worse_elsewhere)


def finetune_model(
    start: Path,
    new: Dataset,
    general: Dataset,
    out: Path,
    *,
    strategy: Strategy = "blend",
    seed: int = 0,
    calibration: Calibration | None = None,
    anyway: bool = False,
    report: Progress = ignore,
) -> FinetunedModel:
    """Adapt a model to new objects, and compare it with the model that it started from.

    ``calibration`` is the contact threshold of the new recordings. ``anyway`` writes
    the file even if smooth is called rough more often on the general data. Raises
    `DatasetError` or `ModelError` as `tactophone_lab.training.finetuning` does.
    """
    began = time.monotonic()
    data = _parts_of(new, general)
    recipe = finetuning.finetuning_recipe(
        start, strategy, seed=seed, calibration=calibration
    )
    trained = finetuning.train_on_both(
        recipe,
        data,
        reading=lambda done, count: report("training", done, count, "reading"),
        report=lambda at: report("training", at.steps, at.total, f"loss {at.loss:.3f}"),
    )
    with tempfile.TemporaryDirectory() as folder:
        # The model is moved to its place only when it is known to be good.
        candidate = Path(folder, out.name)
        share = _choose_mixture(candidate, recipe, trained, data, strategy, report)
        changes = _compare(start, candidate, data, calibration, report)
        rate = changes[GENERAL]["false_positive_rate"]
        good = anyway or not rate.before.is_exceeded_by(rate.after.value)
        if good:
            with atomic_write(out) as unfinished:
                shutil.copyfile(candidate, unfinished)
    seconds = time.monotonic() - began
    return FinetunedModel(changes, share, seconds, out if good else None)


def _parts_of(new: Dataset, general: Dataset) -> FinetuningData:
    """Split both data sets into what is trained on, chosen by and tested with."""
    trained_on, held_out = finetuning.hold_out(new)
    rest, test = _split(general)
    replay, validation = _split(general.where(lambda recording: recording in rest))
    return FinetuningData(
        trained_on,
        held_out,
        finetuning.thinned(replay, MOST_REPLAYED),
        finetuning.thinned(validation, MOST_VALIDATED),
        finetuning.thinned(test, MOST_TESTED),
    )


def _split(dataset: Dataset) -> tuple[Sequence[Recording], Sequence[Recording]]:
    """Split surfaces: as the data set itself says, or three quarters and one
    quarter."""
    try:
        fold = split(dataset, "predefined")[0]
    except DatasetError:
        fold = split(dataset, f"{min(4, len(dataset.surfaces))}-fold")[0]
    return fold.train, fold.test


def _choose_mixture(
    out: Path,
    recipe: NetworkRecipe,
    trained: dict[str, FloatArray],
    data: FinetuningData,
    strategy: Strategy,
    report: Progress,
) -> float:
    """Write the mixture with the largest share of the new parameters that loses little
    on the validation surfaces, else the one that loses least; return the share."""
    start = recipe.start
    if start is None:
        raise ValueError("a fine-tuning starts from a model")
    facts: dict[str, object] = {
        "strategy": strategy,
        "new": sorted({recording.surface for recording in data.new}),
        "takes": len(data.new),
    }
    threshold_dbfs = read_model(start).card.gate.threshold_dbfs
    before = accuracy_of(
        _predict(start, data.validation, "choosing", threshold_dbfs, report)
    )
    least_lost = math.inf
    chosen = 0.0
    for share, weights in finetuning.mixtures(start, trained, strategy):
        tried = out.with_name(f"tried-{out.name}")
        finetuning.write_finetuned(tried, recipe, weights, facts=facts)
        note = f"choosing, {share:.0%} new"
        after = accuracy_of(
            _predict(tried, data.validation, note, threshold_dbfs, report)
        )
        lost = before - after
        if lost < least_lost or lost <= MOST_LOST:
            least_lost = lost
            chosen = share
            finetuning.write_finetuned(
                out, recipe, weights, facts={**facts, "share": share}
            )
        if lost <= MOST_LOST:
            break
    return chosen


def _compare(
    start: Path,
    candidate: Path,
    data: FinetuningData,
    calibration: Calibration | None,
    report: Progress,
) -> dict[str, dict[str, Change]]:
    """Score before and after, each set with the contact threshold of its own set-up."""
    own_dbfs = read_model(start).card.gate.threshold_dbfs
    new_dbfs = calibration.window_dbfs if calibration else own_dbfs
    # The new objects are drawn anew by take, as a few objects leave nothing else to
    # draw: their intervals hold for these objects only.
    parts: dict[str, tuple[Sequence[Recording], Callable[[Recording], str], float]] = {
        NEW_OBJECTS: (data.held_out, lambda take: str(take.path), new_dbfs),
        GENERAL: (data.test, lambda take: take.surface, own_dbfs),
    }
    changes = {}
    for name, (takes, by, threshold_dbfs) in parts.items():
        before = _predict(start, takes, f"{name}, before", threshold_dbfs, report)
        after = _predict(candidate, takes, f"{name}, after", threshold_dbfs, report)
        changes[name] = compare_models(before, after, by=by)
    return changes


def _predict(
    path: Path,
    recordings: Sequence[Recording],
    note: str,
    threshold_dbfs: float,
    report: Progress,
) -> list[TakePredictions]:
    """Predict recordings by a model whose contact gate has another threshold."""
    model = read_model(path)
    gate = replace(model.card.gate, threshold_dbfs=threshold_dbfs)
    predict = model_predictor(replace(model, card=replace(model.card, gate=gate)))
    predicted = []
    for recording in recordings:
        predicted.append(predict(recording))
        report(note, len(predicted), len(recordings), recording.path.name)
    return predicted
