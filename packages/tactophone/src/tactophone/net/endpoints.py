"""The two ends of the live system in the order of their stages, with no thread, clock
or device.

::

    robot     sound ─▶ RobotEndpoint ─▶ datagrams       (with a detector: sound ─▶ predictions ─▶ datagrams)
    operator  datagrams ─▶ OperatorEndpoint: sound in order ─▶ Pipeline ─▶ PipelineStep

The live system, the simulations, the tests and the benchmarks all run these two
classes; there is no second path (`packages/tactophone/tests/net/test_endpoints.py` checks it).
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeAlias

import numpy as np

from tactophone.core.errors import ModelError
from tactophone.core.microphones import fingers_of
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    AudioBlock,
    Detector,
    PipelineStep,
    Prediction,
)
from tactophone.net.link.events import Connected
from tactophone.net.link.receive import PredictionReceived, ReceiveEvent, ReceiveSession
from tactophone.net.link.send import Datagrams, SendGroup
from tactophone.net.link.stream import DecodedAudio
from tactophone.signal.perception.detector import push_together
from tactophone.signal.pipeline import Hand, Pipeline, split_fingers

EventStep: TypeAlias = tuple[ReceiveEvent, PipelineStep | None]
"""What the session received, and a step that it led to, of each finger in turn; none
for a connection made or lost, and for sound that waits for the next packet, as nothing
comes of it."""


class RobotEndpoint:
    """The robot's side: takes sound, and sends it or its predictions through a session.

    - ``group``: the sessions with one or more operators. Whoever owns the sockets also passes what arrives to it, polls
      it and fetches the datagrams of its sessions.
    - ``detector``: makes the predictions here, for links too narrow for sound; one for each finger of a hand. ``None``
      sends the sound.
    - ``channels``: of the sound of each finger of a hand (`tactophone.signal.pipeline.Hand`); empty without one.
    """

    def __init__(
        self,
        group: SendGroup,
        detector: Detector | Sequence[Detector] | None = None,
        *,
        channels: Sequence[int] = (),
    ) -> None:
        self.group = group
        self._channels = channels
        self.detectors = (
            list(detector)
            if isinstance(detector, Sequence)
            else [detector]
            if detector
            else []
        )

    def push(self, block: AudioBlock) -> list[PipelineStep]:
        """Send a block, or the predictions that it completes; returns each finger's
        step with those predictions."""
        self.group.encoder.moving = block.moving
        if not self.detectors:
            self.group.push(block)
            return []
        blocks = self._split(block)
        found = list(map(tuple, push_together(self.detectors, blocks)))
        # Predictions whose windows end together travel in one packet, oldest first.
        by_end: dict[float, dict[int, Prediction]] = {}
        for finger, predictions in enumerate(found):
            for prediction in predictions:
                by_end.setdefault(prediction.end, {})[finger] = prediction
        for _, predicted in sorted(by_end.items()):
            self.group.send_predictions(predicted, fingers=len(found))
        return [
            PipelineStep(part, predictions, (), finger)
            for finger, (part, predictions) in enumerate(
                zip(blocks, found, strict=True)
            )
        ]

    def steps(self, block: AudioBlock) -> list[PipelineStep]:
        """Return each finger's step of a block that was sent without predictions."""
        return [
            PipelineStep(part, (), (), finger)
            for finger, part in enumerate(self._split(block))
        ]

    def _split(self, block: AudioBlock) -> list[AudioBlock]:
        return split_fingers(block, self._channels) if self._channels else [block]


