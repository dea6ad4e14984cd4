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

from tactophone.perception.faults import FaultWatch, Kind, Reference, SensorFault
from tactophone.perception.judge import Judge
from tactophone.perception.shipped import open_judge, spare_model
from tactophone.types import AIR, CONTACT, AudioBlock, Detector, Prediction, Touch


class Answer(enum.IntEnum):
    """What is still done with the sound, from all to nothing."""

    JUDGE = 0
    ONE_CHANNEL = 1
    CONTACT_ONLY = 2
    SILENCE = 3


WORDS: Mapping[Answer, str] = MappingProxyType(
    {
        Answer.JUDGE: "",
        Answer.ONE_CHANNEL: "judging by the contact microphone alone",
        Answer.CONTACT_ONLY: "only contact is felt",
        Answer.SILENCE: "nothing is felt",
    }
)
"""What is done, for people."""

_ON_CONTACT: Mapping[Kind, Answer] = MappingProxyType({Kind.CLIPPED: Answer.CONTACT_ONLY})
_UNKNOWN = (0.0, 0.5, 0.5)


def answer_to(faults: Iterable[SensorFault], *, spare: bool) -> Answer:
    """Give the safe answer to faults: that of the worst.

    Parameters
    ----------
    faults
        What is wrong now.
    spare
        Whether there is a one-channel model to fall back to.

    Examples
    --------
    >>> answer_to([SensorFault(Kind.DEAD, AIR), SensorFault(Kind.CLIPPED, 0)], spare=True).name
    'CONTACT_ONLY'
    """
    alone = Answer.ONE_CHANNEL if spare else Answer.CONTACT_ONLY
    answers = [alone if one.channel == AIR else _ON_CONTACT.get(one.kind, Answer.SILENCE) for one in faults]
    return max(answers, default=Answer.JUDGE)


def guard(
    judge: Judge, *, sample_rate: int, channels: int, model: str = "paper", reference: Reference | None = None
) -> "GuardedJudge":
    """Guard a judge; with two microphones, one that hears the contact microphone alone stands by.

    Parameters
    ----------
    model
        That judges, by name or path.
    reference
        From the set-up's calibration; without one, faults are known less sharply.
    """
    name = spare_model(model) if channels > 1 else None
    spare = open_judge(name, sample_rate=sample_rate) if name else None
    if spare is not None:
        spare.threshold_dbfs = judge.threshold_dbfs
    return GuardedJudge(judge, spare, FaultWatch(sample_rate, reference))


class GuardedJudge:
    """A judge that never trusts a faulty microphone; has the same face as :class:`Judge`.

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

    def __init__(self, judge: Judge, spare: Judge | None, watch: FaultWatch) -> None:
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
    def answer(self) -> Answer:
        """What is done about it."""
        return answer_to(self._watch.faults, spare=self._spare is not None)

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
    def _active(self) -> Judge:
        if self._spare is not None and self.answer is Answer.ONE_CHANNEL:
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
        if self.answer is Answer.SILENCE:
            return replace(belief, touch=Touch.NONE, roughness=0.0, faulty=True)
        if self.answer is Answer.CONTACT_ONLY:
            touch = Touch.NONE if belief.touch is Touch.NONE else Touch.SMOOTH
            return replace(belief, touch=touch, roughness=0.0, probabilities=_UNKNOWN)
        return belief


AnyJudge: TypeAlias = Judge | GuardedJudge
"""With or without a guard."""
