"""Classifies a stream of sound, window by window, with a model.

The paper classifies the last 256 ms of both microphones at every sound buffer (section
III); this does so at the hop of the model's card. For each window: resample, cut,
compare the level, run the model's graph, decide. Predictions are bit-equal at any block
size.
"""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import ModelError
from tactophone.core.microphones import CONTACT, check_channels
from tactophone.core.types import (
    AudioBlock,
    ContactThreshold,
    FloatArray,
    Prediction,
)
from tactophone.signal.perception.contact import Contact
from tactophone.signal.perception.decision import Decision, Probabilities
from tactophone.signal.perception.fit import FitCheck
from tactophone.signal.perception.levels import loudness
from tactophone.signal.perception.model_file import (
    KINDS,
    SUPPORTS_MISSING_CHANNEL,
    Engine,
    Model,
    Samples,
)
from tactophone.signal.perception.no_touch import NoTouchCheck
from tactophone.signal.perception.resample import (
    RESAMPLER_LOWEST_RATE,
    Resampler,
    Window,
    Windower,
)

CERTAINLY_NONE: Probabilities = (1.0, 0.0, 0.0)

_NOWHERE = np.empty(0, np.intp)


class InvalidPositions:
    """Remembers where in a stream samples were removed as invalid.

    >>> invalid = InvalidPositions()
    >>> invalid.push(3, np.array([[False], [True], [False]]))
    >>> invalid.any_between(0, 2), invalid.any_between(2, 3)
    (True, False)
    """

    def __init__(self) -> None:
        self._found = _NOWHERE
        self._count = 0

    def push(self, size: int, invalid: NDArray[np.bool_] | None) -> None:
        """Take the mask of the next samples, as many as ``size``; ``None`` where all
        are valid."""
        if invalid is not None:
            here = np.flatnonzero(invalid.any(axis=1))
            self._found = np.concatenate((self._found, self._count + here))
        self._count += size

    def any_between(self, start: int, end: int) -> bool:
        """Whether any sample from ``start`` to before ``end`` was invalid.

        Call it in ascending order of ``start``: positions before it are dropped.
        """
        if self._found is _NOWHERE:
            return False
        self._found = self._found[np.searchsorted(self._found, start) :]
        return bool(len(self._found)) and bool(self._found[0] < end)


