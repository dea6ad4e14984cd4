"""Events at the operator's finger: false bumps and dips per minute, and the delay to a
correct decision in ms.

All are computed from what was rendered at each update, as the live system decides it:
by the contact gate and the evidence of the touch.

Edges between smooth and rough without a lift-off are rare in recordings, because the
finger lifts between objects. So :func:`join_edges` makes them from recordings of
held-out surfaces: the middle of a touch on one surface, cross-faded into the middle of
a touch on another over the time that a fingertip takes to cross an edge.
"""

import functools
import hashlib
import itertools
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.core.processes import atomic_write
from tactophone.core.recordings.sound_file import sound_info
from tactophone.core.recordings.values import (
    Recording,
    Segment,
    cut_slides,
    first_slide,
    slides_over,
    stretches,
    write_slides,
)
from tactophone.core.types import SURFACE_LABELS, FloatArray, Touch
from tactophone.live.audio.files import FileSource
from tactophone.signal.perception.decision import DecisionRule, count_dips
from tactophone.signal.perception.evidence import TouchEvidence
from tactophone.signal.perception.levels import LoudnessRule
from tactophone.signal.perception.model_file import Model
from tactophone.signal.perception.noise_floor import LOWEST_DBFS, measure_floor
from tactophone_lab.evaluation.metrics import rough_score
from tactophone_lab.evaluation.predict import (
    Predictor,
    TakePredictions,
    recording_predictor,
    touches_of,
    true_contact,
)

BRIDGE = 0.03
"""Seconds; two bumps closer than the shortest perceptible burst are perceived as one
(Sci. Rep. 2025, 15:5057)."""

EVENT_HOLD = 0.05
"""Seconds that a touch must stay correct to count as a decision and not as a
flicker."""

SHORTEST_SCORED_TOUCH = 0.3
"""Seconds; shorter touches count in no delay."""

CALIBRATION_BINS = 10
"""Of equal width, for the calibration error (Guo et al., ICML 2017, section 2)."""

HALF = 0.6
"""Seconds of each surface at an edge that is joined."""

EVENT_FADE = 0.02
"""Seconds of cross-fade: 2 mm of contact at 10 cm/s."""

LEAD = 0.2
"""Seconds of silence before, so that running statistics begin empty."""

MOST_EDGES = 40
"""Of one set of recordings."""

_VERSION = 2
"""Of the joining, in the files' names: 2 fades in, where 1 began with a click."""

SOURCES_KEY = "sources"
"""Property of an edge: the paths of the two recordings that it is joined from, by
line."""


@dataclass(frozen=True, slots=True, eq=False)
class Delays:
    """Seconds from each change to the correct decision, where one came; and the number
    of changes without one."""

    times: NDArray[np.float64]
    missed: int

    def quantile_ms(self, share: float) -> float:
        """Quantile of the delays of *all* changes, in ms: infinite where it falls on
        one without a correct decision.

        NaN without changes.
        """
        every = np.concatenate((np.sort(self.times), np.full(self.missed, np.inf)))
        if not len(every):
            return float("nan")
        place = share * (len(every) - 1)
        low = every[math.floor(place)]
        high = every[math.ceil(place)]
        # Between two delays the quantile is interpolated; next to a missing one it is
        # infinite.
        return 1e3 * float(low if low == high else low + (high - low) * (place % 1))

    @property
    def missed_share(self) -> float:
        """Share of changes without a correct decision; NaN without changes."""
        total = len(self.times) + self.missed
        return self.missed / total if total else float("nan")


@functools.lru_cache(maxsize=1 << 11)
def decided_touches(take: TakePredictions, rule: DecisionRule) -> NDArray[np.int8]:
    """Return what was rendered at each update, ``(updates,)``; where single windows are
    all there is, what the evidence of those in contact says by the decision rule."""
    if take.touch is not None:
        return take.touch
    evidence = TouchEvidence(rule)
    touches = []
    for now, (none, smooth, rough), contact in zip(
        take.time.tolist(),
        take.probabilities.astype(float).tolist(),
        take.contact.tolist(),
        strict=True,
    ):
        if contact:
            evidence.hear((none, smooth, rough), now)
        touches.append(_touch_of(contact=contact, rough=evidence.is_rough(now)))
    return np.array(touches, np.int8)


def _touch_of(*, contact: bool, rough: bool) -> Touch:
    if not contact:
        return Touch.NONE
    return Touch.ROUGH if rough else Touch.SMOOTH


def false_bumps_per_minute(
    predictions: Iterable[TakePredictions], rule: DecisionRule
) -> float:
    """False bumps (smooth classified as rough, as events) per minute of true contact
    with smooth surfaces.

    Bumps closer than :data:`BRIDGE` are one. NaN without contact with a smooth surface.
    """
    bumps = 0
    duration = 0.0
    for take in predictions:
        if take.recording.label is Touch.SMOOTH and len(take.time) > 1:
            touching = true_contact(take)
            found = stretches((decided_touches(take, rule) == Touch.ROUGH) & touching)
            bumps += len(found) - int(
                (take.time[found[1:, 0]] - take.time[found[:-1, 1] - 1] < BRIDGE).sum()
            )
            duration += float(touching.mean() * (take.time[-1] - take.time[0]))
    return 60 * bumps / duration if duration else float("nan")


