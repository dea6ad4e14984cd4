"""The order of the stages, and nothing else: no thread, clock or device.

::

    robot     sound ─▶ RobotEndpoint ─▶ datagrams              (with a judge: sound ─▶ belief ─▶ datagrams)
    operator  datagrams ─▶ OperatorEndpoint ─▶ sound in order ─▶ Pipeline ─▶ PipelineStep
    Pipeline      sound ─▶ TouchDetector: detector, contact gate ─▶ belief ─▶ profile ─▶ limits ─▶ command

`feel`, the live system, the simulations and the benchmarks all run these; there is no second path.
"""

from collections.abc import Iterable

import numpy as np

from tactophone.link import Connected, DecodedAudio, PredictionReceived, ReceiveEvent, ReceiveSession, SendSession
from tactophone.link.send_session import Datagrams
from tactophone.perception import AnyTouchDetector
from tactophone.pipeline import Pipeline, open_pipeline
from tactophone.types import AudioBlock, PipelineStep, Prediction

__all__ = ["OperatorEndpoint", "Pipeline", "RobotEndpoint", "open_pipeline"]

WIRE_RATE = 48_000
"""Samples a second of what crosses the line."""


class RobotEndpoint:
    """The robot's walk: sound in; itself, or the belief of it alone, goes out through ``end``.

    Parameters
    ----------
    end
        Of the line; whoever owns the socket also feeds it what arrives, lets it poll, and fetches its datagrams.
    judge
        Judges here, for lines that cannot carry sound; ``None`` sends the sound.
    """

    def __init__(self, end: SendSession, judge: AnyTouchDetector | None = None) -> None:
        self.end, self.judge = end, judge

    def push(self, block: AudioBlock) -> PipelineStep:
        """Take sound in and send what is to be sent of it; give what was believed here."""
        if self.judge is None:
            self.end.push(block)
            return PipelineStep(block, (), ())
        beliefs = tuple(self.judge.push(block))
        for belief in beliefs:
            self.end.tell(belief)
        return PipelineStep(block, beliefs, ())


class OperatorEndpoint:
    """The operator's walk: datagrams in, ticks out, judged on arrival.

    What is too old to be felt still goes through the detector, whose next window wants it, but no belief and no command
    comes of it.
    """

    def __init__(self, end: ReceiveSession, walk: Pipeline) -> None:
        self.end, self.walk = end, walk

    def receive(self, datagrams: Datagrams, *, now: float) -> list[PipelineStep]:
        """Take all that has come by ``now``; give what it leads to, oldest first."""
        return self._ticks(self.end.receive(datagrams, now=now))

    def poll(self, now: float) -> list[PipelineStep]:
        """Let time pass; call it when nothing came for a packet's length, and twenty times a second at least."""
        return self._ticks(self.end.poll(now))

    def _ticks(self, news: Iterable[ReceiveEvent]) -> list[PipelineStep]:
        return [tick for one in news if (tick := self.take(one))]

    def take(self, news: ReceiveEvent) -> PipelineStep | None:
        """Pipeline on with one thing that the line's end has given, for who fetches it himself; ``None`` when no sound."""
        match news:
            case DecodedAudio(block, stale):
                tick = self.walk.push(block)
                return PipelineStep(block, (), ()) if stale else tick
            case PredictionReceived(belief, stale):
                felt = () if stale else (self.walk.feel(belief),)
                return PipelineStep(_silent_block(belief), (belief,), felt)
            case Connected():
                self.walk.reset()
        return None


def _silent_block(belief: Prediction) -> AudioBlock:
    """Stand for sound that stayed with the robot: nothing, at the belief's time."""
    return AudioBlock(np.zeros((0, 1), np.float32), WIRE_RATE, round(belief.end * WIRE_RATE))