class OperatorEndpoint:
    """The operator's side: takes datagrams and returns pipeline steps, computed on
    arrival.

    Sound too old to be rendered still goes through the detector, whose next window
    needs it, but its step holds no predictions and no commands.

    - ``session``: opens the datagrams and puts the sound in order.
    - ``pipeline``: for sound of two channels; or the pipelines of a hand, whose robot must have as many fingers.
    - ``reopen``: returns the pipeline for another number of channels, when a robot with other microphones connects;
      raises `ModelError` where the model cannot do with so many. Not for a hand.

    ``refusal``: why the sound of the connected robot cannot be used; empty while it
    can.
    """

    def __init__(
        self,
        session: ReceiveSession,
        pipeline: Pipeline | Hand,
        *,
        reopen: Callable[[int], Pipeline] | None = None,
    ) -> None:
        self.session = session
        self.hand = pipeline if isinstance(pipeline, Hand) else Hand([pipeline])
        self._channels = 2
        self._reopen = reopen
        self._accepted = 0
        self.refusal = ""

    @property
    def pipeline(self) -> Pipeline:
        """The pipeline of the first finger, or the only one."""
        return self.hand.pipelines[0]

    def receive(self, datagrams: Datagrams, *, now: float) -> Iterator[EventStep]:
        """Take everything that arrived by ``now`` (s); returns events with their steps,
        oldest first.

        The datagrams are opened and decoded at once. Each step is computed when the
        iterator comes to it, so that the command of one block need not wait for the
        next block; iterate to the end.
        """
        return self._steps(self.session.receive(datagrams, now=now))

    def poll(self, now: float) -> Iterator[EventStep]:
        """Let time pass; call it when nothing arrived for a packet's length, and at
        least twenty times a second."""
        return self._steps(self.session.poll(now))

    def _steps(self, events: Iterable[ReceiveEvent]) -> Iterator[EventStep]:
        for event in events:
            steps: Iterable[PipelineStep] = ()
            match event:
                case DecodedAudio(block=block, stale=stale) if self._accepts(
                    block.channels
                ):  # nearly always
                    # Late sound still goes through the detector, but what it leads to
                    # is no longer rendered.
                    found = self.hand.push(block)
                    steps = (
                        (
                            PipelineStep(each.block, (), (), each.finger)
                            for each in found
                        )
                        if stale
                        else found
                    )
                case PredictionReceived(prediction, stale, finger, fingers) if (
                    self._has_fingers(fingers)
                ):
                    commands = (
                        ()
                        if stale
                        else (self.hand.pipelines[finger].command_for(prediction),)
                    )
                    # The sound stayed on the robot: an empty block at the end of the
                    # window stands for it.
                    end = round(prediction.end * LIVE_SAMPLE_RATE)
                    block = AudioBlock(
                        np.zeros((0, 1), np.float32), LIVE_SAMPLE_RATE, end
                    )
                    steps = (PipelineStep(block, (prediction,), commands, finger),)
                case Connected():
                    self.hand.reset()
                    self.refusal = ""
            step = None
            for step in steps:
                yield event, step
            if step is None:
                yield event, None

    def _accepts(self, channels: int) -> bool:
        """Whether there is a pipeline for sound of so many channels; if not, `refusal`
        says so."""
        if channels != self._accepted or self.refusal:
            accepted = self._has_fingers(fingers_of(channels)) and self._match_channels(
                channels
            )
            self._accepted = channels if accepted else 0
        return self._accepted > 0

    def _has_fingers(self, fingers: int) -> bool:
        """Whether this end has as many fingers as the robot; if not, `refusal` says
        so."""
        if fingers == self.hand.fingers:
            return True
        own = self.hand.fingers
        self.refusal = (
            f"the robot has {fingers} finger{'s' * (fingers > 1)}, this operator {own}: "
            "give both ends the same --fingers"
        )
        return False

    def _match_channels(self, channels: int) -> bool:
        """Change to the pipeline for so many channels; false if there is none."""
        if self.hand.fingers > 1 or channels == self._channels or self._reopen is None:
            self.refusal = ""
            return True
        try:
            following = self._reopen(channels)
        except ModelError as error:
            self.refusal = str(error)
            return False
        before = self.pipeline
        self._channels = channels
        # A ceiling lowered or a profile chosen during the run holds for the next robot
        # too.
        following.limits = before.limits
        following.profile = before.profile
        self.hand = Hand([following])
        self.refusal = ""
        return True
