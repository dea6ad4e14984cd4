"""Values of a data set: recordings, their labels and segments. No file is opened here except to hash it."""

import functools
import hashlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tactophone.errors import DatasetError
from tactophone.types import Touch

LABEL_NAMES: Mapping[str, Touch | None] = MappingProxyType(
    {
        "none": Touch.NONE,
        "no_contact": Touch.NONE,
        "smooth": Touch.SMOOTH,
        "rough": Touch.ROUGH,
        "ambiguous": None,
        "mixed": None,
        "contact": None,
        "": None,
    }
)
"""What a label column may hold. ``mixed``: see the segments. ``contact``: in contact, roughness unknown."""


@dataclass(frozen=True, slots=True)
class Segment:
    """An interval of a recording with a constant label.

    Examples
    --------
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
        """Whether the finger is in contact."""
        return self.label is not Touch.NONE


def touch_at(time: float, segments: Iterable[Segment]) -> int:
    """Return the number of the labelled `Touch` at a time in s, or -1 where it is unknown, as telemetry stores it.

    Examples
    --------
    >>> touch_at(1.0, [Segment(0.0, 2.0, "rough")]), touch_at(3.0, [Segment(0.0, 2.0, "rough")])
    (2, -1)
    """
    labels = (segment.label for segment in segments if segment.start <= time < segment.end)
    return int(next((label for label in labels if label is not None), -1))


@dataclass(frozen=True, slots=True)
class Recording:
    """One sound file and its labels."""

    path: Path
    """The WAV or FLAC file."""
    surface: str
    """The material and texture touched; splits keep all recordings of a surface on one side."""
    label: Touch | None = None
    """A person's label of the whole recording; ``None`` if ambiguous, mixed or unknown."""
    channels: tuple[str, ...] = ()
    """The microphone of each channel, ``"contact"`` or ``"air"``, in the file's order; empty if unknown."""
    take: str = ""
    scenario: str = ""
    session: str = ""
    tier: str = ""
    """`take`, `scenario`, `session` and `tier`: which of the surface's recordings it is, how the object was held, the
    day, and how reliable the label is."""
    segments: tuple[Segment, ...] = ()
    """Labels that change with time."""
    properties: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}), hash=False)
    """All other columns of the manifest, such as ``pressure``, ``stroke``, ``material`` or ``licence``."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Support pickling: a read-only view of properties cannot be pickled as it is."""
        *values, properties = (getattr(self, entry.name) for entry in fields(self))
        return _unpickle, (*values, dict(properties))

    def with_properties(self, **properties: str) -> "Recording":
        """Return the recording with further properties, or other values of those that it has."""
        return replace(self, properties=MappingProxyType({**self.properties, **properties}))

    def known(self, name: str) -> str:
        """Return a field or a property as text, empty if unknown; splits group by it.

        >>> Recording(Path("a.wav"), "slate", Touch.ROUGH, properties={"pressure": "light"}).known("pressure")
        'light'
        """
        value = self.properties[name] if name in self.properties else getattr(self, name, "")
        return value.name.lower() if isinstance(value, Touch) else str(value or "")


def _unpickle(*values: Any) -> Recording:
    *others, properties = values
    return replace(Recording(*others), properties=MappingProxyType(properties))


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

    ``problems`` are those met while reading the manifest; their messages say whether a line was left out or corrected.
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
        """Return the data set with only the recordings for which ``keep`` is true."""
        return Dataset(self.name, self.root, tuple(filter(keep, self.recordings)), self.problems)

    def labelled(self) -> "Dataset":
        """Return the data set with only the recordings labelled smooth or rough.

        Raises `DatasetError` if there are none.
        """
        kept = self.where(lambda recording: recording.label in (Touch.SMOOTH, Touch.ROUGH))
        if not self.recordings:
            raise DatasetError(f"{self.root}: holds no usable recording; run `tactophone dataset check {self.root}`")
        if not kept.recordings:
            raise DatasetError(
                f"{self.root}: none of its {len(self.recordings)} recordings is labelled smooth or rough; "
                "fill in the manifest's label column"
            )
        return kept

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 over every file's name, surface, label and bytes; changes with anything that training uses."""
        return fingerprint(self.recordings)


def fingerprint(recordings: Iterable[Recording]) -> str:
    """Hash recordings by content, independent of their order and folder; missing files count as empty."""
    total = hashlib.sha256()
    for recording in sorted(recordings, key=lambda recording: (recording.path.name, recording.surface)):
        total.update(f"{recording.path.name}\0{recording.surface}\0{recording.known('label')}\0".encode())
        if recording.path.is_file():
            stat = recording.path.stat()
            total.update(_digest(recording.path, stat.st_mtime_ns, stat.st_size))
    return total.hexdigest()


@functools.lru_cache(maxsize=1 << 16)
def _digest(path: Path, changed_ns: int, byte_count: int) -> bytes:
    """Hash a file's bytes, cached by its time and size: cross-validation needs it in every fold."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
