"""Runs a detector over recordings, as the live system does; keeps its predictions, and
when the finger truly touched.

True contact comes from a recording's segments, or else from its own noise floor. A
person's recording seldom states its segments, and rests between its strokes. Counted as
touch, they would be scored as wrong: on 60 simulated takes the texture detector's
balanced accuracy fell from 0.90 to 0.81.
"""

import functools
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactophone.app.recordings import open_recording
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Intervals, Recording, stretches
from tactophone.core.types import SURFACE_LABELS, FloatArray, Prediction, Touch
from tactophone.signal.perception.contact import ContactGate
from tactophone.signal.perception.model_file import SUPPORTS_MISSING_CHANNEL, Model
from tactophone.signal.perception.noise_floor import measure_floor
from tactophone.signal.perception.window_detector import WindowDetector
from tactophone.signal.silences import TOUCH_HOLD
from tactophone_lab.evaluation.metrics import Rule, Scores, rough_score, sort_scores

LEAST_CONTACT = 0.1
"""Share of a recording under which what seemed its noise floor is an even slide: a
finger touches its surface."""


@dataclass(frozen=True, slots=True, eq=False)
class TakePredictions:
    """The predictions of a detector for one recording, an entry each update."""

    recording: Recording
    time: NDArray[np.float64]
    """End of each window, in s."""
    probabilities: FloatArray
    """float32, shape ``(updates, 3)``, in the order of :class:`tactophone.Touch`."""
    contact: NDArray[np.bool_]
    """Whether the contact gate was open."""
    touch: NDArray[np.int8] | None = None
    """What was rendered, int8, if it does not follow from the other fields and the
    decision rule alone."""
    unknown: NDArray[np.bool_] | None = None
    """Whether the evidence of the touch said neither smooth nor rough, as rendered, if
    evidence decided."""


Predictor = Callable[[Recording], TakePredictions]
"""Predicts a whole recording: a detector, or what a benchmark method has trained."""


def model_predictor(model: Model) -> Predictor:
    """Return a predictor of single windows: in contact from the threshold of the
    model's card on, and of no touch.

    Some models do without a missing air channel. What a finger feels is predicted by
    `recording_predictor`.
    """

    def predict(recording: Recording) -> TakePredictions:
        lacks_air = (
            model.card.kind in SUPPORTS_MISSING_CHANNEL
            and recording.read(duration=0).channels == 1
        )
        channels = 1 if lacks_air else model.card.channels
        detector: WindowDetector | None = None
        found: list[Prediction] = []
        for block in recording.blocks(channels=channels, single=model.card.microphone):
            detector = detector or WindowDetector(model, sample_rate=block.sample_rate)
            found += detector.push(block)
        return take_of(recording, [*found, *(detector.flush() if detector else [])])

    return predict


def recording_predictor(
    model: str | Model, *, threshold_dbfs: float | None = None
) -> Predictor:
    """Return a predictor that runs a model over the recordings of a data set as
    `tactophone feel` does.

    ``threshold_dbfs``: level from which there is contact, in dB of full scale; by
    default just over each recording's noise floor.
    """

    def predict(recording: Recording) -> TakePredictions:
        opened = open_recording(
            recording.path,
            model,
            channels=recording.picked,
            threshold_dbfs=threshold_dbfs,
        )
        card = opened.card
        if card and (opened.channels > 1 or card.kind not in SUPPORTS_MISSING_CHANNEL):
            # Raises where the manifest says that the file holds other microphones than
            # the model takes.
            recording.read(channels=card.channels, single=card.microphone, duration=0)
        found = [
            prediction for step in opened.steps() for prediction in step.predictions
        ]
        return take_of(recording, found, keep_touch=True)

    return predict


def felt_at_windows(windows: TakePredictions, felt: TakePredictions) -> TakePredictions:
    """Return predictions of single windows with what was felt at the end of each."""
    assert felt.touch is not None
    assert felt.unknown is not None
    # Of equal windows the times differ by rounding alone.
    newest = np.searchsorted(felt.time, windows.time + 1e-6, side="right") - 1
    before = newest < 0
    touch = np.where(before, Touch.NONE, felt.touch[newest]).astype(np.int8)
    unknown = ~before & felt.unknown[newest]
    return replace(windows, touch=touch, unknown=unknown)


