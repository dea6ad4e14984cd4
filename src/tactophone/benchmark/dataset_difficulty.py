"""Whether a data set is hard in the paper's way: what the paper's authors tried first must fail on it, what they ended
with must do better, and the air microphone must take back false positives.

All methods judge the same windows: those that the level's gate lets through *and* that truly are contact from end to
end.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from tactophone.benchmark.crossvalidation import Cache, Method, cross_validate
from tactophone.dataset import Dataset, Recording, split
from tactophone.evaluation.bootstrap import DRAWS, Estimate, interval
from tactophone.evaluation.metrics import Scores, measure
from tactophone.evaluation.predictions import Judge, TakePredictions, scores_of
from tactophone.training.model_export import HOP
from tactophone.training.network.recipe import LABEL_LEVEL_DBFS
from tactophone.training.network.windows import SIZE
from tactophone.training.sound import RATE, read_signals
from tactophone.types import AIR, CONTACT, FloatArray, Touch

Cues = Callable[[FloatArray], NDArray[np.float64]]
"""Windows of shape ``(windows, 512, channels)`` to what a rule looks at, ``(windows, cues)``."""

RECALL = 0.8
"""Share of rough windows that must be found when false positives are compared: an operator notices most bumps."""

VERSION = 1
"""Of the rules; raise it when one changes, so that cached results are made anew."""


def level(windows: FloatArray) -> NDArray[np.float64]:
    """RMS level of the contact microphone in dBFS: *rough is louder*."""
    return _decibels(windows[:, :, CONTACT])[:, None]


def median_frequency(windows: FloatArray) -> NDArray[np.float64]:
    """Frequency in Hz that halves the contact microphone's power over 20 Hz (Svensson 2021)."""
    power = np.abs(np.fft.rfft(windows[:, :, CONTACT] * np.hanning(SIZE).astype(np.float32), axis=1)) ** 2
    power[:, : int(20 * SIZE / RATE)] = 0
    total = np.cumsum(power, axis=1)
    return np.asarray(np.argmax(total >= total[:, -1:] / 2, axis=1)[:, None] * (RATE / SIZE))


def transients(windows: FloatArray) -> NDArray[np.float64]:
    """Level, crest factor in dB, and kurtosis: *rough is louder and more transient*, the authors' first classifier."""
    contact = windows[:, :, CONTACT].astype(np.float64)
    rms = _decibels(windows[:, :, CONTACT])
    crest = 20 * np.log10(np.abs(contact).max(axis=1) + 1e-9) - rms
    centred = contact - contact.mean(axis=1, keepdims=True)
    kurtosis = (centred**4).mean(axis=1) / ((centred**2).mean(axis=1) ** 2 + 1e-20)
    return np.stack([rms, crest, np.log(kurtosis + 1e-9)], axis=1)


def air_to_contact(windows: FloatArray) -> NDArray[np.float64]:
    """Level of the air microphone over that of the contact microphone, in dB."""
    return (_decibels(windows[:, :, AIR]) - _decibels(windows[:, :, CONTACT]))[:, None]


RULES: Mapping[str, Cues] = {
    "loudness": level,
    "median frequency": median_frequency,
    "loud and transient": transients,
    "air to contact": air_to_contact,
}
"""Rules by name."""


@dataclass(frozen=True, slots=True)
class RuleMethod:
    """A hand-made rule: its cues, weighed by a logistic regression, as its best thresholds would."""

    name: str

    @property
    def identity(self) -> str:
        """The rule, and its version."""
        return f"rule {VERSION} {self.name}"

    def fit(self, recordings: Sequence[Recording]) -> Judge:
        """Weigh the cues so that both classes count the same."""
        from sklearn.linear_model import LogisticRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler

        cues = [RULES[self.name](_loud_windows(one)[1]) for one in recordings]
        rough = np.repeat([one.label is Touch.ROUGH for one in recordings], [len(one) for one in cues])
        model = make_pipeline(StandardScaler(), LogisticRegression(class_weight="balanced"))
        model.fit(np.concatenate(cues), rough)

        def judge(recording: Recording) -> TakePredictions:
            time, windows = _loud_windows(recording)
            share = np.zeros(len(time), np.float32)
            if len(time):
                share = model.predict_proba(RULES[self.name](windows))[:, 1].astype(np.float32)
            rows = np.stack([np.zeros_like(share), 1 - share, share], axis=1)
            return TakePredictions(recording, time, rows, np.ones(len(time), bool))

        return judge


