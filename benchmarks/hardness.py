"""Is a simulated data set as hard as the paper's recordings? Prints the first tables of the simulator's realism page.

    python benchmarks/hardness.py DIR [--split leave-one-pressure-out]

DIR is what `tactophone simulate dataset DIR --objects all --seconds 5` renders. The rules that the paper's authors
tried first must fail on it, their network must do better, and the air microphone must lower the false positives. All
methods are scored on the same windows: those over the level's gate *and* in true contact from end to end.
"""

import argparse
import functools
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.benchmark import Cache, Method, cross_validate, default_cache, method_of
from tactophone.dataset import Dataset, Recording, open_dataset, split
from tactophone.evaluation import (
    Estimate,
    Predictor,
    Scores,
    TakePredictions,
    false_positives_at_recall,
    interval,
    measure,
    scores_of,
)
from tactophone.evaluation.bootstrap import DRAWS
from tactophone.perception import CUES, cues
from tactophone.training import (
    LABEL_LEVEL_DBFS,
    NETWORK_HOP,
    NETWORK_RATE,
    NETWORK_WINDOW_SIZE,
    RECIPES,
    TrainingOptions,
    read_signals,
)
from tactophone.types import CONTACT, FloatArray, Touch

SHORT_TRAINING = {"hop": 64, "batch_size": 500, "least_steps": 0, "learning_rate": 5e-4}
"""A short training of the paper's network, about 10 s a fold: its score is flat from there on."""

RULES: Mapping[str, tuple[str, ...]] = {
    "loudness": ("level_db",),
    "median frequency": ("median_octaves",),
    "loud and transient": ("level_db", "crest_db", "transients_db"),
    "air to contact": ("air_to_contact_db",),
}
"""The cues of each rule. *Rough is louder and more transient* was the authors' first classifier."""

RECALL = 0.8
"""Share of rough windows that must be found when false positives are compared: an operator notices most bumps."""

VERSION = 2
"""Of the rules: raise it when a rule changes, so that cached results are computed anew."""


@dataclass(frozen=True, slots=True)
class RuleMethod:
    """A hand-made rule: a logistic regression on its cues, which stands for their best thresholds."""

    name: str

    @property
    def identity(self) -> str:
        return f"rule {VERSION} {self.name}"

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        columns = [CUES.index(name) for name in RULES[self.name]]
        rows = [loud_cues(recording)[1][:, columns] for recording in recordings]
        rough = np.repeat([recording.label is Touch.ROUGH for recording in recordings], [len(row) for row in rows])
        model = make_pipeline(StandardScaler(), LogisticRegression(class_weight="balanced"))
        model.fit(np.concatenate(rows), rough)

        def predict(recording: Recording) -> TakePredictions:
            time, values = loud_cues(recording)
            share = model.predict_proba(values[:, columns])[:, 1] if len(time) else np.zeros(0)
            probabilities = np.stack([np.zeros_like(share), 1 - share, share], axis=1).astype(np.float32)
            return TakePredictions(recording, time, probabilities, np.ones(len(time), bool))

        return predict


@dataclass(frozen=True, slots=True)
class Row:
    """A method's balanced accuracy, AUC, and false positives where ``RECALL`` of the rough is found."""

    name: str
    balanced_accuracy: Estimate
    auc: Estimate
    false_positives: Estimate


@dataclass(frozen=True, slots=True)
class Hardness:
    """How hard a data set is.

    Parameters
    ----------
    rows
        Of each method.
    difference
        False positives of the first method less the second's, in pairs: two channels less one.
    air_over_contact_db
        Level in air over that in contact, mean over windows, by label.
    """

    rows: tuple[Row, ...]
    difference: Estimate
    air_over_contact_db: dict[str, Estimate]


def measure_hardness(
    dataset: Dataset,
    methods: Sequence[Method],
    *,
    by: str = "5-fold",
    cache: Cache | None = None,
    report: Callable[[str], None] = lambda name: None,
) -> Hardness:
    """Cross-validate trained methods (two channels first, then one) and rules on a two-channel set with segments."""
    scores: dict[str, Scores] = {}
    for method in (*methods, *map(RuleMethod, RULES)):
        report(method.name)
        takes = cross_validate(method, split(dataset, by), cache=cache)
        scores[method.name] = scores_of(map(_in_contact_throughout, takes), "two-class")
    drawn = {name: _draws(of_method) for name, of_method in scores.items()}
    rows = tuple(Row(name, *_estimates(scores[name], drawn[name])) for name in scores)
    first, second = (drawn[method.name][:, 2] for method in methods)
    value = rows[0].false_positives.value - rows[1].false_positives.value
    return Hardness(rows, interval(value, first - second), _air_over_contact(dataset))


