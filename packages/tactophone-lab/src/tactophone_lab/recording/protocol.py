"""The paper's recording protocol as a state machine: keys and sound in, the sound of a
take out; no terminal, no file.

Time is counted in samples of the sound, so that simulated sound is processed as fast as
it is computed.

::

    READY --go--> COUNTDOWN --> RECORDING --> REVIEW --go--> READY (next take) ... DONE
                                 |    ^         |
                                 go   go        +--retake--> READY (same take)
                                 v    |
                                 PAUSED
"""

import enum
from collections.abc import Collection, Sequence

from tactophone.core.types import AudioBlock
from tactophone_lab.simulation.takes import Take

TAKE_DURATION = 30.0
"""Seconds of a take (paper, section IV-C)."""

COUNTDOWN = 3.0
"""Seconds between the key press and the take: time to move the hand back to the
finger."""


class Stage(enum.StrEnum):
    """State of the session."""

    READY = "ready"
    COUNTDOWN = "countdown"
    RECORDING = "recording"
    PAUSED = "paused"
    REVIEW = "review"
    DONE = "done"


class Key(enum.StrEnum):
    """What the user can do."""

    GO = "go"
    RETAKE = "retake"
    QUIT = "quit"


_ON_GO = {
    Stage.READY: Stage.COUNTDOWN,
    Stage.RECORDING: Stage.PAUSED,
    Stage.PAUSED: Stage.RECORDING,
}


class Protocol:
    """Steps through the takes but those that are ``done``; ``duration`` and
    ``countdown`` are in s.

    >>> import numpy as np
    >>> from tactophone_lab.simulation.takes import TAKES
    >>> protocol = Protocol(TAKES, sample_rate=1000, duration=1, countdown=1)
    >>> protocol.press(Key.GO)
    >>> sound = AudioBlock(np.zeros((1500, 2), np.float32), 1000)
    >>> protocol.push(sound).size, protocol.stage.value, protocol.take.name
    (500, 'recording', 'long_light')
    """

    def __init__(
        self,
        takes: Sequence[Take],
        *,
        sample_rate: int,
        done: Collection[str] = (),
        duration: float = TAKE_DURATION,
        countdown: float = COUNTDOWN,
    ) -> None:
        self.takes = tuple(take for take in takes if take.name not in done)
        self._size = round(duration * sample_rate)
        self._countdown_size = round(countdown * sample_rate)
        self._rate = sample_rate
        self._place = 0
        self.pauses: tuple[float, ...] = ()
        self._enter(Stage.READY if self.takes else Stage.DONE)

    @property
    def take(self) -> Take:
        """The current take; the last take when all are done."""
        return self.takes[min(self._place, len(self.takes) - 1)]

    @property
    def number(self) -> int:
        """Number of the current take, from 1."""
        return self._place + 1

    @property
    def remaining(self) -> float:
        """Seconds left of the countdown or the take."""
        return self._left / self._rate

    def press(self, key: Key) -> None:
        """Apply a key; a key without meaning in the current stage is ignored."""
        if key is Key.QUIT:
            self._enter(Stage.DONE)
        elif key is Key.RETAKE and self.stage in (
            Stage.RECORDING,
            Stage.PAUSED,
            Stage.REVIEW,
        ):
            self._enter(Stage.READY)
        elif key is Key.GO and self.stage is Stage.REVIEW:
            self._place += 1
            self._enter(Stage.READY if self._place < len(self.takes) else Stage.DONE)
        elif key is Key.GO and self.stage in _ON_GO:
            if self.stage is Stage.RECORDING:
                self.pauses += (round((self._size - self._left) / self._rate, 3),)
            self._enter(_ON_GO[self.stage])

    def push(self, block: AudioBlock) -> AudioBlock:
        """Advance time by a block; return the part of it, perhaps empty, that belongs
        to the current take."""
        skipped = 0
        if self.stage is Stage.COUNTDOWN:
            skipped = min(self._left, block.size)
            self._left -= skipped
            if self._left == 0:
                self._enter(Stage.RECORDING)
        taken = (
            min(self._left, block.size - skipped)
            if self.stage is Stage.RECORDING
            else 0
        )
        self._left -= taken
        if self.stage is Stage.RECORDING and self._left == 0:
            self._enter(Stage.REVIEW)
        samples = block.samples[skipped : skipped + taken]
        return AudioBlock(
            samples, block.sample_rate, block.start + skipped, block.concealed
        )

    def _enter(self, stage: Stage) -> None:
        before = getattr(self, "stage", None)
        self.stage = stage
        if stage is Stage.COUNTDOWN:
            self._left = self._countdown_size
            self.pauses = ()
        elif stage is Stage.RECORDING and before is not Stage.PAUSED:
            self._left = self._size
        elif stage not in (Stage.RECORDING, Stage.PAUSED):
            self._left = 0
