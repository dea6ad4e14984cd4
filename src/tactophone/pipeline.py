"""The order of the stages, and nothing else: no thread, clock or device.

::

    robot     sound ─▶ Sender ─▶ datagrams              (with a judge: sound ─▶ belief ─▶ datagrams)
    operator  datagrams ─▶ Receiver ─▶ sound in order ─▶ Walk ─▶ Tick
    Walk      sound ─▶ Judge: detector, contact gate ─▶ belief ─▶ profile ─▶ limits ─▶ command

`feel`, the live system, the simulations and the benchmarks all run these; there is no second path.
"""

from collections import Counter
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from tactophone.haptics import Limits, open_profile
from tactophone.link import Believed, Connected, Heard, News, ReceivingEnd, SendingEnd
from tactophone.link.sending import Datagrams
from tactophone.perception import ContactGate, Judge, default_model, open_detector
from tactophone.types import AudioBlock, HapticCommand, Prediction, Profile, Tick

WIRE_RATE = 48_000
"""Samples a second of what crosses the line."""


class Walk:
    """Sound to what is felt: an `AudioBlock` in, a `Tick` out.

    Parameters
    ----------
    judge
        Makes beliefs of the sound.
    profile, limits
        Make a command of a belief; others may be assigned at any time.

    Examples
    --------
    ::

        walk = open_walk(sample_rate=48_000, channels=2)
        for block in source:
            tick = walk.push(block)
            if tick.command:
                oscillator.submit(tick.command)
    """

    def __init__(self, judge: Judge, profile: Profile, limits: Limits | None = None) -> None:
        self.judge, self.profile, self.limits = judge, profile, limits or Limits()

    @property
    def faults(self) -> Counter[str]:
        """How often there was silence for want of a belief, by cause: ``sound`` or ``model`` was garbage."""
        return self.judge.detector.faults

    def push(self, block: AudioBlock) -> Tick:
        """Take sound in; give what it leads to."""
        return self._tick(block, self.judge.push(block))

    def flush(self, block: AudioBlock) -> Tick:
        """Give what the end of the stream still completes; ``block`` is its last one."""
        return self._tick(replace(block, samples=block.samples[:0], start=block.end), self.judge.flush())

    def reset(self) -> None:
        """Become as new; fault counts stay."""
        self.judge.reset()

    def feel(self, prediction: Prediction) -> HapticCommand:
        """Give the command that a belief asks for, as limited; its time is when the belief came about."""
        wish = self.profile.command(prediction)
        return self.limits.bound(replace(wish, time=prediction.end + self.judge.latency))

    def _tick(self, block: AudioBlock, predictions: list[Prediction]) -> Tick:
        return Tick(block, tuple(predictions), tuple(map(self.feel, predictions)))


def open_walk(
    model: str = "",
    *,
    sample_rate: int,
    channels: int,
    profile: str = "paper",
    limits: Limits | None = None,
    fast_contact: bool = True,
) -> Walk:
    """Make a walk for sound of a rate and channel count.

    Parameters
    ----------
    model
        Name of a shipped model, or a model file; empty: the default for so many channels.
    profile
        Name of a rendering profile.
    fast_contact
        Whether contact is told within milliseconds (`perception.contact`); if not, by the window, as in the paper.

    Raises
    ------
    ModelError, ConfigError
        If there is no such model or profile, or the model cannot judge such sound.
    """
    detector = open_detector(model or default_model(channels), sample_rate=sample_rate)
    gate = ContactGate(detector.threshold_dbfs, sample_rate=sample_rate) if fast_contact else None
    return Walk(Judge(detector, gate), open_profile(profile), limits)


class Sender:
    """The robot's walk: sound in; itself, or the belief of it alone, goes out through ``end``.

    Parameters
    ----------
    end
        Of the line; whoever owns the socket also feeds it what arrives, lets it poll, and fetches its datagrams.
    judge
        Judges here, for lines that cannot carry sound; ``None`` sends the sound.
    """

    def __init__(self, end: SendingEnd, judge: Judge | None = None) -> None:
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
