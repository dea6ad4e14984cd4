"""Values of a data set: recordings with their labels, segments and sound."""

import contextlib
import functools
import hashlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TypeAlias

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.recordings.sound_file import open_file, read_samples
from tactophone.core.types import SURFACE_LABELS, AudioBlock, FloatArray, Touch

READ_SIZE = 1 << 15
"""Samples read at once: more is no faster, and memory must not grow with a recording's
length."""

CHECKED_SILENT_DBFS = -90.0
"""Peak under which nothing was recorded: three steps of a 16-bit converter."""

OTHER_CHANNEL = "-"
"""A channel of a field recorder that holds something else than a finger's sound."""

CROSSING = 0.1
"""Seconds after an edge for which a finger that crosses it still slides."""

LABEL_NAMES: Mapping[str, Touch | None] = {
    **{touch.name.lower(): touch for touch in Touch},
    "no_contact": Touch.NONE,
    "ambiguous": None,
    "mixed": None,
    "contact": None,
    "": None,
}
"""What a label column may hold. ``mixed``: see the segments. ``contact``: in contact,
roughness unknown."""


@dataclass(frozen=True, slots=True)
class Segment:
    """An interval of a recording with a constant label.

    >>> Segment(0.3, 5.17, "contact").contact, Segment(5.17, 6.0, "none").label
    (True, <Touch.NONE: 0>)
    """

    start: float
    end: float
    """`start` and `end`: in seconds since the recording began."""
    label_name: str
    """One of :data:`LABEL_NAMES`."""

    @property
    def label(self) -> Touch | None:
        """The class, or ``None`` where it is unknown."""
        return LABEL_NAMES[self.label_name]

    @property
    def contact(self) -> bool:
        return self.label is not Touch.NONE


def touch_at(time: float, segments: Iterable[Segment]) -> int:
    """Return the number of the labelled `Touch` at a time in s, or -1 where it is
    unknown, as telemetry stores it.

    >>> segments = [Segment(0.0, 2.0, "rough")]
    >>> touch_at(1.0, segments), touch_at(3.0, segments)
    (2, -1)
    """
    labels = (
        segment.label for segment in segments if segment.start <= time < segment.end
    )
    return int(next((label for label in labels if label is not None), -1))


@dataclass(frozen=True, slots=True)
class Recording:
    """One sound file and its labels."""

    path: Path
    """The WAV or FLAC file."""
    surface: str
    """The material and texture touched; splits keep all recordings of a surface on one
    side."""
    label: Touch | None = None
    """A person's label of the whole recording; ``None`` if ambiguous, mixed or
    unknown."""
    channels: tuple[str, ...] = ()
    """The microphone of each channel, ``"contact"`` or ``"air"``, in the file's order,
    and :data:`OTHER_CHANNEL` for one that is not the finger's; empty if unknown."""
    take: str = ""
    scenario: str = ""
    session: str = ""
    tier: str = ""
    """`take`, `scenario`, `session` and `tier`: which of the surface's recordings it
    is, how the object was held, the day, and how reliable the label is."""
    segments: tuple[Segment, ...] = ()
    """Labels that change with time."""
    properties: Mapping[str, str] = field(default_factory=dict, hash=False)
    """All other columns of the manifest, such as ``pressure``, ``stroke``, ``material``
    or ``licence``."""

    @property
    def microphones(self) -> tuple[str, ...]:
        """The finger's channels: in the file's order, but contact first where they are
        picked from others."""
        if OTHER_CHANNEL not in self.channels:
            return self.channels
        return tuple(name for name in MICROPHONES if name in self.channels)

    @property
    def picked(self) -> tuple[int, ...]:
        """Places of the finger's channels, where the file has others beside them; else
        empty."""
        if OTHER_CHANNEL not in self.channels:
            return ()
        return tuple(self.channels.index(name) for name in self.microphones)

    def with_picked(self, places: Sequence[int], count: int) -> "Recording":
        """Return the recording with contact, and air, at these places of a file of
        ``count`` channels."""
        names = [OTHER_CHANNEL] * max(count, *(place + 1 for place in places))
        for place, name in zip(places, MICROPHONES, strict=False):
            names[place] = name
        return replace(self, channels=tuple(names))

    @property
    def labelled(self) -> bool:
        """True if the whole recording has one surface, and a label."""
        return self.label in SURFACE_LABELS

    @property
    def rough(self) -> bool:
        """True if the label is rough."""
        return self.label is Touch.ROUGH

    def with_properties(self, **properties: str) -> "Recording":
        """Return the recording with further properties, or other values of those that
        it has."""
        return replace(self, properties={**self.properties, **properties})

    def known(self, name: str) -> str:
        """Return a field or a property as text, empty if unknown; splits group by it.

        >>> light = {"pressure": "light"}
        >>> recording = Recording(Path("a.wav"), "slate", Touch.ROUGH, properties=light)
        >>> recording.known("pressure")
        'light'
        """
        value = (
            self.properties[name]
            if name in self.properties
            else getattr(self, name, "")
        )
        return value.name.lower() if isinstance(value, Touch) else str(value or "")

    def blocks(
        self,
        *,
        channels: int | None = None,
        single: str = "contact",
        size: int = READ_SIZE,
    ) -> Iterator[AudioBlock]:
        """Read the sound in blocks of ``size`` samples, so that memory does not grow
        with its length.

        ``channels`` is 2 for contact and air, 1 for the microphone ``single``, as
        :func:`channel_order` finds them, or ``None`` for all in the file's order.
        Raises `DatasetError` if the file cannot be read as sound, or has too few
        channels.
        """
        with open_sound(self.path) as file:
            order = self._order(file, channels, single)
            start = 0
            for samples in file.blocks(size, dtype="float32", always_2d=True):
                yield AudioBlock(_pick(samples, order), int(file.samplerate), start)
                start += len(samples)

    def read(
        self,
        *,
        channels: int | None = None,
        single: str = "contact",
        start: float = 0.0,
        duration: float | None = None,
    ) -> AudioBlock:
        """Read the whole sound, or ``duration`` s from ``start`` s on, as one block;
        else as :meth:`blocks`."""
        with open_sound(self.path) as file:
            order = self._order(file, channels, single)
            rate = int(file.samplerate)
            first = file.seek(round(start * rate))
            frames = -1 if duration is None else round(duration * rate)
            samples = read_samples(file, frames=frames)
            return AudioBlock(_pick(samples, order), rate, first)

    def _order(
        self, file: soundfile.SoundFile, channels: int | None, single: str
    ) -> tuple[int, ...] | None:
        if channels is None:
            return None
        order = channel_order(self, count=channels, single=single)
        if max(order) >= file.channels:
            raise DatasetError(
                f"{self.path}: has {file.channels} channel, but the model takes "
                f"{channels}; "
                "name a one-channel model, or train one with --channels 1"
            )
        return order