def dips_per_minute(
    predictions: Iterable[TakePredictions], rule: DecisionRule
) -> float:
    """Dips per minute of true contact with rough surfaces; NaN without any."""
    dips = 0
    duration = 0.0
    for take in predictions:
        if take.recording.label is Touch.ROUGH and len(take.time) > 1:
            touching = true_contact(take)
            dips += count_dips(decided_touches(take, rule) == Touch.ROUGH, touching)
            duration += float(touching.mean() * (take.time[-1] - take.time[0]))
    return 60 * dips / duration if duration else float("nan")


def contact_delays(
    predictions: Iterable[TakePredictions], rule: DecisionRule, *, latency: float
) -> Delays:
    """Time from the first slide of each touch to the correct decision; only recordings
    with segments count.

    Recordings of more than one label, such as joined edges, are left out. Where sliding
    is not labelled, the time counts from the first touch. ``latency`` is from a
    window's end to its prediction, in s.
    """
    found = [
        _delay(take, start, end, take.recording.label, rule=rule)
        for take in predictions
        if take.recording.label is not None
        for start, end in _scored_touches(take.recording)
    ]
    return _delays(found, latency)


def _scored_touches(recording: Recording) -> Iterator[tuple[float, float]]:
    """Yield the first slide and the end (s) of each touch that follows no contact."""
    for before, segment in itertools.pairwise(recording.segments):
        begins = segment.contact and not before.contact
        if not begins or segment.label is None:
            continue
        start = first_slide(recording, segment.start, segment.end)
        if start is not None and segment.end - start >= SHORTEST_SCORED_TOUCH:
            yield start, segment.end


def edge_delays(
    predictions: Iterable[TakePredictions], rule: DecisionRule, *, latency: float
) -> Delays:
    """Time from each change between smooth and rough, without a lift-off between, to
    the correct decision.

    Edges on which the finger stops are left out, where sliding is labelled. Parameters
    as in :func:`contact_delays`.
    """
    found = []
    for take in predictions:
        for before, after in itertools.pairwise(take.recording.segments):
            changes = {before.label, after.label} == {Touch.SMOOTH, Touch.ROUGH}
            if changes and slides_over(take.recording, after.start):
                found.append(
                    _delay(take, after.start, after.end, after.label, rule=rule)
                )
    return _delays(found, latency)