class WindowDetector:
    """Classifies a stream of sound, window by window, with a model of any kind.

    - ``model``: with one channel it uses the contact microphone, channel 0, unless its
      card says air. Some kinds are trained to do without the air channel; for them, one
      channel less counts as digital silence.
    - ``sample_rate``: of the sound to come, in Hz.
    - ``faults``: predictions withheld, by cause: ``sound`` (invalid samples in the
      window), ``model`` (its output was not a probability distribution).
    - ``threshold``: level from which there is contact; the model's own, until another
      is assigned.
    - ``margin_db``: how far under the threshold a window still counts as contact.
    - ``contact_at``: returns the state of the contact gate at a time in s, where there
      is a gate.
    - ``hop``, ``bandwidth``, ``latency``: seconds between two predictions; the highest
      frequency, in Hz, that the model uses; seconds from a window's end until it can be
      classified.
    - ``missing``: samples until the next window is complete.
    - ``fit``: says whether the sound fits the model, where it is not ``None``; it
      changes no prediction.
    - ``no_touch``: says whether the sound is no touch, where it is not ``None``; then
      rough is not rendered.
    - ``trace``: called with the features and the prediction of each window, where it is
      not ``None``: for fitting.

    Raises `ModelError` if the rate is too low, or this version cannot run the model.
    """

    def __init__(self, model: Model, *, sample_rate: int) -> None:
        if sample_rate < RESAMPLER_LOWEST_RATE:
            raise ModelError(
                f"sound at {sample_rate} Hz, but models need {RESAMPLER_LOWEST_RATE} "
                "Hz or more; "
                "record at a higher rate"
            )
        card = self.card = model.card
        if card.kind not in KINDS:
            raise ModelError(
                f"model {card.name} is of kind {card.kind}, but this version runs "
                f"{', '.join(KINDS)}; update Tactophone"
            )
        self.name = card.name
        self.hop = float(card.hop / card.sample_rate)
        self.bandwidth = card.sample_rate / 2
        self.faults: Counter[str] = Counter()
        self.threshold = ContactThreshold(card.gate.threshold_dbfs)
        self.margin_db = 0.0
        self.contact_at: Callable[[float], Contact] | None = None
        self.fit: FitCheck | None = None
        self.no_touch: NoTouchCheck | None = None
        self.trace: Callable[[FloatArray, Prediction], None] | None = None
        self._sample_rate = sample_rate
        self._decision = Decision(card.decision)
        self.network = model
        """Detectors of one network can have their windows classified together."""
        self._engine = Engine(model.session)
        self._memory = self._engine.new_state()
        """What the graph remembers of the touch."""
        self.reset()
        # Half the length of the low-pass, less a sample: the window ends *after* its
        # last sample, which is known once the low-pass has all around it.
        self.latency: float = (
            self._resampler.latency + 1 / sample_rate - 1 / card.sample_rate
        )

    @property
    def threshold_dbfs(self) -> float:
        """Level of a window from which there is contact now."""
        return self.threshold.dbfs - self.margin_db

    def reset(self) -> None:
        """Return to the initial state; the fault counts stay."""
        card = self.card
        self._invalid = InvalidPositions()
        self._resampler = Resampler(
            self._sample_rate, card.sample_rate, channels=card.channels
        )
        self._windower = Windower(card.window_size, card.hop, channels=card.channels)
        self._arrived: list[FloatArray] = []
        self.missing = self._resampler.missing_until(self._windower.next_end)
        self._decision.reset()
        self._memory[:] = 0
        if self.fit:
            self.fit.reset()
        if self.no_touch:
            self.no_touch.reset()

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound; return the predictions that it completes.

        Raises `ModelError` if the block has fewer channels than the model needs or over
        two, or another rate.
        """
        [predictions] = classify_windows([self], [self.take(block)])
        return predictions

    def take(self, block: AudioBlock) -> list[Window]:
        """Take sound; return the windows that it completes, oldest first.

        All of them must be given to `classify_windows` before the next block is taken.
        Raises `ModelError` as `push`.
        """
        if block.sample_rate != self._sample_rate:
            raise ModelError(
                f"sound at {block.sample_rate} Hz, but {self._sample_rate} Hz was "
                "announced; reopen the source"
            )
        samples = block.samples
        size, channels = samples.shape
        if channels > 2:
            check_channels(channels)
        if (
            channels < self.card.channels
            and self.card.kind not in SUPPORTS_MISSING_CHANNEL
        ):
            raise ModelError(
                f"sound with {channels} channel, but the model {self.card.name} needs "
                f"{self.card.channels} "
                "(contact and air); choose a one-channel model, such as paper-mono"
            )
        if self._arrived and self._arrived[0].shape[1] != channels:
            self._complete_windows()  # none: they fall due below
        invalid = block.invalid
        self._invalid.push(
            size, None if invalid is None else self._select_channels(invalid)
        )
        # Kept as it is until a window falls due: a packet is a quarter of a hop, and
        # each call on it costs.
        self._arrived.append(samples)
        self.missing -= size
        return self._complete_windows() if self.missing <= 0 else []

    def flush(self) -> list[Prediction]:
        windows = self._complete_windows() if self._arrived else []
        windows += self._windower.push(self._resampler.flush())
        [predictions] = classify_windows([self], [windows])
        return predictions

    def _complete_windows(self) -> list[Window]:
        """Resample all that arrived; return the windows that it completes."""
        samples = (
            self._arrived[0]
            if len(self._arrived) == 1
            else np.concatenate(self._arrived)
        )
        self._arrived = []
        samples = self._resampler.push(self._select_channels(samples))
        windows = self._windower.push(samples)
        self.missing = self._resampler.missing_until(self._windower.next_end)
        return windows

    def _select_channels(self, samples: Samples) -> Samples:
        missing = self.card.channels - samples.shape[1]
        if missing > 0:
            return np.pad(samples, ((0, 0), (0, missing)))
        return self.card.heard(samples)

    def _is_loud(self, sound: FloatArray, level_dbfs: float, end: int) -> bool:
        """Whether the level of a window, ``(channels, samples)``, says contact.

        ``end`` is the sample after its last one.
        """
        # As the gate stood when this window could be known, however many blocks later
        # it is read.
        gate = (
            self.contact_at(end / self.card.sample_rate + self.latency)
            if self.contact_at
            else None
        )
        threshold_dbfs = (
            gate.threshold_dbfs - self.margin_db if gate else self.threshold_dbfs
        )
        loud = level_dbfs >= threshold_dbfs
        if self.fit:
            self.fit.push(sound, touching=gate.touching if gate else loud)
        return loud

    def _decide(
        self,
        end: int,
        level_dbfs: float,
        loud: bool,
        probabilities: Probabilities,
        features: FloatArray,
    ) -> Prediction:
        """Return the prediction of the next window, from its level and what the graph
        returned."""
        faulty = self._is_faulty(end, probabilities)
        if faulty or (
            self.no_touch and self.no_touch.push(features, probabilities, loud=loud)
        ):
            probabilities = CERTAINLY_NONE
        if self.fit and loud:
            self.fit.hear(probabilities)
        contact = loud and not faulty
        touch, roughness = self._decision.decide(probabilities, contact=contact)
        start = (end - self.card.window_size) / self.card.sample_rate
        until = end / self.card.sample_rate
        prediction = Prediction(
            probabilities, touch, roughness, level_dbfs, start, until, faulty=faulty
        )
        if self.trace:
            self.trace(features, prediction)
        return prediction

    def _is_faulty(self, end: int, probabilities: Probabilities) -> bool:
        # The input samples that contribute to the window that ends before sample `end`
        # at the model's rate.
        ratio = self._sample_rate / self.card.sample_rate
        reach = self._resampler.reach
        first = int((end - self.card.window_size) * ratio) - reach
        last = int((end - 1) * ratio) + reach
        if self._invalid.any_between(first, last + 1):
            self.faults["sound"] += 1
            return True
        # Both comparisons with NaN are false; exp(log-softmax) in float32 sums to 1
        # within 1e-5.
        if not (abs(sum(probabilities) - 1) < 1e-3 and min(probabilities) >= 0):
            self.faults["model"] += 1
            return True
        return False


def classify_windows(
    detectors: Sequence[WindowDetector], windows: Sequence[Sequence[Window]]
) -> list[list[Prediction]]:
    """Classify the windows of one detector or of several, those of one network in one
    call; returns the predictions of each detector.

    A window computed in one call with others differs from what it is alone in the last
    bits of its probabilities, if at all.
    """
    predictions: list[list[Prediction]] = [[] for _ in detectors]
    # One window of each finger at a time, because what the graph remembers of a touch
    # depends on the windows before.
    for place in range(max(map(len, windows), default=0)):
        by_network: dict[object, list[int]] = {}
        for finger, own in enumerate(windows):
            if place < len(own):
                by_network.setdefault(detectors[finger].network, []).append(finger)
        for fingers in by_network.values():
            found = _classify_one_each(
                [detectors[finger] for finger in fingers],
                [windows[finger][place] for finger in fingers],
            )
            for finger, prediction in zip(fingers, found, strict=True):
                predictions[finger].append(prediction)
    return predictions


def _classify_one_each(
    detectors: Sequence[WindowDetector], windows: Sequence[Window]
) -> list[Prediction]:
    """Classify the next window of each detector, all of one network: its level,
    contact, the model's graph, the decision."""
    first = detectors[0]
    sound = [window.samples.T for window in windows]
    levels = loudness(first.card.gate.rule, [each[CONTACT] for each in sound])
    loud = [
        detector._is_loud(each, level_dbfs, window.end)
        for detector, each, level_dbfs, window in zip(
            detectors, sound, levels, windows, strict=True
        )
    ]
    answers = first._engine.run(
        sound, loud, [detector._memory for detector in detectors]
    )
    return [
        detector._decide(window.end, level_dbfs, is_loud, *answer)
        for detector, window, level_dbfs, is_loud, answer in zip(
            detectors, windows, levels, loud, answers, strict=True
        )
    ]
