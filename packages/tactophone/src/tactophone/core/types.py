"""The values that cross the doors between rooms (sound, prediction, command), and the
contracts of the stages.

Values are frozen structs, whose creation costs a quarter of a frozen dataclass's: each
packet makes a dozen. Arrays inside them are shared, never copied: a receiver does not
write to them.
"""

import enum
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from itertools import pairwise
from typing import Any, Literal, Protocol, Self, TypeAlias, runtime_checkable

import msgspec
import numpy as np
from msgspec.structs import force_setattr, replace
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float32]

LIVE_SAMPLE_RATE = 48_000
"""Hz of the whole live system: devices, codec and vibration. A source of another rate
is converted where it enters."""


def ignore(*_: object) -> None:
    """Do nothing: the default for callbacks that report progress or warnings."""


class Touch(enum.IntEnum):
    """What the finger does, in the class order of the paper's published models."""

    NONE = 0
    """It touches nothing, or rests."""
    SMOOTH = 1
    """It slides over a smooth surface."""
    ROUGH = 2
    """It slides over a rough surface."""


SURFACE_LABELS = (Touch.SMOOTH, Touch.ROUGH)
"""Touches that a surface can be labelled as, smoothest first. A further class begins
here."""

PLAUSIBLE_PEAK = 8.0
"""Greatest sample that a microphone can deliver, in times full scale: float files and
mixers may exceed 1 a little, but 18 dB over it is a broken driver or decoder."""


