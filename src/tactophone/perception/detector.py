"""The window detector: resample, window, extract features, run the network, compare the level, decide.

At every sound buffer the paper classifies the last 256 ms of both microphones (section III). So does this, or at
another hop if the model's card says so, with one prediction each; predictions are bit-equal at any block size.
"""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np

from tactophone.errors import ModelError
from tactophone.perception.batching import Processing, process_together
from tactophone.perception.decision import Decision, Probabilities
from tactophone.perception.features.extractors import EXTRACTORS, SUPPORTS_MISSING_CHANNEL, Extractor, level_meter
from tactophone.perception.features.resample import LOWEST_RATE, Resampler
from tactophone.perception.features.windows import Windower
from tactophone.perception.inference import Engine
from tactophone.perception.model_file import Model, ModelCard
from tactophone.perception.noise_floor import NoiseFloor
from tactophone.perception.sensor_health.invalid_samples import InvalidSampleFilter
from tactophone.types import AIR, CONTACT, AudioBlock, FloatArray, Prediction

CERTAINLY_NONE: Probabilities = (1.0, 0.0, 0.0)


class WindowDetector:
    """Classifies a stream of sound, window by window, with a model of any kind.

    Parameters
    ----------
    model
        With one channel it uses the contact microphone, channel 0, unless its card says air. Some kinds are trained to
        do without the air channel; for them, one channel less counts as digital silence.
    sample_rate
        Of the sound to come, in Hz.

    Attributes
    ----------
    faults
        Predictions withheld, by cause: ``sound`` (invalid samples in the window), ``model`` (its output was not a
        probability distribution).
    threshold_dbfs
        Level from which there is contact; the model's own, until another is assigned.
    floor
        Where there is one, the threshold follows it, until another threshold is assigned.

    trace
        Called with the features and the prediction of each window, where it is not ``None``: for fitting.

    Raises
    ------
    ModelError
        If the rate is too low, or this version cannot run the model.
    """

    def __init__(self, model: Model, *, sample_rate: int) -> None:
        if sample_rate < LOWEST_RATE:
            raise ModelError(
                f"sound at {sample_rate} Hz, but models need {LOWEST_RATE} Hz or more; record at a higher rate"
            )
        self.card = model.card
        self.faults: Counter[str] = Counter()
        self.floor: NoiseFloor | None = None
        self.trace: Callable[[FloatArray, Prediction], None] | None = None
        self.threshold_dbfs = model.card.gate.threshold_dbfs
        self._sample_rate = sample_rate
        self._decision = Decision(model.card.decision)
        self._extractor = _open_extractor(model.card)
        self.network = model
        """Detectors of one network compute their windows together."""
        self._engine = Engine(model.session)
        self.describe, self.classify = self._extractor.describe, self._engine.run
        self._check_width()
        self._level_of = level_meter(self._extractor, model.card.gate.rule)
        self.reset()

    @property
    def threshold_dbfs(self) -> float:
        """Level from which there is contact; may be assigned at any time, and then follows nothing."""
        return self.floor.threshold_dbfs if self.floor else self._threshold_dbfs

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None:
        self.floor, self._threshold_dbfs = None, level_dbfs

    @property
    def name(self) -> str:
        """The model's name."""
        return self.card.name

    @property
    def hop(self) -> float:
        """Seconds between two predictions."""
        return float(self.card.hop / self.card.sample_rate)

    @property
    def bandwidth(self) -> float:
        """The highest frequency, in Hz, that the model uses: half its rate."""
        return self.card.sample_rate / 2

    @property
    def latency(self) -> float:
        """Seconds from a window's end until it can be classified: half the length of the low-pass.

        Less a sample: the window ends *after* its last sample, which is known once the low-pass has all around it.
        """
        return self._resampler.latency + 1 / self._sample_rate - 1 / self.card.sample_rate

    def reset(self) -> None:
        """Return to the initial state; the fault counts stay."""
        card = self.card
        self._invalid_samples = InvalidSampleFilter()
        self._resampler = Resampler(self._sample_rate, card.sample_rate, channels=card.channels)
        self._windower = Windower(card.window_size, card.hop, channels=card.channels)
        self._arrived: list[FloatArray] = []
        self._missing = self._resampler.missing_until(self._windower.next_end)
        self._decision.reset()
        self._extractor.reset()
        if self.floor:
            self.floor.reset()

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound; return the predictions that it completes.

        Raises
        ------
        ModelError
            If the block has fewer channels than the model needs, or not the announced rate.
        """
        return process_together([self.process(block)])[0]

    def process(self, block: AudioBlock) -> Processing:
        """Do as :meth:`push`, one of several detectors (`tactophone.perception.batching`)."""
        if block.sample_rate != self._sample_rate:
            raise ModelError(
                f"sound at {block.sample_rate} Hz, but {self._sample_rate} Hz was announced; reopen the source"
            )
        samples = block.samples
        size, channels = samples.shape
        if channels < self.card.channels and self.card.kind not in SUPPORTS_MISSING_CHANNEL:
            raise ModelError(
                f"sound with {channels} channel, but the model {self.card.name} needs {self.card.channels} "
                "(contact and air); choose a one-channel model"
            )
        if self._arrived and self._arrived[0].shape[1] != channels:
            self._complete_windows()  # none: they fall due below
        # Kept as it is until a window falls due: a packet is a quarter of a hop, and each call on it costs.
        self._arrived.append(samples)
        self._missing -= size
        if self._missing > 0 or not (windows := self._complete_windows()):
            return []
        return (yield self, windows)

    def flush(self) -> list[Prediction]:
        """Return the predictions that only the end of the stream completes."""
        return process_together([self._process_end()])[0]

    def _process_end(self) -> Processing:
        windows = self._complete_windows() if self._arrived else []
        windows += self._windower.push(self._resampler.flush())
        return (yield self, windows) if windows else []

    def _complete_windows(self) -> list[tuple[int, FloatArray]]:
        """Resample all that arrived; return the windows that it completes."""
        samples = self._arrived[0] if len(self._arrived) == 1 else np.concatenate(self._arrived)
        self._arrived = []
        samples = self._select_channels(self._invalid_samples.clean(samples))
        windows = self._windower.push(self._resampler.push(samples))
        self._missing = self._resampler.missing_until(self._windower.next_end)
        return windows

    def _check_width(self) -> None:
        """Raise `ModelError` if the network does not take as many features as its kind computes."""
        windows = np.zeros((1, self.card.window_size, self.card.channels), np.float32)
        found = self._extractor.push(self.describe(windows)[0], contact=False).shape
        if found != (self._engine.width,):
            raise ModelError(
                f"model {self.card.name}: its network takes {self._engine.width} features, but its kind "
                f"{self.card.kind} has {found[0]} of such windows; export it again"
            )

    def _select_channels(self, samples: FloatArray) -> FloatArray:
        missing = self.card.channels - samples.shape[1]
        if missing > 0:
            return np.pad(samples, ((0, 0), (0, missing)))
        first = AIR if missing and self.card.microphone == "air" else CONTACT
        return samples[:, first : first + self.card.channels]

    def measure(self, window: FloatArray, description: Any) -> tuple[float, bool, FloatArray]:
        """Return a window's level, whether that is contact, and the features of the touch so far."""
        level_dbfs = self._level_of(window, description)
        loud = level_dbfs >= self.threshold_dbfs
        if self.floor:
            self.floor.push(level_dbfs, touching=loud)
        return level_dbfs, loud, self._extractor.push(description, contact=loud)

    def decide(
        self, end: int, probabilities: Probabilities, level_dbfs: float, loud: bool, features: FloatArray
    ) -> Prediction:
        """Return the prediction of the next window, from the model's probabilities and what :meth:`measure` found."""
        faulty = self._is_faulty(end, probabilities)
        if faulty:
            probabilities = CERTAINLY_NONE
        touch, roughness = self._decision.decide(probabilities, contact=loud and not faulty)
        start = (end - self.card.window_size) / self.card.sample_rate
        prediction = Prediction(
            probabilities, touch, roughness, level_dbfs, start, end / self.card.sample_rate, faulty=faulty
        )
        if self.trace:
            self.trace(features, prediction)
        return prediction

    def _is_faulty(self, end: int, probabilities: Probabilities) -> bool:
        # The input samples that contribute to the window that ends before sample `end` at the model's rate.
        ratio, reach = self._sample_rate / self.card.sample_rate, self._resampler.reach
        first, last = int((end - self.card.window_size) * ratio) - reach, int((end - 1) * ratio) + reach
        if self._invalid_samples.any_between(first, last + 1):
            self.faults["sound"] += 1
            return True
        # Both comparisons with NaN are false; exp(log-softmax) in float32 sums to 1 within 1e-5.
        if not (abs(sum(probabilities) - 1) < 1e-3 and min(probabilities) >= 0):
            self.faults["model"] += 1
            return True
        return False


def _open_extractor(card: ModelCard) -> Extractor:
    if card.kind not in EXTRACTORS:
        raise ModelError(
            f"model {card.name} is of kind {card.kind}, but this version runs {', '.join(EXTRACTORS)}; "
            "update Tactophone"
        )
    try:
        return EXTRACTORS[card.kind](card)
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        raise ModelError(f"model {card.name}: its settings cannot be used ({error}); export it again") from None
