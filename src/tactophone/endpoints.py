"""The two ends of the live system in the order of their stages, with no thread, clock or device.

::

    robot     sound ─▶ RobotEndpoint ─▶ datagrams       (with a detector: sound ─▶ predictions ─▶ datagrams)
    operator  datagrams ─▶ OperatorEndpoint: sound in order ─▶ Pipeline ─▶ PipelineStep

The live system, the simulations, the tests and the benchmarks all run these two classes; there is no second path
(`tests/test_endpoints.py` checks it).
"""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

import numpy as np

from tactophone.errors import ModelError
from tactophone.link import (
    Address,
    Connected,
    Datagrams,
    DecodedAudio,
    PredictionReceived,
    ReceiveEvent,
    ReceiveSession,
    SendSession,
)
from tactophone.perception import AnyTouchDetector
from tactophone.pipeline import Pipeline
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock, PipelineStep

EventStep: TypeAlias = tuple[ReceiveEvent, PipelineStep | None]
"""What the session received, and the step that it led to: none for a connection made or lost."""


class RobotEndpoint:
    """The robot's side: takes sound, and sends it or its predictions through a session.

    Parameters
    ----------
    session
        Whoever owns the socket also passes what arrives to the session, polls it and fetches its datagrams.
    detector
        Makes the predictions here, for links too narrow for sound; ``None`` sends the sound.
    """

    def __init__(self, session: SendSession, detector: AnyTouchDetector | None = None) -> None:
        self.session, self.detector = session, detector

    def push(self, block: AudioBlock) -> PipelineStep:
        """Send a block, or the predictions that it completes; returns the step with those predictions."""
        if self.detector is None:
            self.session.push(block)
            return PipelineStep(block, (), ())
        predictions = tuple(self.detector.push(block))
        for prediction in predictions:
            self.session.send_prediction(prediction)
        return PipelineStep(block, predictions, ())


class OperatorEndpoint:
    """The operator's side: takes datagrams and returns pipeline steps, computed on arrival.

    Sound too old to be rendered still goes through the detector, whose next window needs it, but its step holds no
    predictions and no commands.

    Parameters
    ----------
    session
        Opens the datagrams and puts the sound in order.
    pipeline
        For sound of ``channels`` channels.
    reopen
        Returns the pipeline for another number of channels, when a robot with other microphones connects; raises
        `ModelError` where the model cannot do with so many.

    Attributes
    ----------
    refusal
        Why the sound of the connected robot cannot be used; empty while it can.
    """

    def __init__(
        self,
        session: ReceiveSession,
        pipeline: Pipeline,
        *,
        channels: int = 2,
        reopen: Callable[[int], Pipeline] | None = None,
    ) -> None:
        self.session, self.pipeline = session, pipeline
        self._channels, self._reopen = channels, reopen
        self.refusal = ""

    @property
    def peer(self) -> str | None:
        """Name of the connected robot; ``None`` while there is none."""
        return self.session.peer

    def receive(self, datagrams: Datagrams, *, now: float) -> Iterator[EventStep]:
        """Take everything that arrived by ``now`` (s); returns events with their steps, oldest first.

        The datagrams are opened and decoded at once. Each step is computed when the iterator comes to it, so that the
        command of one block need not wait for the next block; iterate to the end.
        """
        return self._steps(self.session.receive(datagrams, now=now))

    def poll(self, now: float) -> Iterator[EventStep]:
        """Let time pass; call it when nothing arrived for a packet's length, and at least twenty times a second."""
        return self._steps(self.session.poll(now))

    def outgoing(self) -> list[tuple[bytes, Address]]:
        """Return the datagrams to send, each with its address."""
        return self.session.outgoing()

    def _steps(self, events: Iterable[ReceiveEvent]) -> Iterator[EventStep]:
        return ((event, self._step(event)) for event in events)

    def _step(self, event: ReceiveEvent) -> PipelineStep | None:
        match event:
            case DecodedAudio(block, stale):
                if not self._match_channels(block.channels):
                    return None
                step = self.pipeline.push(block)
                return PipelineStep(block, (), ()) if stale else step
            case PredictionReceived(prediction, stale):
                commands = () if stale else (self.pipeline.command_for(prediction),)
                # The sound stayed on the robot: an empty block at the end of the window stands for it.
                end = round(prediction.end * LIVE_SAMPLE_RATE)
                block = AudioBlock(np.zeros((0, 1), np.float32), LIVE_SAMPLE_RATE, end)
                return PipelineStep(block, (prediction,), commands)
            case Connected():
                self.pipeline.reset()
        return None

    def _match_channels(self, channels: int) -> bool:
        """Change to the pipeline for so many channels; false if there is none."""
        if channels == self._channels or self._reopen is None:
            self.refusal = ""
            return True
        try:
            following = self._reopen(channels)
        except ModelError as error:
            self.refusal = str(error)
            return False
        before, self.pipeline, self._channels = self.pipeline, following, channels
        # A ceiling lowered or a profile chosen during the run holds for the next robot too.
        self.pipeline.limits, self.pipeline.profile = before.limits, before.profile
        self.refusal = ""
        return True
