"""Every score with its definition: rough or smooth, window by window.

*Positive* is rough. A window is called rough when its score is 0.5 or more. Windows without contact are left out
before: the gate has answered for them, and no detector was asked.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

Rule = Literal["authors", "two-class"]
RULES: tuple[Rule, ...] = ("authors", "two-class")

LOW_FALSE_POSITIVES = 0.01
"""Share of smooth windows that may be called rough when rough recall is read off: one false bump in 100 updates."""

Measures: TypeAlias = Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False)
class Scores:
    """Windows in contact with what they are and what they were scored, in ascending order of score.

    Parameters
    ----------
    score
        From 0 (smooth) to 1 (rough), float64.
    rough
        What each window truly is.
    surface
        Number of the surface that each window comes from: bootstrap draws surfaces, not windows.
    names
        The surfaces' names by number.
    """

    score: NDArray[np.float64]
    rough: NDArray[np.bool_]
    surface: NDArray[np.intp]
    names: tuple[str, ...]


def rough_score(probabilities: NDArray[np.float32], rule: Rule) -> NDArray[np.float64]:
    """Score windows by one of two rules that the field uses.

    ``authors``: P(rough) of all three classes, so that an answer *none* counts as smooth: a correct smooth and a
    missed rough. ``two-class``: P(rough) of the two that touch, as the live system's confidence has it.

    >>> rough_score(np.array([[0.5, 0.1, 0.4]], np.float32), "two-class").round(2)
    array([0.8])
    """
    wide = probabilities.astype(np.float64)
    if rule == "authors":
        return wide[:, 2]
    touched = wide[:, 1] + wide[:, 2]
    score: NDArray[np.float64] = np.divide(wide[:, 2], touched, out=np.full(len(wide), 0.5), where=touched > 0)
    return score


def collect(
    score: NDArray[np.float64], *, rough: NDArray[np.bool_], surface: NDArray[np.intp], names: tuple[str, ...]
) -> Scores:
    """Sort windows by score, once, so that each bootstrap draw needs only sums."""
    order = np.argsort(score, kind="stable")
    return Scores(score[order], rough[order], surface[order], names)


def measure(scores: Scores, weights: NDArray[np.float64] | None = None) -> dict[str, float]:
    """Compute every score at once.

    Parameters
    ----------
    scores
        The windows.
    weights
        How often each window counts; once, if not given.

    Returns
    -------
    dict
        ``smooth_accuracy``, ``rough_accuracy``
            Share of a class's windows called so (Table II).
        ``balanced_accuracy``
            Mean of the two.
        ``false_positive_rate``
            Share of smooth windows called rough: bumps that are not there.
        ``auc``
            Chance that a rough window scores above a smooth one, ties half (area under the ROC curve).
        ``recall_at_1``
            Share of rough windows above the score that 1 % of smooth ones exceed.
        ``rough_as_rough``, ``rough_as_smooth``, ``smooth_as_rough``, ``smooth_as_smooth``
            Shares of all windows (Table I).

        A score that needs a class with no windows is NaN.
    """
    every = np.ones(len(scores.score)) if weights is None else weights
    rough, smooth = every * scores.rough, every * ~scores.rough
    called = scores.score >= 0.5
    shares = _confusion(rough, smooth, called)
    recall, quiet = _divide(rough[called].sum(), rough.sum()), _divide(smooth[~called].sum(), smooth.sum())
    return {
        "smooth_accuracy": quiet,
        "rough_accuracy": recall,
        "balanced_accuracy": (quiet + recall) / 2,
        "false_positive_rate": 1 - quiet,
        "auc": _auc(scores.score, rough, smooth),
        "recall_at_1": _recall_at(scores.score, rough, smooth),
        **shares,
    }


def _confusion(rough: NDArray[np.float64], smooth: NDArray[np.float64], called: NDArray[np.bool_]) -> dict[str, float]:
    total = rough.sum() + smooth.sum()
    return {
        "rough_as_rough": _divide(rough[called].sum(), total),
        "rough_as_smooth": _divide(rough[~called].sum(), total),
        "smooth_as_rough": _divide(smooth[called].sum(), total),
        "smooth_as_smooth": _divide(smooth[~called].sum(), total),
    }


def _auc(score: NDArray[np.float64], rough: NDArray[np.float64], smooth: NDArray[np.float64]) -> float:
    """Mann-Whitney's statistic over all pairs, on windows sorted by score."""
    first = np.flatnonzero(np.diff(score, prepend=-np.inf))
    rough_tied, smooth_tied = np.add.reduceat(rough, first), np.add.reduceat(smooth, first)
    below = np.cumsum(smooth_tied) - smooth_tied
    return _divide(float(rough_tied @ (below + smooth_tied / 2)), rough.sum() * smooth.sum())


def _recall_at(score: NDArray[np.float64], rough: NDArray[np.float64], smooth: NDArray[np.float64]) -> float:
    """Recall of rough at the lowest threshold that at most 1 % of smooth windows exceed."""
    above = smooth.sum() - np.cumsum(smooth)
    allowed = np.flatnonzero(above <= LOW_FALSE_POSITIVES * smooth.sum())
    if smooth.sum() == 0:
        return float("nan")
    return _divide(rough[score > score[allowed[0]]].sum(), rough.sum())


def _divide(part: float, whole: float) -> float:
    return float(part / whole) if whole > 0 else float("nan")
