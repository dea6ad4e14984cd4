"""Every detector: resample, window, extract features, ask the network, gate and decide, in that order.

At every sound buffer the paper looks at the last 256 ms of both microphones (section III). So does this, or in other
steps if the model says so, and gives one prediction each time, the same to the bit whatever the blocks in which the
sound arrives.
"""

from collections import Counter

import numpy as np

from tactophone.errors import ModelError
from tactophone.perception.decision import Decision, Probabilities
from tactophone.perception.features.extractors import EXTRACTORS, SUPPORTS_MISSING_CHANNEL, Extractor, level_of
from tactophone.perception.features.resample import LOWEST_RATE, Resampler
from tactophone.perception.features.windows import Windower
from tactophone.perception.inference.engine import open_engine
from tactophone.perception.model_file import Model, ModelCard
from tactophone.perception.sensor_health.invalid_samples import GarbageFilter
from tactophone.types import AIR, CONTACT, AudioBlock, FloatArray, Prediction

NOTHING_SURE: Probabilities = (1.0, 0.0, 0.0)


class WindowDetector:
    """Judges a stream of sound, window by window, with a model of any kind.

    Parameters
    ----------
    model
        With one channel it judges the contact microphone, channel 0, unless its card says air. Some kinds have learnt
        to do without the air channel; to them, one channel less counts as digital silence.
    sample_rate
        Of the sound to come, in Hz.

    Attributes
    ----------
    faults
        How often predictions were withheld: ``sound`` (garbage in the window), ``model`` (the answer was no
        probabilities).
    threshold_dbfs
        Level from which there is contact; the model's own, until another is assigned.
    """

    def __init__(self, model: Model, *, sample_rate: int) -> None:
        if sample_rate < LOWEST_RATE:
            raise ModelError(
                f"sound at {sample_rate} Hz, but models need {LOWEST_RATE} Hz or more; record at a higher rate"
            )
        self.card = model.card
        self.faults: Counter[str] = Counter()
        self.threshold_dbfs = model.card.gate.threshold_dbfs
        self._sample_rate = sample_rate
        self._hears_air = model.card.alone == "air"
        self._decision = Decision(model.card.decision)
        self._extractor = _extractor(model.card)
        self._engine = open_engine(model)
        self._level_of = level_of(self._extractor, model.card.gate.rule)
        self.reset()

    @property
    def name(self) -> str:
        """The model's own name."""
        return self.card.name

    @property
    def hop(self) -> float:
        """Seconds between two predictions."""
        return float(self.card.hop / self.card.sample_rate)

    @property
    def bandwidth(self) -> float:
        """The highest frequency, in Hz, that the model makes use of: half its rate."""
        return self.card.sample_rate / 2

    @property
    def latency(self) -> float:
        """Seconds from a window's end until it can be judged: half the low-pass.

        Less a sample: the window ends *after* its last sample, which is known once the low-pass has all around it.
        """
        return self._resampler.latency + 1 / self._sample_rate - 1 / self.card.sample_rate

    def reset(self) -> None:
        """Become as new; the fault counts stay."""
        card = self.card
        self._garbage = GarbageFilter()
        self._resampler = Resampler(self._sample_rate, card.sample_rate, channels=card.channels)
        self._windower = Windower(card.window_size, card.hop, channels=card.channels)
        self._decision.reset()
        self._extractor.reset()

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound in; give the predictions that it completes.

        Raises
        ------
        ModelError
            If the block has fewer channels than the model wants, or not the rate that was announced.
        """
        self._check(block)
        resampled = self._resampler.push(self._fit(self._garbage.clean(block).samples))
        return [self._judge(end, window) for end, window in self._windower.push(resampled)]

    def flush(self) -> list[Prediction]:
        """Give the predictions that only the end of the stream completes."""
        return [self._judge(end, window) for end, window in self._windower.push(self._resampler.flush())]

    def _check(self, block: AudioBlock) -> None:
        if block.sample_rate != self._sample_rate:
            raise ModelError(
                f"sound at {block.sample_rate} Hz, but {self._sample_rate} Hz was announced; reopen the source"
            )
        if block.channels < self.card.channels and self.card.kind not in SUPPORTS_MISSING_CHANNEL:
            raise ModelError(
                f"sound with {block.channels} channel, but the model {self.card.name} wants {self.card.channels} "
                "(contact and air); choose a one-channel model"
            )

    def _fit(self, samples: FloatArray) -> FloatArray:
        missing = self.card.channels - samples.shape[1]
        if missing > 0:
            return np.pad(samples, ((0, 0), (0, missing)))
        first = AIR if self._hears_air and missing else CONTACT
        return samples[:, first : first + self.card.channels]

    def _judge(self, end: int, window: FloatArray) -> Prediction:
        level_dbfs = self._level_of(window)
        loud = level_dbfs >= self.threshold_dbfs
        probabilities = self._engine.ask(self._extractor.push(window, contact=loud))
        faulty = self._is_faulty(end, probabilities)
        if faulty:
            probabilities = NOTHING_SURE
        contact = loud and not faulty
        touch, roughness = self._decision.decide(probabilities, contact=contact)
        start = (end - self.card.window_size) / self.card.sample_rate
        return Prediction(
            probabilities, touch, roughness, level_dbfs, start, end / self.card.sample_rate, faulty=faulty
        )

    def _is_faulty(self, end: int, probabilities: Probabilities) -> bool:
        if self._garbage.any_between(*self._heard(end)):
            self.faults["sound"] += 1
            return True
        # NaN fails both comparisons; exp(log-softmax) in float32 sums to 1 within 1e-5.
        if not (abs(sum(probabilities) - 1) < 1e-3 and min(probabilities) >= 0):
            self.faults["model"] += 1
            return True
        return False

    def _heard(self, end: int) -> tuple[int, int]:
        """The input samples that had a part in the window that ends before sample ``end`` at the model's rate."""
        ratio, reach = self._sample_rate / self.card.sample_rate, self._resampler.reach
        return int((end - self.card.window_size) * ratio) - reach, int((end - 1) * ratio) + reach + 1


def _extractor(card: ModelCard) -> Extractor:
    try:
        return EXTRACTORS[card.kind](card)
    except (KeyError, ValueError) as error:
        raise ModelError(f"model {card.name}: its settings cannot be used ({error}); export it again") from None
