"""Events at the operator's finger: false bumps per minute, and the delay to a correct decision in milliseconds.

All are computed from a detector's predictions at each update, through its own contact gate and decision rule, as the
live system acts on them.
"""

import functools
import itertools
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset import Segment
from tactophone.dataset.motion_intervals import first_slide, slides_over
from tactophone.evaluation.metrics import rough_score
from tactophone.evaluation.predictions import TakePredictions
from tactophone.evaluation.true_contact import true_contact
from tactophone.perception import Decision, DecisionRule
from tactophone.types import Touch

BRIDGE = 0.03
"""Seconds; two bumps closer than the shortest perceptible burst are perceived as one (Sci. Rep. 2025, 15:5057)."""

HOLD = 0.05
"""Seconds that a touch must stay correct to count as a decision and not as a flicker."""

SHORTEST_TOUCH = 0.3
"""Seconds; shorter touches count in no delay."""

BINS = 10
"""Of equal width, for the calibration error (Guo et al., ICML 2017, section 2)."""


@dataclass(frozen=True, slots=True, eq=False)
class Delays:
    """Seconds from each change to the correct decision, where one came; and the number of changes without one."""

    times: NDArray[np.float64]
    missed: int

    def quantile_ms(self, share: float) -> float:
        """Quantile of the delays of *all* changes, in ms: infinite where it falls on one without a correct decision.

        NaN without changes.
        """
        every = np.concatenate((np.sort(self.times), np.full(self.missed, np.inf)))
        if not len(every):
            return float("nan")
        place = share * (len(every) - 1)
        low, high = every[math.floor(place)], every[math.ceil(place)]
        # Between two delays the quantile is interpolated; next to a missing one it is infinite.
        return 1e3 * float(low if low == high else low + (high - low) * (place % 1))

    @property
    def missed_share(self) -> float:
        """Share of changes without a correct decision; NaN without changes."""
        total = len(self.times) + self.missed
        return self.missed / total if total else float("nan")


@functools.lru_cache(maxsize=1 << 11)
def decided_touches(take: TakePredictions, rule: DecisionRule) -> NDArray[np.int8]:
    """Return what was rendered at each update, ``(updates,)``, or what the decision rule reports of the predictions."""
    if take.touch is not None:
        return take.touch
    decision = Decision(rule)
    updates = zip(take.probabilities.astype(float).tolist(), take.contact.tolist(), strict=True)
    return np.array([decision.decide((n, s, r), contact=contact)[0] for (n, s, r), contact in updates], np.int8)


def false_bumps_per_minute(predictions: Iterable[TakePredictions], rule: DecisionRule) -> float:
    """False bumps (smooth classified as rough, as events) per minute of true contact with smooth surfaces.

    Bumps closer than :data:`BRIDGE` are one. NaN without contact with a smooth surface.
    """
    bumps, duration = 0, 0.0
    for take in predictions:
        if take.recording.label is not Touch.SMOOTH or len(take.time) < 2:
            continue
        touching = true_contact(take)
        bumps += _count_bumps((decided_touches(take, rule) == Touch.ROUGH) & touching, take.time)
        duration += float(touching.mean() * (take.time[-1] - take.time[0]))
    return 60 * bumps / duration if duration else float("nan")


def contact_delays(predictions: Iterable[TakePredictions], rule: DecisionRule, *, latency: float) -> Delays:
    """Time from the first slide of each touch to the correct decision; only recordings with segments count.

    Recordings of more than one label, such as joined edges, are left out. Where sliding is not labelled, the time
    counts from the first touch. ``latency`` is from a window's end to its prediction, in s.
    """
    found = [
        _delay(take, start, segment.end, take.recording.label, rule=rule)
        for take in predictions
        if take.recording.label is not None
        for segment in _touches_after_silence(take.recording.segments)
        if (start := first_slide(take.recording, segment.start, segment.end)) is not None
        and segment.end - start >= SHORTEST_TOUCH
    ]
    return _delays(found, latency)


def edge_delays(predictions: Iterable[TakePredictions], rule: DecisionRule, *, latency: float) -> Delays:
    """Time from each change between smooth and rough, without a lift-off between, to the correct decision.

    Edges on which the finger stops are left out, where sliding is labelled. Parameters as in :func:`contact_delays`.
    """
    found = []
    for take in predictions:
        for before, after in zip(take.recording.segments, take.recording.segments[1:], strict=False):
            changes = {before.label, after.label} == {Touch.SMOOTH, Touch.ROUGH}
            if changes and slides_over(take.recording, after.start):
                found.append(_delay(take, after.start, after.end, after.label, rule=rule))
    return _delays(found, latency)


def calibration_error(predictions: Iterable[TakePredictions]) -> float:
    """Expected calibration error: mean distance between P(rough) and the share truly rough, over :data:`BINS` bins.

    Over updates in contact, by the two-class rule; NaN without any. Source: Guo et al., ICML 2017, section 2.
    """
    takes = [(rough_score(take.probabilities[take.contact], "two-class"), take) for take in predictions]
    share = np.concatenate([score for score, _ in takes])
    rough = np.concatenate([np.full(len(score), take.recording.label is Touch.ROUGH) for score, take in takes])
    place = np.minimum((share * BINS).astype(int), BINS - 1)
    count = np.bincount(place, minlength=BINS)
    # Sums, not means: a bin's gap times its count, so that bins weigh as many windows as they hold.
    gaps = np.abs(np.bincount(place, share, BINS) - np.bincount(place, rough, BINS))
    return float(gaps.sum() / count.sum()) if count.sum() else float("nan")


def _count_bumps(rough: NDArray[np.bool_], time: NDArray[np.float64]) -> int:
    """Number of stretches of updates that are rough; stretches closer than a perceptible gap count as one."""
    stretches = _stretches(rough)
    joined = sum(time[begin] - time[end] < BRIDGE for (_, end), (begin, _) in itertools.pairwise(stretches))
    return len(stretches) - int(joined)


def _touches_after_silence(segments: Sequence[Segment]) -> list[Segment]:
    """Labelled touches that begin after a segment without contact."""
    pairs = itertools.pairwise(segments)
    return [touch for before, touch in pairs if touch.contact and touch.label is not None and not before.contact]


def _delay(take: TakePredictions, start: float, end: float, label: Touch | None, *, rule: DecisionRule) -> float | None:
    here = (take.time > start) & (take.time <= end)
    time, correct = take.time[here], decided_touches(take, rule)[here] == label
    for begin, last in _stretches(correct):
        # A correct stretch that the segment's end cuts short counts too: nothing contradicts it.
        if time[last] - time[begin] >= HOLD or last == len(correct) - 1:
            return float(time[begin] - start)
    return None


def _stretches(on: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First and last index of each stretch that is on."""
    edges = np.flatnonzero(np.diff(on.astype(np.int8), prepend=0, append=0))
    return [(int(begin), int(end) - 1) for begin, end in edges.reshape(-1, 2)]


def _delays(found: Sequence[float | None], latency: float) -> Delays:
    times = [delay + latency for delay in found if delay is not None]
    return Delays(np.array(times), len(found) - len(times))
