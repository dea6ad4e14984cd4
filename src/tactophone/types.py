"""What crosses the doors between rooms: sound, belief, command, and the contracts of those who pass them on.

Everything here is a frozen value. Arrays inside are shared, never copied: who receives one does not write to it.
"""

import enum
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float32]

CONTACT = 0
"""Channel of the contact microphone, the piezo on the finger pad."""

AIR = 1
"""Channel of the air microphone, the MEMS beside the finger."""


class Touch(enum.IntEnum):
    """What the finger does, in the class order of the paper's published models."""

    NONE = 0
    SMOOTH = 1
    ROUGH = 2


@dataclass(frozen=True, slots=True, eq=False)
class AudioBlock:
    """A stretch of sound as it arrived; of fixed size, it is a window.

    Parameters
    ----------
    samples
        float32, shape ``(samples, channels)``, nominally in [-1, 1]. Channel 0 is *contact*, channel 1 is *air*.
    sample_rate
        In Hz.
    start
        Index of the first sample since the stream began, at ``sample_rate``.
    concealed
        True when the sound was lost on the way and this is a guess at it.

    Examples
    --------
    >>> block = AudioBlock(np.zeros((480, 2), np.float32), sample_rate=48_000, start=960)
    >>> block.size, block.channels, block.time, block.duration
    (480, 2, 0.02, 0.01)
    """

    samples: FloatArray
    sample_rate: int
    start: int = 0
    concealed: bool = False

    def __post_init__(self) -> None:
        if self.samples.ndim != 2 or self.samples.dtype != np.float32:
            raise ValueError(
                f"samples are {self.samples.dtype} of shape {self.samples.shape}, "
                "but a block holds float32 of shape (samples, channels); reshape or convert them"
            )

    @property
    def size(self) -> int:
        """Number of samples a channel."""
        return len(self.samples)

    @property
    def channels(self) -> int:
        """Number of channels."""
        return int(self.samples.shape[1])

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.size / self.sample_rate

    @property
    def time(self) -> float:
        """Seconds from the stream's beginning to the first sample."""
        return self.start / self.sample_rate

    @property
    def end(self) -> int:
        """Index of the sample after the last one."""
        return self.start + self.size


@dataclass(frozen=True, slots=True)
class Prediction:
    """What the detector believes of one window.

    Parameters
    ----------
    probabilities
        Of ``Touch.NONE, Touch.SMOOTH, Touch.ROUGH``; they sum to 1.
    touch
        The decision, after the contact gate and whatever hysteresis the model asks for.
    roughness
        From 0 (smooth) to 1 (rough); of no meaning while ``touch`` is ``NONE``.
    level_dbfs
        Level of the contact channel over the window, by the model's loudness rule.
    start, end
        The window's bounds, in seconds since the stream began.
    faulty
        True when the sound or the model's answer was garbage: nothing may be felt on it.
    """

    probabilities: tuple[float, float, float]
    touch: Touch
    roughness: float
    level_dbfs: float
    start: float
    end: float
    faulty: bool = False


@dataclass(frozen=True, slots=True)
class HapticCommand:
    """What is truly felt, after every limit.

    Parameters
    ----------
    amplitude
        From 0 to 1 of full drive.
    frequency
        In Hz.
    time
        Seconds since the stream began at which the command was given.
    """

    amplitude: float
    frequency: float
    time: float


@dataclass(frozen=True, slots=True, eq=False)
class PipelineStep:
    """One step of the receiving side, for whoever watches: the sound, what was believed of it, what is felt.

    There is one command for each prediction, or none at all when they came too late to be felt.
    """

    block: AudioBlock
    predictions: tuple[Prediction, ...]
    commands: tuple[HapticCommand, ...]

    @property
    def command(self) -> HapticCommand | None:
        """The newest command of the step, if it gave any."""
        return self.commands[-1] if self.commands else None


class Source(Protocol):
    """Where sound comes from: a device, a file or the simulated finger, all under one contract.

    Used as a context manager and iterated: ``with source: for block in source: ...``. Blocks are contiguous unless
    the device lost sound, in which case ``start`` jumps by what was lost. Iteration ends when the sound does.
    """

    @property
    def sample_rate(self) -> int:
        """In Hz."""
        ...

    @property
    def channels(self) -> int:
        """1 or 2; channel 0 is contact."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def __iter__(self) -> Iterator[AudioBlock]: ...


class AlwaysOpen:
    """For sources that hold nothing: there is nothing to open, and nothing to close."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None


@runtime_checkable
class Detector(Protocol):
    """Sound to belief: a streaming stage that owns its rate, window, hop, gate and hysteresis.

    Pushing the same sound in blocks of any size gives bit-equal predictions.
    """

    @property
    def name(self) -> str:
        """As ``feel --model`` takes it."""
        ...

    @property
    def hop(self) -> float:
        """Seconds between two predictions."""
        ...

    @property
    def latency(self) -> float:
        """Seconds from the end of a window to the moment at which it can be judged (filter delay)."""
        ...

    @property
    def bandwidth(self) -> float:
        """The highest frequency, in Hz, that it makes use of."""
        ...

    @property
    def faults(self) -> Counter[str]:
        """How often nothing could be believed, by cause: ``sound`` or ``model`` was garbage."""
        ...

    @property
    def threshold_dbfs(self) -> float:
        """Level of the contact channel from which there is contact; may be set at any time."""
        ...

    @threshold_dbfs.setter
    def threshold_dbfs(self, level_dbfs: float) -> None: ...

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Take sound in, give the predictions that it completes, oldest first."""
        ...

    def flush(self) -> list[Prediction]:
        """Give what the end of the stream still completes."""
        ...

    def reset(self) -> None:
        """Become as new."""
        ...


class Profile(Protocol):
    """Belief to wish: which vibration a prediction asks for, before limits."""

    @property
    def name(self) -> str:
        """As ``feel --profile`` takes it."""
        ...

    def command(self, prediction: Prediction) -> HapticCommand:
        """The vibration wished for; limits come after."""
        ...


class Renderer(Protocol):
    """Command to waveform; runs inside the actuator's callback."""

    @property
    def latency(self) -> float:
        """Seconds from a command to its first effect on the waveform."""
        ...

    def submit(self, command: HapticCommand) -> None:
        """Put the newest command in the one slot; never waits."""
        ...

    def render(self, out: FloatArray) -> None:
        """Write the next ``len(out)`` samples of the waveform in place; never raises, never allocates much."""
        ...

    def reset(self) -> None:
        """Be silent and as new."""
        ...
