"""Every score with its definition: rough or smooth, window by window.

*Positive* is rough. A window is classified as rough when its score is 0.5 or more.
Windows without contact are left out first: the contact gate decides those, not the
classifier.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Rule = Literal["authors", "two-class"]
SCORING_RULES: tuple[Rule, ...] = ("authors", "two-class")

LOW_FALSE_POSITIVES = 0.01
"""False positive rate at which rough recall is read: one false positive in 100
updates."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Scores:
    """Windows in contact with their labels and scores, in ascending order of score."""

    score: NDArray[np.float64]
    """From 0 (smooth) to 1 (rough), float64."""
    rough: NDArray[np.bool_]
    """The label of each window."""
    surface: NDArray[np.intp]
    """Number of the surface of each window: the bootstrap draws surfaces, not
    windows."""
    names: tuple[str, ...]
    """The surfaces' names by number."""


def rough_score(probabilities: NDArray[np.float32], rule: Rule) -> NDArray[np.float64]:
    """Score windows by one of two rules.

    ``authors``: P(rough) among all three classes, as the paper's authors do, so that a
    prediction *none* counts as smooth: a correct smooth and a missed rough.
    ``two-class``: P(rough) given rough or smooth, as in the live system.

    >>> rough_score(np.array([[0.5, 0.1, 0.4]], np.float32), "two-class").round(2)
    array([0.8])
    """
    wide = probabilities.astype(np.float64)
    if rule == "authors":
        return wide[:, 2]
    touched = wide[:, 1] + wide[:, 2]
    score: NDArray[np.float64] = np.divide(
        wide[:, 2], touched, out=np.full(len(wide), 0.5), where=touched > 0
    )
    return score


