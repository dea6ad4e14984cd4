"""Judging with microphones that may fail: each sensor fault has a safe answer, taken as soon as it is named.

What is left is used as far as it can be trusted: without a good air microphone the one-channel model judges; with a
contact microphone that clips, roughness is not to be had but contact is; where contact itself is in doubt, nothing is
felt. When the fault has healed, all is as before.
"""

import enum
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import TypeAlias

from tactophone.perception.model_registry import open_detector, spare_model
from tactophone.perception.sensor_health.faults import FaultWatch, Kind, Reference, SensorFault
from tactophone.perception.touch_detector import TouchDetector
from tactophone.types import AIR, CONTACT, AudioBlock, Detector, Prediction, Touch


class FallbackMode(enum.IntEnum):
    """What is still done with the sound, from all to nothing."""

    JUDGE = 0
    ONE_CHANNEL = 1
    CONTACT_ONLY = 2
    SILENCE = 3


WORDS: Mapping[FallbackMode, str] = MappingProxyType(
    {
        FallbackMode.JUDGE: "",
        FallbackMode.ONE_CHANNEL: "judging by the contact microphone alone",
        FallbackMode.CONTACT_ONLY: "only contact is felt",
        FallbackMode.SILENCE: "nothing is felt",
    }
)
"""What is done, for people."""

_ON_CONTACT: Mapping[Kind, FallbackMode] = MappingProxyType({Kind.CLIPPED: FallbackMode.CONTACT_ONLY})
_UNKNOWN = (0.0, 0.5, 0.5)


def fallback_for(faults: Iterable[SensorFault], *, spare: bool) -> FallbackMode:
    """Give the safe answer to faults: that of the worst.

    Parameters
    ----------
    faults
        What is wrong now.
    spare
        Whether there is a one-channel model to fall back to.

    Examples
    --------
    >>> fallback_for([SensorFault(Kind.DEAD, AIR), SensorFault(Kind.CLIPPED, 0)], spare=True).name
    'CONTACT_ONLY'
    """
    alone = FallbackMode.ONE_CHANNEL if spare else FallbackMode.CONTACT_ONLY
    answers = [alone if one.channel == AIR else _ON_CONTACT.get(one.kind, FallbackMode.SILENCE) for one in faults]
    return max(answers, default=FallbackMode.JUDGE)


def guard(
    judge: TouchDetector, *, sample_rate: int, channels: int, model: str = "paper", reference: Reference | None = None
) -> "FallbackDetector":
    """Guard a judge; with two microphones, one that hears the contact microphone alone stands by.

    Parameters
    ----------
    model
        That judges, by name or path.
    reference
        From the set-up's calibration; without one, faults are known less sharply.
    """
    name = spare_model(model) if channels > 1 else None
    spare = open_detector(name, sample_rate=sample_rate) if name else None
    if spare is not None:
        spare.threshold_dbfs = judge.threshold_dbfs
    return FallbackDetector(judge, spare, FaultWatch(sample_rate, reference))


class FallbackDetector:
    """A judge that never trusts a faulty microphone; has the same face as :class:`TouchDetector`.

    Parameters
    ----------
    judge
        For microphones that are well.
    spare
        Hears the contact microphone alone, for when the air microphone is not well; ``None`` if there is none, or only
        one microphone.
    watch
        Names the faults.
    """

    def __init__(self, judge: TouchDetector, spare: TouchDetector | None, watch: FaultWatch) -> None:
        self._judge, self._spare, self._watch = judge, spare, watch
        self._left = watch.cell_size
        self._next = 0

    @property
    def detector(self) -> Detector:
        """The one in use."""
        return self._active.detector

    @property
    def latency(self) -> float:
        """Seconds from the end of a belief's window to the moment of the belief."""
        return self._active.latency

    @property
    def sensor_faults(self) -> tuple[SensorFault, ...]:
        """What is wrong with the microphones now."""
        return self._watch.faults

    @property
    def answer(self) -> FallbackMode:
        """What is done about it."""
        return fallback_for(self._watch.faults, spare=self._spare is not None)

    @property
    def threshold_dbfs(self) -> float:
        """Level of contact; may be set at any time."""
        return self._judge.threshold_dbfs

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None:
        for judge in filter(None, (self._judge, self._spare)):
            judge.threshold_dbfs = level_dbfs

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound in; give the beliefs that it leads to, oldest first."""
        if block.start != self._next:
            self._watch.reset()
            self._left = self._watch.cell_size
        self._next = block.end
        return [belief for part in self._parts(block) for belief in self._push(part)]

    def flush(self) -> list[Prediction]:
        """Give what the end of the stream still completes."""
        return [self._revised(belief) for belief in self._active.flush()]

    def reset(self) -> None:
        """Become as new; fault counts stay."""
        self._watch.reset()
        self._left, self._next = self._watch.cell_size, 0
        for judge in filter(None, (self._judge, self._spare)):
            judge.reset()

    @property
    def _active(self) -> TouchDetector:
        if self._spare is not None and self.answer is FallbackMode.ONE_CHANNEL:
            return self._spare
        return self._judge

    def _parts(self, block: AudioBlock) -> Iterator[AudioBlock]:
        """Cut where the watch looks, so that an answer changes at the same sample whatever the blocks."""
        if block.concealed:
            yield block
            return
        start = 0
        while start < block.size:
            size = min(self._left, block.size - start)
            yield replace(block, samples=block.samples[start : start + size], start=block.start + start)
            start += size
            self._left = self._left - size or self._watch.cell_size

    def _push(self, part: AudioBlock) -> list[Prediction]:
        active = self._active
        # The first judge hears everything, so that once the fault has healed it goes on as if there had been none.
        beliefs = self._judge.push(part)
        if active is not self._judge:
            beliefs = active.push(replace(part, samples=part.samples[:, : CONTACT + 1]))
        revised = [self._revised(belief) for belief in beliefs]
        # A guess at lost sound says nothing of the microphones.
        if not part.concealed:
            self._watch.push(part)
        return revised

    def _revised(self, belief: Prediction) -> Prediction:
        if self.answer is FallbackMode.SILENCE:
            return replace(belief, touch=Touch.NONE, roughness=0.0, faulty=True)
        if self.answer is FallbackMode.CONTACT_ONLY:
            touch = Touch.NONE if belief.touch is Touch.NONE else Touch.SMOOTH
            return replace(belief, touch=touch, roughness=0.0, probabilities=_UNKNOWN)
        return belief


AnyTouchDetector: TypeAlias = TouchDetector | FallbackDetector
"""With or without a guard."""