def _draws(scores: Scores) -> NDArray[np.float64]:
    """Balanced accuracy, AUC and false positives of each bootstrap draw; the same surfaces for every method."""
    rng = np.random.default_rng(0)
    strata = [sorted({scores.names[k] for k in np.unique(scores.surface[scores.rough == rough])}) for rough in (0, 1)]
    number = {name: k for k, name in enumerate(scores.names)}
    rows = []
    for _ in range(DRAWS):
        times = np.zeros(len(scores.names))
        for stratum in strata:
            np.add.at(times, [number[name] for name in rng.choice(stratum, len(stratum))], 1.0)
        rows.append(_measures(scores, times[scores.surface]))
    return np.array(rows)


def _measures(scores: Scores, weights: NDArray[np.float64]) -> tuple[float, float, float]:
    metrics = measure(scores, weights)
    return metrics["balanced_accuracy"], metrics["auc"], false_positives_at_recall(scores, RECALL, weights)


def _estimates(scores: Scores, drawn: NDArray[np.float64]) -> list[Estimate]:
    values = _measures(scores, np.ones(len(scores.score)))
    return [interval(value, column) for value, column in zip(values, drawn.T, strict=True)]


def _air_over_contact(dataset: Dataset) -> dict[str, Estimate]:
    """Mean level in air over contact by label, with an interval over its surfaces."""
    ratios: dict[str, dict[str, list[float]]] = {"smooth": {}, "rough": {}}
    for recording in dataset.labelled().recordings:
        values = loud_cues(recording)[1][:, CUES.index("air_to_contact_db")]
        ratios[recording.known("label")].setdefault(recording.surface, []).extend(values)
    rng = np.random.default_rng(0)
    estimates = {}
    for label, by_surface in ratios.items():
        means = [np.mean(values) for values in by_surface.values()]
        drawn = [np.mean(rng.choice(means, len(means))) for _ in range(DRAWS)]
        estimates[label] = interval(float(np.mean(means)), drawn)
    return estimates


def _in_contact_throughout(take: TakePredictions) -> TakePredictions:
    keep = take.contact & _inside(take.recording, take.time)
    return TakePredictions(take.recording, take.time[keep], take.probabilities[keep], take.contact[keep])


@functools.lru_cache(maxsize=1 << 12)
def loud_cues(recording: Recording) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """End in s, and cues, of the windows of the paper's network that are over its gate and in true contact."""
    (signal,) = read_signals([recording], channels=2, rate=NETWORK_RATE)
    count = max(0, int((len(signal) - NETWORK_WINDOW_SIZE) / NETWORK_HOP) + 1)
    ends = NETWORK_WINDOW_SIZE + np.arange(count) * NETWORK_HOP.numerator // NETWORK_HOP.denominator
    windows = sliding_window_view(signal, NETWORK_WINDOW_SIZE, axis=0)[ends - NETWORK_WINDOW_SIZE].transpose(0, 2, 1)
    keep = (_level_dbfs(windows) > LABEL_LEVEL_DBFS) & _inside(recording, ends / NETWORK_RATE)
    rows = [cues(window, NETWORK_RATE) for window in windows[keep]]
    return ends[keep] / NETWORK_RATE, np.array(rows).reshape(-1, len(CUES))


def _inside(recording: Recording, end: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a window lies within one touch of the object from end to end."""
    inside = np.zeros(len(end), bool)
    for segment in recording.segments:
        if segment.label is recording.label:
            inside |= (end - NETWORK_WINDOW_SIZE / NETWORK_RATE >= segment.start) & (end <= segment.end)
    return inside


def _level_dbfs(windows: FloatArray) -> NDArray[np.float64]:
    return np.asarray(10 * np.log10(np.square(windows[:, :, CONTACT], dtype=np.float64).mean(axis=1) + 1e-20))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--split", default="5-fold", help="or leave-one-pressure-out, leave-one-scenario-out")
    args = parser.parse_args()
    options = TrainingOptions(changes=SHORT_TRAINING)
    jobs = [RECIPES["paper"].open_job(replace(options, variant=variant)) for variant in ("general", "one-channel")]
    hardness = measure_hardness(
        open_dataset(args.folder),
        [method_of(job) for job in jobs],
        by=args.split,
        cache=default_cache(),
        report=lambda name: print(f"scoring: {name}", file=sys.stderr),
    )
    print(f"| method | balanced accuracy | AUC | false positives at {RECALL:.0%} rough recall |")
    print("|---|---|---|---|")
    for row in hardness.rows:
        print(f"| {row.name} | {row.balanced_accuracy} | {row.auc} | {row.false_positives} |")
    print(f"\nTwo channels less one, false positives at {RECALL:.0%} recall, drawn in pairs: {hardness.difference}")
    for label, level in hardness.air_over_contact_db.items():
        print(f"Air over contact, {label}: {level.value:.1f} dB ({level.low:.1f} to {level.high:.1f})")


if __name__ == "__main__":
    main()
