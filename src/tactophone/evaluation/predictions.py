"""Runs a detector over recordings, as the live system does, and keeps its predictions."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset import Recording, channel_order
from tactophone.errors import DatasetError
from tactophone.evaluation.metrics import Rule, Scores, rough_score, sort_scores
from tactophone.perception import (
    SUPPORTS_MISSING_CHANNEL,
    Model,
    TouchDetector,
    WindowDetector,
    measure_floor,
    with_gate,
)
from tactophone.types import AudioBlock, Detector, FloatArray, Prediction, Touch

READ_SIZE = 1 << 16
"""Samples read at once; detectors return the same predictions at any block size."""


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
    """What was rendered, int8, if it does not follow from the other fields and the decision rule alone."""


Predictor = Callable[[Recording], TakePredictions]
"""Predicts a whole recording: a detector, or what a benchmark method has trained."""


def streaming_predictor(open_detector: Callable[[int], Detector], *, channels: int) -> Predictor:
    """Return a predictor that runs a fresh streaming detector of so many channels over each recording."""

    def predict(recording: Recording) -> TakePredictions:
        return as_arrays(recording, _stream(open_detector, recording, channel_order(recording, count=channels)))

    return predict


def model_predictor(model: Model, *, own_floor: bool = False) -> Predictor:
    """Return a predictor that runs a model as the live system does; some models do without a missing air channel.

    With ``own_floor`` the contact threshold is just over each recording's own noise floor and the fast contact gate
    decides, as in `tactophone feel`; otherwise the threshold is the model's, and whole windows decide.
    """

    def predict(recording: Recording) -> TakePredictions:
        lacks_air = model.card.kind in SUPPORTS_MISSING_CHANNEL and len(recording.channels) == 1
        channels = 1 if lacks_air else model.card.channels
        order = channel_order(recording, count=channels, single=model.card.microphone)

        def open_gated(rate: int) -> TouchDetector:
            detector = with_gate(WindowDetector(model, sample_rate=rate), sample_rate=rate)
            detector.threshold_dbfs = _floor_threshold(recording, order, model)
            return detector

        if not own_floor:
            return as_arrays(recording, _stream(lambda rate: WindowDetector(model, sample_rate=rate), recording, order))
        predictions = _stream(open_gated, recording, order)
        return replace(
            as_arrays(recording, predictions), touch=np.array([update.touch for update in predictions], np.int8)
        )

    return predict


def _floor_threshold(recording: Recording, order: tuple[int, ...], model: Model) -> float:
    """The threshold of a recording, from the channel that the model detects contact with."""
    with soundfile.SoundFile(recording.path) as file:
        rate = file.samplerate
        samples = file.read(dtype="float32", always_2d=True)[:, order[:1]]
    block = AudioBlock(np.ascontiguousarray(samples), rate, 0)
    return measure_floor([block], sample_rate=rate, rule=model.card.gate.rule).threshold_dbfs


def _stream(
    open_detector: Callable[[int], Detector | TouchDetector], recording: Recording, order: tuple[int, ...]
) -> list[Prediction]:
    predictions: list[Prediction] = []
    try:
        with soundfile.SoundFile(recording.path) as file:
            if max(order) >= file.channels:
                raise DatasetError(
                    f"{recording.path}: has {file.channels} channel, but the model takes {len(order)}; "
                    "use a one-channel model"
                )
            detector, start = open_detector(file.samplerate), 0
            for samples in file.blocks(READ_SIZE, dtype="float32", always_2d=True):
                sound = np.ascontiguousarray(samples[:, order])
                predictions += detector.push(AudioBlock(sound, file.samplerate, start))
                start += len(samples)
    except (soundfile.LibsndfileError, OSError) as error:
        raise DatasetError(
            f"{recording.path}: cannot be read as sound ({error}); run `tactophone dataset check`"
        ) from error
    return predictions + detector.flush()


def as_arrays(recording: Recording, predictions: Sequence[Prediction]) -> TakePredictions:
    """Turn streamed predictions into arrays."""
    return TakePredictions(
        recording,
        np.array([update.end for update in predictions], np.float64),
        np.array([update.probabilities for update in predictions], np.float32).reshape(-1, len(Touch)),
        np.array([update.touch is not Touch.NONE for update in predictions], bool),
    )


def scores_of(predictions: Iterable[TakePredictions], rule: Rule) -> Scores:
    """Score the updates in contact of all labelled recordings.

    Raises `DatasetError` if the contact gate never opened.
    """
    takes = [take for take in predictions if take.recording.label in (Touch.SMOOTH, Touch.ROUGH) and take.contact.any()]
    if not takes:
        raise DatasetError(
            "the contact gate never opened, so there is nothing to score: the recordings are quieter than the model's "
            "threshold; lower it (--contact-threshold off opens it for good)"
        )
    names = tuple(sorted({take.recording.surface for take in takes}))
    number = {name: index for index, name in enumerate(names)}
    sizes = [int(take.contact.sum()) for take in takes]
    return sort_scores(
        np.concatenate([rough_score(take.probabilities[take.contact], rule) for take in takes]),
        rough=np.repeat([take.recording.label is Touch.ROUGH for take in takes], sizes),
        surface=np.repeat([number[take.recording.surface] for take in takes], sizes),
        names=names,
    )
