"""Which of two objects is rougher: a recording of each in, an order and its probability
out."""

from collections.abc import Sequence
from dataclasses import dataclass

from tactophone.app.recordings import OpenRecording, Sound, open_recording
from tactophone.core.tips import DEFAULT_TIP
from tactophone.signal.perception.comparison import (
    LEAST_HEARD,
    MeanEvidence,
    probability_rougher,
)
from tactophone.signal.perception.decision import DecisionRule

SURE_FROM = 0.85
"""Probability from which an order is named. Under it, two simulated objects of one
class are no more often in the right order than not."""


@dataclass(frozen=True, slots=True)
class Comparison:
    """Which of two objects is rougher, and what that is taken from.

    Attributes
    ----------
    evidence
        Mean evidence for rough of the first object and of the second: from -3 (smooth)
        to 3 (rough) nats.
    seconds
        Touch that was heard of each.
    probability
        That the first is the rougher one: how often it was in pairs of *simulated*
        objects that differed as much. 0.5 if too little was heard.
    notes
        Sentences on what was corrected in the recordings, and on what does not fit the
        model.
    """

    evidence: tuple[float, float]
    seconds: tuple[float, float]
    probability: float
    notes: tuple[str, ...] = ()

    @property
    def rougher(self) -> int | None:
        """0 if the first is the rougher one, 1 if the second is; ``None`` where that is
        not sure."""
        if self.certainty < SURE_FROM:
            return None
        return 0 if self.probability > 0.5 else 1

    @property
    def certainty(self) -> float:
        """Probability of the likelier order, 0.5 to 1."""
        return max(self.probability, 1 - self.probability)

    @property
    def heard_enough(self) -> bool:
        """Whether enough touch was heard of both."""
        return min(self.seconds) >= LEAST_HEARD


def compare(
    first: Sound,
    second: Sound,
    model: str = "",
    *,
    sample_rate: float | None = None,
    tip: str = DEFAULT_TIP,
    channels: Sequence[int] = (),
) -> Comparison:
    """Say which of two objects is rougher, by a recording of strokes on each.

    Order survives what shifts the boundary between smooth and rough: microphones, gain,
    a room. So stroke both objects with one finger, in the same way.

    Parameters
    ----------
    first
        A WAV or FLAC file, an open file, or an array of samples; channel 0 is the
        contact microphone.
    second
        The other object, in the same way.
    model
        A shipped model's name, or a model file; empty: the one for ``tip``.
    sample_rate
        Of arrays, in Hz; a file knows its own.
    tip
        The kind of fingertip that was recorded.
    channels
        Which of the files' channels are contact and air, counted from 0; a file of more
        than two needs them.

    Raises
    ------
    TactophoneError
        As `open_recording` does.

    Examples
    --------
    ::

        found = tactophone.compare("slate.wav", "glass.wav")
        if found.rougher is None:
            print("not sure")
        else:
            print(("slate", "glass")[found.rougher], f"{found.certainty:.0%}")
    """
    recordings = [
        open_recording(
            sound, model, sample_rate=sample_rate, tip=tip, channels=channels
        )
        for sound in (first, second)
    ]
    one, other = (hear_object(recording) for recording in recordings)
    heard_enough = min(one.seconds, other.seconds) >= LEAST_HEARD
    difference = one.value - other.value if heard_enough else 0.0
    notes = [note for recording in recordings for note in recording.notes]
    return Comparison(
        (one.value, other.value),
        (one.seconds, other.seconds),
        probability_rougher(difference),
        tuple(dict.fromkeys(notes)),
    )


def hear_object(recording: OpenRecording) -> MeanEvidence:
    """Return the mean evidence of all touch in a recording."""
    mean = MeanEvidence(recording.card.decision if recording.card else DecisionRule())
    for step in recording.steps():
        for prediction in step.predictions:
            mean.push(prediction)
    return mean