def take_of(
    recording: Recording, found: Sequence[Prediction], *, keep_touch: bool = False
) -> TakePredictions:
    """Return the predictions for a recording; ``keep_touch`` keeps what they rendered,
    as a gate decides too."""
    touch = np.array([update.touch for update in found], np.int8)
    return TakePredictions(
        recording,
        np.array([update.end for update in found], np.float64),
        np.array([update.probabilities for update in found], np.float32).reshape(
            -1, len(Touch)
        ),
        touch != Touch.NONE,
        touch if keep_touch else None,
        np.array([update.unknown for update in found], bool) if keep_touch else None,
    )


def by_label(take: TakePredictions) -> list[TakePredictions]:
    """Return the predictions for a recording of several labels as one part a label, in
    contact in its segments alone.

    A recording with a label of its own is returned as it is.
    """
    if take.recording.label is not None:
        return [take]
    parts = []
    for label in SURFACE_LABELS:
        if segments := tuple(
            part for part in take.recording.segments if part.label is label
        ):
            inside = np.any(
                [
                    (take.time > part.start) & (take.time <= part.end)
                    for part in segments
                ],
                axis=0,
            )
            surface = f"{take.recording.surface}, {label.name.lower()}"
            recording = replace(
                take.recording, label=label, surface=surface, segments=segments
            )
            parts.append(
                replace(take, recording=recording, contact=take.contact & inside)
            )
    return parts


def scores_of(predictions: Iterable[TakePredictions], rule: Rule) -> Scores:
    """Score the updates in contact of all labelled recordings.

    Raises `DatasetError` if the contact gate never opened.
    """
    takes = [
        take for take in predictions if take.recording.labelled and take.contact.any()
    ]
    if not takes:
        raise DatasetError(
            "the contact gate never opened, so there is nothing to score: the "
            "recordings are quieter than the model's "
            "threshold; lower it (contact_threshold = 'off' in a recipe file opens it "
            "for good)"
        )
    names = tuple(sorted({take.recording.surface for take in takes}))
    number = {name: index for index, name in enumerate(names)}
    sizes = [int(take.contact.sum()) for take in takes]
    return sort_scores(
        np.concatenate(
            [rough_score(take.probabilities[take.contact], rule) for take in takes]
        ),
        rough=np.repeat([take.recording.rough for take in takes], sizes),
        surface=np.repeat([number[take.recording.surface] for take in takes], sizes),
        names=names,
    )


def true_contact(take: TakePredictions) -> NDArray[np.bool_]:
    """Whether the finger truly touches at each update.

    By the segments; where a recording has none, by the level over its own noise floor,
    whatever the model; throughout where it shows no floor, as a recording without a
    rest or an even slide.
    """
    touches = touches_of(take.recording)
    if touches is None:
        return np.ones(len(take.time), bool)
    inside = [(take.time > start) & (take.time <= end) for start, end in touches]
    return np.any(inside, axis=0) if inside else np.zeros(len(take.time), bool)


def in_true_contact(take: TakePredictions) -> TakePredictions:
    """Replace the contact gate by the true contact, so that all models are scored on
    the same moments."""
    return replace(take, contact=true_contact(take))


def touches_of(recording: Recording) -> Intervals | None:
    """Return the touches of a recording, by its segments or over its noise floor;
    ``None`` if it is all touch."""
    if recording.segments:
        return tuple(
            (part.start, part.end) for part in recording.segments if part.contact
        )
    return _audible_touches(recording) if recording.path.is_file() else None


@functools.lru_cache(maxsize=1 << 12)
def _audible_touches(recording: Recording) -> Intervals | None:
    """The stretches of one channel over its noise floor; ``None`` if it shows no floor,
    or next to nothing over it."""
    sound = recording.read(channels=1)
    floor = measure_floor([sound], sample_rate=sound.sample_rate, rule="banded")
    if not floor.known:
        return None
    gate = ContactGate(
        floor.threshold_dbfs,
        sample_rate=sound.sample_rate,
        rule="banded",
        hold=TOUCH_HOLD,
    )
    steps = gate.push(sound)
    duration = sound.size / sound.sample_rate
    # The gate reports each of its steps; a touch is a run of steps that touch.
    times = [*(step.time for step in steps), duration]
    touches = tuple(
        (times[at], times[end])
        for at, end in stretches(np.array([step.touching for step in steps], bool))
    )
    touched = sum(end - start for start, end in touches)
    return touches if touched > LEAST_CONTACT * duration else None
