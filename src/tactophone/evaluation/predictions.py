"""Runs a detector over recordings, as the live system would, and keeps what it said of each."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset import Recording, channel_order
from tactophone.errors import DatasetError
from tactophone.evaluation.metrics import Rule, Scores, collect, rough_score
from tactophone.perception import SUPPORTS_MISSING_CHANNEL, Model, detector_for
from tactophone.types import AudioBlock, Detector, FloatArray, Prediction, Touch

READ_SIZE = 1 << 16
"""Samples read at once; detectors give the same predictions at any block size."""


@dataclass(frozen=True, slots=True, eq=False)
class TakePredictions:
    """What a detector said of one recording, an entry each update.

    Parameters
    ----------
    recording
        What was judged, with its label.
    time
        End of each window, in s.
    probabilities
        float32, shape ``(updates, 3)``, in the order of ``Touch``.
    contact
        Whether the contact gate was open.
    """

    recording: Recording
    time: NDArray[np.float64]
    probabilities: FloatArray
    contact: NDArray[np.bool_]


Judge = Callable[[Recording], TakePredictions]
"""Whoever can judge a recording: a detector made ready, or a method that was trained."""


def predictor_of(opened: Callable[[int], Detector], *, channels: int) -> Judge:
    """Make a judge of streaming detectors.

    Parameters
    ----------
    opened
        Gives a fresh detector for sound of a sample rate, in Hz.
    channels
        How many it hears; the recording's own order is put right.
    """

    def judge(recording: Recording) -> TakePredictions:
        return predict_take(recording, _predict(opened, recording, channel_order(recording, wanted=channels)))

    return judge


def predictor_for(model: Model) -> Judge:
    """Make a judge of a model, run as the live system runs it: some do without the air channel where there is none."""

    def judge(recording: Recording) -> TakePredictions:
        lacks = model.card.kind in SUPPORTS_MISSING_CHANNEL and len(recording.channels) == 1
        channels = 1 if lacks else model.card.channels
        order = channel_order(recording, wanted=channels, alone=model.card.alone)
        return predict_take(recording, _predict(lambda rate: detector_for(model, sample_rate=rate), recording, order))

    return judge


def _predict(opened: Callable[[int], Detector], recording: Recording, order: tuple[int, ...]) -> list[Prediction]:
    predictions: list[Prediction] = []
    try:
        with soundfile.SoundFile(recording.path) as file:
            if max(order) >= file.channels:
                raise DatasetError(
                    f"{recording.path}: has {file.channels} channel, but the model hears {len(order)}; "
                    "take a one-channel model"
                )
            detector, start = opened(file.samplerate), 0
            for samples in file.blocks(READ_SIZE, dtype="float32", always_2d=True):
                sound = np.ascontiguousarray(samples[:, order])
                predictions += detector.push(AudioBlock(sound, file.samplerate, start))
                start += len(samples)
    except (soundfile.LibsndfileError, OSError) as error:
        raise DatasetError(
            f"{recording.path}: cannot be read as sound ({error}); run `tactophone dataset check`"
        ) from error
    return predictions + detector.flush()


def predict_take(recording: Recording, predictions: Sequence[Prediction]) -> TakePredictions:
    """Turn predictions into arrays."""
    return TakePredictions(
        recording,
        np.array([one.end for one in predictions], np.float64),
        np.array([one.probabilities for one in predictions], np.float32).reshape(-1, len(Touch)),
        np.array([one.touch is not Touch.NONE for one in predictions], bool),
    )


def scores_of(judgements: Iterable[TakePredictions], rule: Rule) -> Scores:
    """Score the updates in contact of all labelled recordings.

    Raises
    ------
    DatasetError
        If the gate was never open.
    """
    kept = [one for one in judgements if one.recording.label in (Touch.SMOOTH, Touch.ROUGH) and one.contact.any()]
    if not kept:
        raise DatasetError(
            "the contact gate never opened, so there is nothing to score: the recordings are quieter than the model's "
            "threshold; lower it (--gate off opens it for good)"
        )
    names = tuple(sorted({one.recording.surface for one in kept}))
    number = {name: index for index, name in enumerate(names)}
    sizes = [int(one.contact.sum()) for one in kept]
    return collect(
        np.concatenate([rough_score(one.probabilities[one.contact], rule) for one in kept]),
        rough=np.repeat([one.recording.label is Touch.ROUGH for one in kept], sizes),
        surface=np.repeat([number[one.recording.surface] for one in kept], sizes),
        names=names,
    )