def _pick(samples: FloatArray, order: tuple[int, ...] | None) -> FloatArray:
    return samples if order is None else np.ascontiguousarray(samples[:, order])


def channel_order(
    recording: Recording, *, count: int, single: str = "contact"
) -> tuple[int, ...]:
    """Return which of a file's channels to read, in the order contact, air. Channels
    without a known microphone are taken to be in this order.

    If ``count`` is 1, it is the channel of the microphone ``single``, or the first
    where there is no such microphone. Raises `DatasetError` if ``count`` is 2 and the
    file does not hold one contact and one air channel.

    >>> swapped = Recording(Path("a.wav"), "slate", channels=("air", "contact"))
    >>> channel_order(swapped, count=2)
    (1, 0)
    """
    names = recording.channels
    if count == 1:
        first = next(
            (place for place, name in enumerate(names) if name != OTHER_CHANNEL), 0
        )
        return (names.index(single) if single in names else first,)
    if not names:
        return tuple(range(len(MICROPHONES)))
    if sorted(name for name in names if name != OTHER_CHANNEL) != sorted(MICROPHONES):
        raise DatasetError(
            f"{recording.path}: holds {' and '.join(names)}, but contact and air are "
            "needed; "
            "use the one-channel variant (--channels 1; with the recipe paper, "
            "variant = 'one-channel' in its file)"
        )
    return tuple(names.index(name) for name in MICROPHONES)


@contextlib.contextmanager
def open_sound(path: Path) -> Iterator[soundfile.SoundFile]:
    """Open a sound file for reading.

    Raises `DatasetError` if it cannot be opened, or fails to read within the ``with``
    block.
    """
    try:
        with open_file(path) as file:
            yield file
    except (soundfile.SoundFileError, OSError) as error:
        reason = str(getattr(error, "error_string", error)).strip().rstrip(".")
        raise DatasetError(
            f"{path}: cannot be read as sound ({reason or 'damaged'}); "
            "restore it, or drop its line from the manifest"
        ) from error


@dataclass(frozen=True, slots=True)
class Problem:
    """A fault of a file or of a line of the manifest; the message says what to do.

    ``fatal`` is true when the file cannot be used; otherwise the problem is a warning.
    """

    path: Path
    kind: str
    message: str
    fatal: bool = True

    def __str__(self) -> str:
        return f"{self.path}: {self.kind}: {self.message}"


