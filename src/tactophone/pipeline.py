"""The order of the stages, and nothing else: no thread, clock or device.

::

    robot     sound ─▶ Sender ─▶ datagrams              (with a judge: sound ─▶ belief ─▶ datagrams)
    operator  datagrams ─▶ Receiver ─▶ sound in order ─▶ Walk ─▶ Tick
    Walk      sound ─▶ Judge: detector, contact gate ─▶ belief ─▶ profile ─▶ limits ─▶ command

`feel`, the live system, the simulations and the benchmarks all run these; there is no second path.
"""

from collections.abc import Iterable

import numpy as np

from tactophone.link import Believed, Connected, Heard, News, ReceivingEnd, SendingEnd
from tactophone.link.sending import Datagrams
from tactophone.perception import AnyJudge
from tactophone.types import AudioBlock, Prediction, Tick
from tactophone.walk import Walk, open_walk

__all__ = ["Receiver", "Sender", "Walk", "open_walk"]

WIRE_RATE = 48_000
"""Samples a second of what crosses the line."""


class Sender:
    """The robot's walk: sound in; itself, or the belief of it alone, goes out through ``end``.

    Parameters
    ----------
    end
        Of the line; whoever owns the socket also feeds it what arrives, lets it poll, and fetches its datagrams.
    judge
        Judges here, for lines that cannot carry sound; ``None`` sends the sound.
    """

    def __init__(self, end: SendingEnd, judge: AnyJudge | None = None) -> None:
        self.end, self.judge = end, judge

    def push(self, block: AudioBlock) -> Tick:
        """Take sound in and send what is to be sent of it; give what was believed here."""
        if self.judge is None:
            self.end.push(block)
            return Tick(block, (), ())
        beliefs = tuple(self.judge.push(block))
        for belief in beliefs:
            self.end.tell(belief)
        return Tick(block, beliefs, ())


class Receiver:
    """The operator's walk: datagrams in, ticks out, judged on arrival.

    What is too old to be felt still goes through the detector, whose next window wants it, but no belief and no command
    comes of it.
    """

    def __init__(self, end: ReceivingEnd, walk: Walk) -> None:
        self.end, self.walk = end, walk

    def receive(self, datagrams: Datagrams, *, now: float) -> list[Tick]:
        """Take all that has come by ``now``; give what it leads to, oldest first."""
        return self._ticks(self.end.receive(datagrams, now=now))

    def poll(self, now: float) -> list[Tick]:
        """Let time pass; call it when nothing came for a packet's length, and twenty times a second at least."""
        return self._ticks(self.end.poll(now))

    def _ticks(self, news: Iterable[News]) -> list[Tick]:
        return [tick for one in news if (tick := self.take(one))]

    def take(self, news: News) -> Tick | None:
        """Walk on with one thing that the line's end has given, for who fetches it himself; ``None`` when no sound."""
        match news:
            case Heard(block, stale):
                tick = self.walk.push(block)
                return Tick(block, (), ()) if stale else tick
            case Believed(belief, stale):
                felt = () if stale else (self.walk.feel(belief),)
                return Tick(_silent_block(belief), (belief,), felt)
            case Connected():
                self.walk.reset()
        return None


def _silent_block(belief: Prediction) -> AudioBlock:
    """Stand for sound that stayed with the robot: nothing, at the belief's time."""
    return AudioBlock(np.zeros((0, 1), np.float32), WIRE_RATE, round(belief.end * WIRE_RATE))