def calibration_error(predictions: Iterable[TakePredictions]) -> float:
    """Expected calibration error: mean distance between P(rough) and the share truly
    rough, over `CALIBRATION_BINS`.

    Over updates in contact, by the two-class rule; NaN without any. Source: Guo et al.,
    ICML 2017, section 2.
    """
    takes = [
        (rough_score(take.probabilities[take.contact], "two-class"), take)
        for take in predictions
    ]
    share = np.concatenate([score for score, _ in takes])
    rough = np.concatenate(
        [np.full(len(score), take.recording.rough) for score, take in takes]
    )
    place = np.minimum((share * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    count = np.bincount(place, minlength=CALIBRATION_BINS)
    # Sums, not means: a bin's gap times its count, so that bins weigh as many windows
    # as they hold.
    gaps = np.abs(
        np.bincount(place, share, CALIBRATION_BINS)
        - np.bincount(place, rough, CALIBRATION_BINS)
    )
    return float(gaps.sum() / count.sum()) if count.sum() else float("nan")


def _delay(
    take: TakePredictions,
    start: float,
    until: float,
    label: Touch | None,
    *,
    rule: DecisionRule,
) -> float | None:
    here = (take.time > start) & (take.time <= until)
    time = take.time[here]
    correct = decided_touches(take, rule)[here] == label
    for begin, end in stretches(correct):
        # A correct stretch that the segment's end cuts short counts too: nothing
        # contradicts it.
        if time[end - 1] - time[begin] >= EVENT_HOLD or end == len(correct):
            return float(time[begin] - start)
    return None


def _delays(found: Sequence[float | None], latency: float) -> Delays:
    times = [delay + latency for delay in found if delay is not None]
    return Delays(np.array(times), len(found) - len(times))


def join_edges(recordings: Sequence[Recording], folder: Path) -> list[Recording]:
    """Join pairs of a smooth and a rough touch, in either order, and write them as
    FLAC; [] without both classes.

    The recordings are held out. The files are named by content and written once. Raises
    `ValueError` if the two recordings of a pair differ in sample rate.
    """
    pools = {label: list(_touches(recordings, label)) for label in SURFACE_LABELS}
    if not all(pools.values()):
        return []
    rng = np.random.default_rng(0)
    folder.mkdir(parents=True, exist_ok=True)
    edges = []
    for number in range(min(MOST_EDGES, 2 * min(map(len, pools.values())))):
        order = (
            (Touch.SMOOTH, Touch.ROUGH)
            if number % 2 == 0
            else (Touch.ROUGH, Touch.SMOOTH)
        )
        pair = [pools[label][int(rng.integers(len(pools[label])))] for label in order]
        if pair[0][0].channels == pair[1][0].channels:
            edges.append(_join(pair, order, folder))
    return edges


def felt_predictor(model: Model) -> Predictor:
    """Return a predictor of what a finger feels, as `recording_predictor`; at a joined
    edge contact begins over the noise of the recordings that it is joined from, since
    the little silence before it has none."""

    def predict(recording: Recording) -> TakePredictions:
        threshold = (
            edge_threshold_dbfs(recording, model.card.gate.rule)
            if SOURCES_KEY in recording.properties
            else None
        )
        return recording_predictor(model, threshold_dbfs=threshold)(recording)

    return predict


def edge_threshold_dbfs(edge: Recording, rule: LoudnessRule) -> float:
    """Return the contact threshold over the noise of the louder of the two recordings
    of an edge, in dBFS."""
    thresholds = []
    for path in edge.properties[SOURCES_KEY].split("\n"):
        with FileSource(Path(path)) as source:
            floor = measure_floor(
                list(source), sample_rate=source.sample_rate, rule=rule
            )
        thresholds.append(floor.threshold_dbfs if floor.known else LOWEST_DBFS)
    return max(thresholds)


def _touches(
    recordings: Sequence[Recording], label: Touch
) -> Iterator[tuple[Recording, float]]:
    """Each touch long enough, with the start in s of its middle part."""
    for recording in recordings:
        if recording.label is not label:
            continue
        touches = touches_of(recording)
        for start, end in (
            ((0.0, sound_info(recording.path).duration),)
            if touches is None
            else touches
        ):
            if end - start >= HALF + 0.1:
                yield recording, (start + end - HALF) / 2


def _join(
    pair: Sequence[tuple[Recording, float]], order: Sequence[Touch], folder: Path
) -> Recording:
    name = hashlib.sha256(
        repr(
            [_VERSION, *((str(recording.path), start) for recording, start in pair)]
        ).encode()
    ).hexdigest()[:16]
    path = folder / f"{name}.flac"
    first, second = (
        recording.read(start=start, duration=HALF) for recording, start in pair
    )
    rate = first.sample_rate
    if rate != second.sample_rate:
        raise ValueError(
            f"{pair[0][0].path} has {rate} Hz, {pair[1][0].path} {second.sample_rate} "
            "Hz: edges join equal rates"
        )
    if not path.is_file():
        with atomic_write(path) as unfinished:  # later runs take it for whole
            soundfile.write(
                unfinished,
                _fade(first.samples, second.samples, rate),
                rate,
                "PCM_16",
                format="FLAC",
            )
    middle = LEAD + HALF - EVENT_FADE / 2
    end = LEAD + 2 * HALF - EVENT_FADE
    segments = (
        Segment(0.0, LEAD, "none"),
        Segment(LEAD, middle, order[0].name.lower()),
        Segment(middle, end, order[1].name.lower()),
    )
    sources = {SOURCES_KEY: "\n".join(str(take.path) for take, _ in pair)}
    return Recording(
        path,
        f"{pair[0][0].surface} to {pair[1][0].surface}",
        None,
        pair[0][0].channels,
        segments=segments,
        properties=_motion(pair) | sources,
    )


def _motion(pair: Sequence[tuple[Recording, float]]) -> dict[str, str]:
    """The slides of the joined recording, if both recordings have them labelled."""
    places = (LEAD, LEAD + HALF - EVENT_FADE)
    cuts = [
        cut_slides(recording, start, start + HALF, place=place)
        for (recording, start), place in zip(pair, places, strict=True)
    ]
    if cuts[0] is None or cuts[1] is None:
        return {}
    # A slide that continues over the edge is one slide.
    last = cuts[0][-1:]
    first = cuts[1][:1]
    if last and first and first[0][0] <= last[0][1]:
        return {
            "slides": write_slides(
                (*cuts[0][:-1], (last[0][0], first[0][1]), *cuts[1][1:])
            )
        }
    return {"slides": write_slides((*cuts[0], *cuts[1]))}


def _fade(first: FloatArray, second: FloatArray, rate: int) -> FloatArray:
    """Fade in from silence, then cross-fade with constant power, because the two sounds
    are uncorrelated.

    Sound cut into digital silence would begin with a click that no finger makes.
    """
    size = round(EVENT_FADE * rate)
    angle = np.linspace(0, np.pi / 2, size, dtype=np.float32)[:, None]
    landing = first[:size] * np.sin(angle) ** 2
    crossing = first[-size:] * np.cos(angle) + second[:size] * np.sin(angle)
    silence = np.zeros((round(LEAD * rate), first.shape[1]), np.float32)
    return np.concatenate(
        (silence, landing, first[size:-size], crossing, second[size:])
    )