class AudioBlock(msgspec.Struct, frozen=True, eq=False):
    """Consecutive samples of sound as they arrived, without any that no microphone can
    deliver.

    This is the door through which all sound comes in. A sample that is no number, or
    over `PLAUSIBLE_PEAK`, becomes 0 here and is noted in ``invalid``, so that no
    filter, floor, statistic or level after it can ever hold one.

    Attributes
    ----------
    samples
        float32, shape ``(samples, channels)``, nominally in [-1, 1]. Channel 0 is
        *contact*, channel 1 is *air*. They stay unchanged: a detector keeps the array
        until a window falls due. Where a sample had to be removed, this is a copy.
    sample_rate
        In Hz.
    start
        Index of the first sample since the stream began, at ``sample_rate``.
    concealed
        True when the sound was lost on the network and these samples replace it.
    moving
        Whether the robot says that it moves.
    invalid
        Which samples were removed, in the shape of ``samples``; ``None`` if none was,
        as nearly always.

    Examples
    --------
    >>> silence = np.zeros((480, 2), np.float32)
    >>> block = AudioBlock(silence, sample_rate=48_000, start=960)
    >>> block.size, block.channels, block.time, block.duration
    (480, 2, 0.02, 0.01)
    >>> broken = AudioBlock(np.array([[0.5], [np.nan]], np.float32), sample_rate=48_000)
    >>> broken.samples.tolist(), broken.invalid.tolist()
    ([[0.5], [0.0]], [[False], [True]])
    """

    samples: FloatArray
    sample_rate: int
    start: int = 0
    concealed: bool = False
    moving: bool = False
    invalid: NDArray[np.bool_] | None = None

    def __post_init__(self) -> None:
        if self.samples.ndim != 2 or self.samples.dtype != np.float32:
            raise ValueError(
                f"samples are {self.samples.dtype} of shape {self.samples.shape}, "
                "but a block holds float32 of shape (samples, channels); "
                "reshape or convert them"
            )
        if self.invalid is not None and self.invalid.shape != self.samples.shape:
            raise ValueError(
                f"invalid has shape {self.invalid.shape}, "
                f"but the samples have {self.samples.shape}; "
                "cut both together, as `part` and `select` do"
            )
        # Sound with less energy than a single such sample holds none, so that most
        # blocks need no further look. A comparison with NaN is false.
        if not np.vdot(self.samples, self.samples) <= PLAUSIBLE_PEAK**2:
            self._remove_invalid()

    def _remove_invalid(self) -> None:
        # A comparison with NaN is false, so that NaN counts as invalid.
        invalid = ~(np.abs(self.samples) <= PLAUSIBLE_PEAK)
        if not invalid.any():
            return
        force_setattr(self, "samples", np.where(invalid, np.float32(0), self.samples))
        if self.invalid is not None:
            invalid |= self.invalid
        force_setattr(self, "invalid", invalid)

    def part(self, first: int, end: int) -> Self:
        """Return the samples from ``first`` to before ``end``, counted from the
        beginning of the block, as a block of their own."""
        return replace(
            self,
            samples=self.samples[first:end],
            start=self.start + first,
            invalid=None if self.invalid is None else self.invalid[first:end],
        )

    def select(self, channels: slice | Sequence[int]) -> Self:
        """Return some of the channels as a block, in memory of their own: the result of
        a sum may depend on how its numbers lie there."""
        return replace(
            self,
            samples=np.ascontiguousarray(self.samples[:, channels]),
            invalid=None if self.invalid is None else self.invalid[:, channels],
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
        return self.start + len(self.samples)


def joined(blocks: Sequence[AudioBlock]) -> Iterator[AudioBlock]:
    """Join blocks that follow each other without a gap and are equally concealed and
    moving; yields one block for each such stretch."""
    cuts = [
        number
        for number, (one, other) in enumerate(pairwise(blocks), 1)
        if (one.end, one.concealed, one.moving)
        != (other.start, other.concealed, other.moving)
    ]
    for begin, end in pairwise([0, *cuts, len(blocks)]):
        first = blocks[begin]
        if end - begin == 1:
            yield first
            continue
        parts = blocks[begin:end]
        invalid = None
        if any(part.invalid is not None for part in parts):
            invalid = np.concatenate(
                [
                    np.zeros(part.samples.shape, bool)
                    if part.invalid is None
                    else part.invalid
                    for part in parts
                ]
            )
        yield replace(
            first,
            samples=np.concatenate([part.samples for part in parts]),
            invalid=invalid,
        )


FINGER_NAMES = ("thumb", "index", "middle", "ring", "little")
"""Names of the fingers of one hand, in the order of gloves."""

FINGER_PATTERN = "[a-z][a-z0-9_-]{0,15}"
"""Pattern of a finger's name, which becomes part of file names and topics."""

MOST_FINGERS = 10
"""Fingers of one hand, or of a pair of them: the link has a payload type for each
number."""

MOST_OPERATORS = 4
"""Operators of one robot: trainer, trainee and two who watch. Each further one costs
the robot an encryption a packet."""

EVENT_KINDS = ("contact", "tap", "knock", "stroke", "slip", "lift-off")
"""Kinds of touch events; telemetry counts them from 1."""


class TouchEvent(msgspec.Struct, frozen=True):
    """A moment of touch.

    Attributes
    ----------
    kind
        One of `EVENT_KINDS`: ``contact`` (something began to sound, reported at once),
        ``tap`` (it was a touch-down), ``knock`` (it was in the air), ``stroke`` or
        ``slip`` (sliding began, after a touch-down or without), ``lift-off`` (sliding
        ended).
    time
        Seconds since the stream began.
    """

    kind: str
    time: float


class Prediction(msgspec.Struct, frozen=True):
    """What the detector computed from one window.

    Attributes
    ----------
    probabilities
        Of ``Touch.NONE, Touch.SMOOTH, Touch.ROUGH``; they sum to 1.
    touch
        The decision, after the contact gate and the hysteresis of the model, if it has
        any.
    roughness
        From 0 (smooth) to 1 (rough); meaningless while ``touch`` is ``NONE``.
    level_dbfs
        Level of the contact channel over the window, by the model's loudness rule.
    start
        Where the window begins, in seconds since the stream began.
    end
        Where it ends.
    faulty
        True when the sound or the model's output held invalid numbers; the command is
        then silence.
    events
        Touch events that became known since the last prediction; always empty where
        they are not detected.
    unknown
        True in contact while the evidence of the touch has reached neither smooth nor
        rough, so that ``touch`` is a toss-up. Shown to people; never changes the
        vibration.
    """

    probabilities: tuple[float, float, float]
    touch: Touch
    roughness: float
    level_dbfs: float
    start: float
    end: float
    faulty: bool = False
    events: tuple[TouchEvent, ...] = ()
    unknown: bool = False


class HapticCommand(msgspec.Struct, frozen=True):
    """A sine vibration for the actuator, after every limit.

    Attributes
    ----------
    amplitude
        From 0 to 1 of full drive.
    frequency
        In Hz.
    time
        Seconds from the beginning of the stream to the moment at which the command was
        made.
    """

    amplitude: float
    frequency: float
    time: float


class PipelineStep(msgspec.Struct, frozen=True, eq=False):
    """What a block of sound led to: its predictions, and the commands made from them.

    Each prediction has one command, unless they came too late to be rendered: then the
    step has no commands. Each finger of a hand has a step of its own, with its own
    sound.
    """

    block: AudioBlock
    predictions: tuple[Prediction, ...]
    commands: tuple[HapticCommand, ...]
    finger: int = 0

    @property
    def command(self) -> HapticCommand | None:
        """The newest command of the step; ``None`` where no command was made."""
        return self.commands[-1] if self.commands else None


class Source(AbstractContextManager[Any, None], Protocol):
    """Where sound comes from: a device, a file or the simulated finger.

    Used as a context manager and iterated: ``with source: for block in source: ...``.
    Blocks are contiguous unless the device lost sound; then ``start`` jumps by as many
    samples. Iteration ends with the sound.
    """

    @property
    def sample_rate(self) -> int:
        """In Hz."""

    @property
    def channels(self) -> int:
        """1 or 2, and channel 0 is contact; for a hand, contact and air of each finger
        in turn."""

    def __iter__(self) -> Iterator[AudioBlock]: ...


@runtime_checkable
class LabelledSource(Source, Protocol):
    """A source whose true touch is known, because it is simulated or labelled."""

    def truth_of(self, finger: int = 0) -> int:
        """Return the `Touch` of a finger at the end of the newest block; -1 when it is
        not known."""


@runtime_checkable
class Rehearsed(Protocol):
    """A source that has something to prepare before it is entered, such as code that is
    compiled at first use."""

    def rehearse(self) -> None:
        """Prepare it; may take up to a minute."""


@runtime_checkable
class Closable(Protocol):
    """A source whose iteration another thread can end, also while no sound comes."""

    def close(self) -> None:
        """End the iteration."""


class AlwaysOpen:
    """Base of sources that have nothing to open or close."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return None


class ChangedSource:
    """Base of sources that change the sound of another one, and open and close with
    it."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.sample_rate = source.sample_rate
        self.channels = source.channels

    def __enter__(self) -> Self:
        self._source.__enter__()
        return self

    def __exit__(self, *_: object) -> None:
        self._source.__exit__(None, None, None)


ContactRule: TypeAlias = Literal["bands", "level", "window"]
"""What decides on contact: the bands of the contact gate, its level alone, or the level
of a whole window."""


class ContactThreshold:
    """Level of the contact microphone from which there is contact: fixed, or following
    the noise floor.

    One object is shared by the contact gate, the windows, and whoever shows or changes
    it.

    Parameters
    ----------
    dbfs
        In dB of full scale; another may be assigned at any time, and then follows the
        noise floor no longer.
    follows_floor
        Whether the contact gate moves it with the noise.
    """

    def __init__(self, dbfs: float, *, follows_floor: bool = False) -> None:
        self._dbfs = dbfs
        self.follows_floor: bool = follows_floor

    @property
    def dbfs(self) -> float:
        """Level in dB of full scale."""
        return self._dbfs

    @dbfs.setter
    def dbfs(self, dbfs: float) -> None:
        self._dbfs = dbfs
        self.follows_floor = False

    def follow(self, dbfs: float) -> None:
        """Move to what the noise floor asks for; without effect once a level was
        assigned."""
        if self.follows_floor:
            self._dbfs = dbfs


class Detector(Protocol):
    """Sound to predictions: a streaming stage with its own rate, window, hop, gate and
    hysteresis.

    Pushing the same sound in blocks of any size gives bit-equal predictions.
    """

    @property
    def name(self) -> str:
        """As ``feel --model`` takes it."""

    @property
    def latency(self) -> float:
        """Seconds from the end of a window to its prediction (filter delay)."""

    @property
    def bandwidth(self) -> float:
        """The highest frequency, in Hz, that it uses."""

    @property
    def faults(self) -> Counter[str]:
        """Predictions withheld, by cause: ``sound`` or ``model`` held invalid
        numbers."""

    @property
    def threshold(self) -> ContactThreshold:
        """Level of the contact channel above which there is contact."""

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Process a block; returns the predictions that it completes, oldest first."""

    def flush(self) -> list[Prediction]:
        """Return what the end of the stream still completes."""

    def reset(self) -> None:
        """Return to the initial state."""


class Profile(Protocol):
    """Rendering profile: which vibration a prediction is mapped to, before limits."""

    @property
    def name(self) -> str:
        """As ``feel --profile`` takes it."""

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration for a prediction, in amplitude 0 to 1 of full drive;
        limits are applied later."""