def log_odds(probabilities: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return the log odds of rough, given rough or smooth, of each window; of certainty
    as of one in a million.

    >>> log_odds(np.array([[0.5, 0.1, 0.4]], np.float32)).round(2)
    array([1.39])
    """
    share = np.clip(rough_score(probabilities, "two-class"), 1e-6, 1 - 1e-6)
    odds: NDArray[np.float64] = np.log(share / (1 - share))
    return odds


def sort_scores(
    score: NDArray[np.float64],
    *,
    rough: NDArray[np.bool_],
    surface: NDArray[np.intp],
    names: tuple[str, ...],
) -> Scores:
    """Sort windows by score, once, so that each bootstrap draw needs only sums."""
    order = np.argsort(score, kind="stable")
    return Scores(score[order], rough[order], surface[order], names)


def measure(scores: Scores, weights: Floats | None = None) -> dict[str, float]:
    """Compute every metric; ``weights`` says how often each window counts, once by
    default.

    Returns
    -------
    dict
        ``smooth_accuracy``, ``rough_accuracy``
            Share of a class's windows that are classified as that class (the paper's
            Table II).
        ``balanced_accuracy``
            Mean of the two.
        ``false_positive_rate``
            Share of smooth windows classified as rough.
        ``auc``
            Probability that a rough window scores above a smooth one, ties count half
            (area under the ROC curve).
        ``recall_at_1``
            Share of rough windows above the score that 1 % of smooth windows exceed.
        ``rough_as_rough``, ``rough_as_smooth``, ``smooth_as_rough``,
        ``smooth_as_smooth``
            Shares of all windows (the paper's Table I).

        A metric of a class without windows is NaN.
    """
    every = np.ones(len(scores.score)) if weights is None else weights
    place, called = _bins(scores, len(scores.score))
    counts = [
        np.bincount(place, every * kind, len(called))
        for kind in (~scores.rough, scores.rough)
    ]
    return {
        name: float(value)
        for name, value in measure_counts(np.array(counts, float), called).items()
    }


def count_by_surface(scores: Scores, *, bins: int) -> tuple[Floats, NDArray[np.bool_]]:
    """Count windows in bins of about equally many, for :func:`measure_counts`; equal
    scores share a bin.

    Returns the table, shape ``(surfaces, 2, bins)``, smooth windows first, and which
    bins are classified as rough.
    """
    place, called = _bins(scores, bins)
    cell = scores.surface * len(called) + place
    size = len(scores.names) * len(called)
    counts = [
        np.bincount(cell, kind, size).reshape(-1, len(called))
        for kind in (~scores.rough, scores.rough)
    ]
    return np.stack(counts, axis=1).astype(np.float64), called


def measure_counts(table: Floats, called: NDArray[np.bool_]) -> dict[str, Floats]:
    """Compute the metrics of :func:`measure` for each of any number of cases, tables
    ``(..., 2, bins)``."""
    smooth = table[..., 0, :]
    rough = table[..., 1, :]
    all_rough = rough.sum(axis=-1)
    all_smooth = smooth.sum(axis=-1)
    total = all_rough + all_smooth
    hits = rough @ called
    bumps = smooth @ called
    recall = _divide(hits, all_rough)
    quiet = _divide(all_smooth - bumps, all_smooth)
    # Mann-Whitney's statistic over all pairs; pairs within a bin are ties.
    below = np.cumsum(smooth, axis=-1) - smooth / 2
    return {
        "smooth_accuracy": quiet,
        "rough_accuracy": recall,
        "balanced_accuracy": balanced_accuracy(quiet, recall),
        "false_positive_rate": 1 - quiet,
        "auc": _divide((rough * below).sum(axis=-1), all_rough * all_smooth),
        "recall_at_1": _recall_at(rough, smooth),
        "rough_as_rough": _divide(hits, total),
        "rough_as_smooth": _divide(all_rough - hits, total),
        "smooth_as_rough": _divide(bumps, total),
        "smooth_as_smooth": _divide(all_smooth - bumps, total),
    }


def balanced_accuracy(smooth: Floats, rough: Floats, *, either: bool = False) -> Floats:
    """Mean of the shares of smooth and of rough that are classified correctly.

    NaN where a class is missing; with ``either``, the share of the other class there.
    """
    mean = (smooth + rough) / 2
    return (
        np.where(np.isnan(smooth), rough, np.where(np.isnan(rough), smooth, mean))
        if either
        else mean
    )


def false_positives_at_recall(scores: Scores, recall: float) -> float:
    """Share of smooth windows classified as rough, at the threshold that finds this
    share of the rough windows."""
    rough = scores.rough[::-1]
    found = np.cumsum(rough)
    place = int(np.searchsorted(found, recall * found[-1]))
    return float((~rough[: place + 1]).sum() / (~rough).sum())


def _bins(scores: Scores, bins: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """The bin of each window, and which bins are classified as rough."""
    count = len(scores.score)
    # Ties must share a bin: each window takes the place of the first window with its
    # score.
    first = np.flatnonzero(np.diff(scores.score, prepend=-np.inf))
    tied = np.repeat(first, np.diff(first, append=count))
    called = scores.score >= 0.5
    # The last bit keeps the two sides of 0.5 in different bins.
    codes, place = np.unique(
        2 * (tied * min(bins, count) // max(count, 1)) + called, return_inverse=True
    )
    return place, codes % 2 == 1


def _recall_at(rough: Floats, smooth: Floats) -> Floats:
    """Recall of rough above the lowest bin that at most 1 % of smooth windows
    exceed."""
    all_smooth = smooth.sum(axis=-1, keepdims=True)
    too_low = all_smooth - np.cumsum(smooth, axis=-1) > LOW_FALSE_POSITIVES * all_smooth
    place = np.arange(rough.shape[-1]) > too_low.sum(axis=-1, keepdims=True)
    recall = _divide((rough * place).sum(axis=-1), rough.sum(axis=-1))
    return np.where(all_smooth[..., 0] > 0, recall, np.nan)


def _divide(part: Floats, whole: Floats) -> Floats:
    return np.asarray(
        np.divide(part, whole, out=np.full(np.shape(whole), np.nan), where=whole > 0)
    )
