"""Puts touch events into the stream of predictions, each at the moment at which it became known."""

from collections.abc import Iterator
from dataclasses import replace

from tactophone.perception.events import EventDetector
from tactophone.types import AudioBlock, Prediction, Touch


class EventMerger:
    """Adds a prediction for each touch event: the newest one, moved up to the event, which it carries.

    A prediction that a window brings comes every 10 ms; an event must be rendered within 5 ms. Bit-equal at any block
    size, as events and predictions are ordered by when they became known.
    """

    def __init__(self, detector: EventDetector) -> None:
        self._detector = detector
        self.reset()

    def reset(self) -> None:
        """Return to the initial state."""
        self._detector.reset()
        self._newest = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, float("-inf"), start=0.0, end=0.0)

    def merge(self, block: AudioBlock, predictions: list[Prediction], *, latency: float) -> list[Prediction]:
        """Return a block's predictions, known ``latency`` s after their end, with those of its events."""
        return list(self._merged(block, predictions, latency))

    def _merged(self, block: AudioBlock, predictions: list[Prediction], latency: float) -> Iterator[Prediction]:
        waiting = list(predictions)
        for known, event in self._detector.push_timed(block):
            end = known - latency
            while waiting and waiting[0].end <= end:
                self._newest = waiting.pop(0)
                yield self._newest
            start = self._newest.start + end - self._newest.end
            yield replace(self._newest, start=start, end=end, events=(event,))
        for prediction in waiting:
            self._newest = prediction
            yield prediction
