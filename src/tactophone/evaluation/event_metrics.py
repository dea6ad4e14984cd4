"""What the operator would feel, in the units that matter to a finger: false bumps a minute, and milliseconds.

All is taken from the beliefs that a detector had at each update, with the gate's contact, its threshold and what it
abstains from, as the live system would act on them.
"""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Segment
from tactophone.dataset.motion_intervals import first_slide, slides_over
from tactophone.evaluation.metrics import rough_score
from tactophone.evaluation.predictions import TakePredictions
from tactophone.perception import Decision, DecisionRule
from tactophone.types import Touch

BRIDGE = 0.03
"""Seconds; two bumps closer than the shortest burst that is felt are felt as one (Sci. Rep. 2025, 15:5057)."""

HOLD = 0.05
"""Seconds that a belief must stay right to count as a decision and not as a flicker."""

SHORTEST_TOUCH = 0.3
"""Seconds; of shorter touches no delay is taken."""

BINS = 10
"""Of equal width, for the calibration error (Guo et al., ICML 2017, section 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class Delays:
    """Seconds from each change to the right belief of it, of those that came; and how many never came."""

    times: NDArray[np.float64]
    missed: int

    def quantile_ms(self, share: float) -> float:
        """Milliseconds within which this share of the right decisions came; NaN if there were none."""
        return 1e3 * float(np.quantile(self.times, share)) if len(self.times) else float("nan")

    @property
    def missed_share(self) -> float:
        """Share of changes of which no right decision came."""
        total = len(self.times) + self.missed
        return self.missed / total if total else float("nan")


@functools.lru_cache(maxsize=1 << 11)
def touches(take_predictions: TakePredictions, rule: DecisionRule) -> NDArray[np.int8]:
    """Give the touch believed at each update."""
    decision = Decision(rule)
    updates = zip(take_predictions.probabilities.astype(float).tolist(), take_predictions.contact.tolist(), strict=True)
    return np.array([decision.decide((n, s, r), contact=contact)[0] for (n, s, r), contact in updates], np.int8)


def false_bumps_per_minute(judged: Iterable[TakePredictions], rule: DecisionRule) -> float:
    """Count how often smooth touching is felt as rough, per minute of touching; NaN if nothing smooth was touched."""
    bumps, duration = 0, 0.0
    for one in judged:
        if one.recording.label is not Touch.SMOOTH or len(one.time) < 2:
            continue
        bumps += len(_runs((touches(one, rule) == Touch.ROUGH) & truly_touching(one), one.time))
        duration += float(truly_touching(one).mean() * (one.time[-1] - one.time[0]))
    return 60 * bumps / duration if duration else float("nan")


def contact_delays(judged: Iterable[TakePredictions], rule: DecisionRule, *, latency: float) -> Delays:
    """Time from when each touch first slides to the right decision about it; only of recordings that tell touches.

    Recordings of more than one label, such as joined edges, are left out. Where sliding is not told, the time counts
    from the first touch.

    Parameters
    ----------
    judged
        Of recordings with segments.
    rule
        Of the decision.
    latency
        Seconds from a window's end to its take_predictions.
    """
    found = [
        _delay(one, start, segment.end, one.recording.label, rule=rule)
        for one in judged
        if one.recording.label is not None
        for segment in _touches(one.recording.segments)
        if (start := first_slide(one.recording, segment.start, segment.end)) is not None
        and segment.end - start >= SHORTEST_TOUCH
    ]
    return _delays(found, latency)


def edge_delays(judged: Iterable[TakePredictions], rule: DecisionRule, *, latency: float) -> Delays:
    """Time from each change between smooth and rough, with no lift-off between, to the right decision.

    Edges on which the finger comes to a stop are left out, where sliding is told.
    """
    found = []
    for one in judged:
        for before, after in zip(one.recording.segments, one.recording.segments[1:], strict=False):
            changes = {before.label, after.label} == {Touch.SMOOTH, Touch.ROUGH}
            if changes and slides_over(one.recording, after.start):
                found.append(_delay(one, after.start, after.end, after.label, rule=rule))
    return _delays(found, latency)


def calibration_error(judged: Iterable[TakePredictions]) -> float:
    """Mean distance between the confidence in rough and how often it is right, over windows in contact."""
    kept = [(rough_score(one.probabilities[one.contact], "two-class"), one) for one in judged]
    share = np.concatenate([score for score, _ in kept])
    rough = np.concatenate([np.full(len(score), one.recording.label is Touch.ROUGH) for score, one in kept])
    place = np.minimum((share * BINS).astype(int), BINS - 1)
    count = np.bincount(place, minlength=BINS)
    gaps = np.abs(np.bincount(place, share, BINS) - np.bincount(place, rough, BINS))
    return float(gaps.sum() / count.sum()) if count.sum() else float("nan")


def truly_touching(take_predictions: TakePredictions) -> NDArray[np.bool_]:
    """Whether the finger truly touches at each update; always, where a recording does not tell."""
    segments = take_predictions.recording.segments
    if not segments:
        return np.ones(len(take_predictions.time), bool)
    inside = [
        (take_predictions.time > one.start) & (take_predictions.time <= one.end) for one in segments if one.contact
    ]
    return np.any(inside, axis=0) if inside else np.zeros(len(take_predictions.time), bool)


def _runs(on: NDArray[np.bool_], time: NDArray[np.float64]) -> list[tuple[float, float]]:
    """Begin and end of each stretch of updates that is on, near ones joined."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], on.astype(np.int8), [0]))))
    joined: list[tuple[float, float]] = []
    for begin, end in edges.reshape(-1, 2):
        start = float(time[begin])
        if joined and start - joined[-1][1] < BRIDGE:
            start = joined.pop()[0]
        joined.append((start, float(time[end - 1])))
    return joined


def _touches(segments: Sequence[Segment]) -> list[Segment]:
    """Touches of one thing that begin after silence."""
    begun = zip((None, *segments), segments, strict=False)
    return [
        one
        for before, one in begun
        if one.contact and one.label is not None and before is not None and not before.contact
    ]


def _delay(
    take_predictions: TakePredictions, start: float, end: float, label: Touch | None, *, rule: DecisionRule
) -> float | None:
    here = (take_predictions.time > start) & (take_predictions.time <= end)
    time, right = take_predictions.time[here], touches(take_predictions, rule)[here] == label
    for begin, last in _stretches(right):
        if time[last] - time[begin] >= HOLD or last == len(right) - 1:
            return float(time[begin] - start)
    return None


def _stretches(on: NDArray[np.bool_]) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], on.astype(np.int8), [0]))))
    return [(int(begin), int(end) - 1) for begin, end in edges.reshape(-1, 2)]


def _delays(found: Sequence[float | None], latency: float) -> Delays:
    times = [one + latency for one in found if one is not None]
    return Delays(np.array(times), len(found) - len(times))