@dataclass(frozen=True, slots=True)
class Row:
    """A method's scores: balanced accuracy, AUC, and false positives where ``RECALL`` of the rough is found."""

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
        Each method.
    difference
        False positives of the first method's less the second's, drawn in pairs: two channels less one.
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
    """Cross-validate methods and rules on a two-channel set whose segments tell the truth.

    Parameters
    ----------
    dataset
        Labelled recordings.
    methods
        The learnt ones: two channels first, then one.
    by
        The split: surfaces never met, or any other that `dataset.split` knows.
    cache
        Where judgements are kept.
    report
        Told each method's name as it begins.
    """
    judged: dict[str, Scores] = {}
    for method in (*methods, *(RuleMethod(name) for name in RULES)):
        report(method.name)
        judgements = cross_validate(method, split(dataset, by), cache=cache)
        judged[method.name] = scores_of([_truly_touching(one) for one in judgements], "two-class")
    drawn = {name: _draws(scores) for name, scores in judged.items()}
    rows = tuple(Row(name, *_estimates(judged[name], drawn[name])) for name in judged)
    return Hardness(rows, _difference(rows, [drawn[method.name] for method in methods]), _loudness(dataset))


def false_positives(scores: Scores, weights: NDArray[np.float64], *, recall: float = RECALL) -> float:
    """Share of smooth windows called rough at the threshold that finds this share of the rough ones."""
    rough, smooth = weights * scores.rough, weights * ~scores.rough
    found = np.cumsum(rough[::-1])
    place = int(np.searchsorted(found, recall * found[-1]))
    return float(smooth[::-1][: place + 1].sum() / smooth.sum())


def _draws(scores: Scores) -> NDArray[np.float64]:
    """Balanced accuracy, AUC and false positives of each bootstrap draw; the same surfaces for every method."""
    rng = np.random.default_rng(0)
    strata = [sorted({scores.names[k] for k in np.unique(scores.surface[scores.rough == kind])}) for kind in (0, 1)]
    number = {name: k for k, name in enumerate(scores.names)}
    rows = []
    for _ in range(DRAWS):
        times = np.zeros(len(scores.names))
        for stratum in strata:
            np.add.at(times, [number[name] for name in rng.choice(stratum, len(stratum))], 1.0)
        rows.append(_measures(scores, times[scores.surface]))
    return np.array(rows)


def _measures(scores: Scores, weights: NDArray[np.float64]) -> tuple[float, float, float]:
    found = measure(scores, weights)
    return found["balanced_accuracy"], found["auc"], false_positives(scores, weights)


def _estimates(scores: Scores, drawn: NDArray[np.float64]) -> list[Estimate]:
    values = _measures(scores, np.ones(len(scores.score)))
    return [interval(value, column) for value, column in zip(values, drawn.T, strict=True)]


def _difference(rows: Sequence[Row], drawn: Sequence[NDArray[np.float64]]) -> Estimate:
    value = rows[0].false_positives.value - rows[1].false_positives.value
    return interval(value, drawn[0][:, 2] - drawn[1][:, 2])


def _loudness(dataset: Dataset) -> dict[str, Estimate]:
    """Mean level in air over contact by label, with an interval over its surfaces."""
    found: dict[str, dict[str, list[float]]] = {"smooth": {}, "rough": {}}
    for recording in dataset.labelled().recordings:
        ratios = air_to_contact(_loud_windows(recording)[1])
        found[recording.known("label")].setdefault(recording.surface, []).extend(ratios[:, 0])
    rng = np.random.default_rng(0)
    return {
        label: interval(
            float(np.mean([np.mean(some) for some in surfaces.values()])),
            [np.mean(rng.choice([np.mean(some) for some in surfaces.values()], len(surfaces))) for _ in range(DRAWS)],
        )
        for label, surfaces in found.items()
    }


def _truly_touching(take_predictions: TakePredictions) -> TakePredictions:
    keep = take_predictions.contact & _inside(take_predictions.recording, take_predictions.time)
    return TakePredictions(
        take_predictions.recording,
        take_predictions.time[keep],
        take_predictions.probabilities[keep],
        take_predictions.contact[keep],
    )


def _loud_windows(recording: Recording) -> tuple[NDArray[np.float64], FloatArray]:
    """End in s and sound of the windows that are over the paper's gate and truly contact."""
    signal = read_signals([recording], channels=2)[0]
    ends = SIZE + np.arange(max(0, int((len(signal) - SIZE) / HOP) + 1)) * HOP.numerator // HOP.denominator
    windows = sliding_window_view(signal, SIZE, axis=0)[ends - SIZE].transpose(0, 2, 1)
    keep = (_decibels(windows[:, :, CONTACT]) > LABEL_LEVEL_DBFS) & _inside(recording, ends / RATE)
    return ends[keep] / RATE, np.ascontiguousarray(windows[keep])


def _inside(recording: Recording, end: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a window lies in a stretch of touching the object from end to end."""
    inside = np.zeros(len(end), bool)
    for segment in recording.segments:
        if segment.label is recording.label:
            inside |= (end - SIZE / RATE >= segment.start) & (end <= segment.end)
    return inside


def _decibels(windows: FloatArray) -> NDArray[np.float64]:
    return np.asarray(10 * np.log10(np.square(windows, dtype=np.float64).mean(axis=1) + 1e-20))