@dataclass(frozen=True)
class Dataset:
    """Recordings that belong together, in the manifest's order.

    ``problems`` were met while reading the manifest; their messages say whether a line
    was left out or corrected.
    """

    name: str
    root: Path
    recordings: tuple[Recording, ...]
    problems: tuple[Problem, ...] = ()

    @property
    def surfaces(self) -> tuple[str, ...]:
        """Names of all surfaces, sorted."""
        return tuple(sorted({recording.surface for recording in self.recordings}))

    def where(self, keep: Callable[[Recording], bool]) -> "Dataset":
        return Dataset(
            self.name, self.root, tuple(filter(keep, self.recordings)), self.problems
        )

    def labelled(self, *, segments: bool = False) -> "Dataset":
        """Return the data set with only the recordings labelled smooth or rough; with
        ``segments``, also recordings that have a segment with such a label.

        Raises `DatasetError` if none is left.
        """

        def holds(recording: Recording) -> bool:
            return recording.labelled or (
                segments
                and any(part.label in SURFACE_LABELS for part in recording.segments)
            )

        kept = self.where(holds)
        if not self.recordings:
            raise DatasetError(
                f"{self.root}: holds no usable recording; run `tactophone dataset "
                f"check {self.root}`"
            )
        if not kept.recordings:
            raise DatasetError(
                f"{self.root}: none of its {len(self.recordings)} recordings is "
                "labelled smooth or rough; "
                "fill in the manifest's label column"
            )
        return kept

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 over every file's name, surface, label and bytes; changes with
        anything that training uses."""
        return fingerprint(self.recordings)


def tip_of(recordings: Iterable[Recording]) -> str:
    """Return the tip that all recordings name; empty if they name none, or several."""
    tips = {recording.known("tip") for recording in recordings}
    return tips.pop() if len(tips) == 1 else ""


def fingerprint(recordings: Iterable[Recording]) -> str:
    """Hash recordings by content, independent of their order and folder; missing files
    count as empty."""
    total = hashlib.sha256()
    for recording in sorted(
        recordings, key=lambda recording: (recording.path.name, recording.surface)
    ):
        total.update(
            f"{recording.path.name}\0{recording.surface}\0{recording.known('label')}\0".encode(
                errors="surrogateescape"  # a name that is no UTF-8
            )
        )
        if recording.path.is_file():
            stat = recording.path.stat()
            total.update(_digest(recording.path, stat.st_mtime_ns, stat.st_size))
    return total.hexdigest()


@functools.lru_cache(maxsize=1 << 16)
def _digest(path: Path, changed_ns: int, byte_count: int) -> bytes:
    """Hash a file's bytes, cached by its time and size: cross-validation needs it in
    every fold."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()


# A finger that has landed and stands still makes no sound. Rough and smooth differ only
# while it slides, so decision delays are counted from there. Simulated data sets have a
# property `slides`: intervals `start-end` in seconds, separated by spaces. A recording
# without it is taken to slide from the first contact on.


Intervals: TypeAlias = tuple[tuple[float, float], ...]
"""Start and end of each slide, or of each touch, in s."""


def stretches(on: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return where each stretch that is on begins, and where it has ended: shape
    ``(stretches, 2)``.

    >>> stretches(np.array([0, 1, 1, 0, 1], bool)).tolist()
    [[1, 3], [4, 5]]
    """
    return np.flatnonzero(np.diff(on, prepend=False, append=False)).reshape(-1, 2)


def within(time: NDArray[np.float64], segments: Iterable[Segment]) -> NDArray[np.bool_]:
    """Return whether each time in s lies in one of the segments, whose ends do not
    belong to them."""
    inside = [(time >= each.start) & (time < each.end) for each in segments]
    return np.asarray(np.any([np.zeros(len(time), bool), *inside], axis=0))


def read_slides(recording: Recording) -> Intervals | None:
    """Return the intervals in which the finger slides; ``None`` if they are unknown."""
    text = recording.known("slides")
    pairs = (entry.split("-") for entry in text.split())
    return tuple((float(start), float(end)) for start, end in pairs) if text else None


def write_slides(intervals: Intervals) -> str:
    """Format intervals as the property ``slides``.

    >>> write_slides(((0.25, 1.0), (1.5, 2.25)))
    '0.250-1.000 1.500-2.250'
    """
    return " ".join(f"{start:.3f}-{end:.3f}" for start, end in intervals)


def first_slide(recording: Recording, start: float, end: float) -> float | None:
    """Return when, between ``start`` and ``end``, the finger begins to slide; ``None``
    if it never does."""
    intervals = read_slides(recording)
    if intervals is None:
        return start
    return min(
        (
            max(begin, start)
            for begin, last in intervals
            if last > start and begin < end
        ),
        default=None,
    )


def slides_over(recording: Recording, edge: float) -> bool:
    """Return whether the finger crosses an edge, at ``edge`` s, without stopping on
    it."""
    intervals = read_slides(recording)
    return intervals is None or any(
        start <= edge and end >= edge + CROSSING for start, end in intervals
    )


def cut_slides(
    recording: Recording, start: float, end: float, *, place: float
) -> Intervals | None:
    """Return the slides of the piece from ``start`` to ``end`` after it was moved to
    ``place``, all in s."""
    intervals = read_slides(recording)
    if intervals is None:
        return None
    shift = place - start
    moved = (
        (max(begin, start) + shift, min(last, end) + shift) for begin, last in intervals
    )
    return tuple(pair for pair in moved if pair[1] > pair[0])
