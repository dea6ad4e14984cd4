"""The two ends of the live system in the order of their stages, with no thread, clock
or device.

::

    robot     sound ─▶ RobotEndpoint ─▶ datagrams
              with a detector: sound ─▶ predictions ─▶ datagrams
    operator  datagrams ─▶ OperatorEndpoint: sound in order ─▶ Pipeline ─▶ PipelineStep

The live system, the simulations, the tests and the benchmarks all run these two
classes; sound takes no other path.
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
    HapticCommand,
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
"""What the session received, and a step that it led to, one for each finger in turn;
``None`` where it led to no step, such as a connection made or lost, or sound that waits
for the next packet."""


class RobotEndpoint:
    """The robot's side: takes sound, and sends it or its predictions through a session.

    - ``group``: the sessions with one or more operators. Whoever owns the sockets also
      passes what arrives to it, polls it and fetches the datagrams of its sessions.
    - ``detectors``: make the predictions here, for links too narrow for sound: one for
      each finger. Empty: the sound is sent.
    - ``channels``: how many channels the sound of each finger of a hand has
      (`tactophone.signal.pipeline.Hand`); empty without a hand.
    """

    def __init__(
        self,
        group: SendGroup,
        detectors: Sequence[Detector] = (),
        *,
        channels: Sequence[int] = (),
    ) -> None:
        self.group = group
        self._channels = channels
        self.detectors = list(detectors)

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
        if not self._channels:
            return [block]
        return split_fingers(block, self._channels)


class OperatorEndpoint:
    """The operator's side: takes datagrams and returns pipeline steps, computed on
    arrival.

    Sound too old to be rendered still goes through the detector, whose next window
    needs it, but its step holds no predictions and no commands.

    - ``session``: opens the datagrams and puts the sound in order.
    - ``pipeline``: for sound of two channels; or the pipelines of a hand, whose robot
      must have as many fingers.
    - ``reopen``: returns the pipeline for another number of channels, when a robot with
      other microphones connects; raises `ModelError` where the model cannot do with
      that number. It is not for a hand.

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
        self._robot = ""
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
                case DecodedAudio() if self._accepts(event.block.channels):
                    steps = self._steps_of_sound(event)
                case PredictionReceived() if self._has_fingers(event.fingers):
                    steps = [self._step_of_prediction(event)]
                case Connected(peer):
                    self._begin_stream(peer)
            step = None
            for step in steps:
                yield event, step
            if step is None:
                yield event, None

    def _begin_stream(self, robot: str) -> None:
        if robot == self._robot:
            # It comes back after a break, with the microphones that it had.
            self.hand.restart()
        else:
            self.hand.reset()
        self._robot = robot
        self.refusal = ""

    def _steps_of_sound(self, event: DecodedAudio) -> Iterator[PipelineStep]:
        for step in self.hand.push(event.block):
            # Late sound still goes through the detector, but what it leads to is no
            # longer rendered.
            late = PipelineStep(step.block, (), (), step.finger)
            yield late if event.stale else step

    def _step_of_prediction(self, event: PredictionReceived) -> PipelineStep:
        prediction = event.prediction
        commands: tuple[HapticCommand, ...] = ()
        if not event.stale:
            pipeline = self.hand.pipelines[event.finger]
            commands = (pipeline.command_for(prediction),)
        # The sound stayed on the robot: an empty block at the end of the window stands
        # for it.
        end = round(prediction.end * LIVE_SAMPLE_RATE)
        block = AudioBlock(np.zeros((0, 1), np.float32), LIVE_SAMPLE_RATE, end)
        return PipelineStep(block, (prediction,), commands, event.finger)

    def _accepts(self, channels: int) -> bool:
        """Return whether there is a pipeline for sound with this number of channels; if
        not, `refusal` says why."""
        # Nearly always the sound has as many channels as the last.
        if channels != self._accepted or self.refusal:
            has_fingers = self._has_fingers(fingers_of(channels))
            accepted = has_fingers and self._match_channels(channels)
            self._accepted = channels if accepted else 0
        return self._accepted > 0

    def _has_fingers(self, fingers: int) -> bool:
        """Return whether this end has as many fingers as the robot; if not, `refusal`
        says so."""
        if fingers == self.hand.fingers:
            return True
        own = self.hand.fingers
        self.refusal = (
            f"the robot has {fingers} finger{'s' * (fingers > 1)}, "
            f"this operator {own}: give both ends the same --fingers"
        )
        return False

    def _match_channels(self, channels: int) -> bool:
        """Change to the pipeline for this number of channels; false if the model has
        none for it."""
        as_it_is = self.hand.fingers > 1 or channels == self._channels
        if as_it_is or self._reopen is None:
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
