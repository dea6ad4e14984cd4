"""A recording with what is known of it, and a data set of them: values only, nothing is opened here."""

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

WORDS: Mapping[str, Touch | None] = MappingProxyType(
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
"""The words a label column may hold. ``mixed``: see the segments. ``contact``: touched, roughness unknown."""


@dataclass(frozen=True, slots=True)
class Segment:
    """A stretch of a recording in which one label holds.

    Parameters
    ----------
    start, end
        In seconds since the recording began.
    word
        One of :data:`WORDS`.

    Examples
    --------
    >>> Segment(0.3, 5.17, "contact").contact, Segment(5.17, 6.0, "none").label
    (True, <Touch.NONE: 0>)
    """

    start: float
    end: float
    word: str

    @property
    def label(self) -> Touch | None:
        """What is felt, or ``None`` where that is not known."""
        return WORDS[self.word]

    @property
    def contact(self) -> bool:
        """Whether the finger touches anything."""
        return self.label is not Touch.NONE


def touch_at(time: float, segments: Iterable[Segment]) -> int:
    """Give the number of the `Touch` that holds at a time, or -1 where nobody knows: as telemetry tells a truth.

    Examples
    --------
    >>> touch_at(1.0, [Segment(0.0, 2.0, "rough")]), touch_at(3.0, [Segment(0.0, 2.0, "rough")])
    (2, -1)
    """
    here = (one.label for one in segments if one.start <= time < one.end and one.label is not None)
    return int(next(here, -1))


@dataclass(frozen=True, slots=True)
class Recording:
    """One sound file and what is known of it.

    Parameters
    ----------
    path
        The WAV or FLAC file.
    surface
        The thing touched; splits keep all recordings of a surface on one side.
    label
        A person's word for the whole recording; ``None`` if ambiguous, mixed or unknown.
    channels
        What each channel holds, ``"contact"`` or ``"air"``, in the file's order; empty if unknown.
    take, scenario, session, tier
        Which of the surface's recordings it is, how the object was held, the day, and how far the label is trusted.
    segments
        Where labels change in time.
    properties
        Whatever else the manifest tells, such as ``pressure``, ``stroke``, ``material`` or ``licence``.
    """

    path: Path
    surface: str
    label: Touch | None = None
    channels: tuple[str, ...] = ()
    take: str = ""
    scenario: str = ""
    session: str = ""
    tier: str = ""
    segments: tuple[Segment, ...] = ()
    properties: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}), hash=False)

    def __reduce__(self) -> tuple[Any, ...]:
        """Travel to other processes, which a read-only view of properties does not by itself."""
        *values, properties = (getattr(self, one.name) for one in fields(self))
        return _arrived, (*values, dict(properties))

    def known(self, name: str) -> str:
        """Give a field or a property as text, empty if nothing is known: what splits group by.

        >>> Recording(Path("a.wav"), "slate", Touch.ROUGH, properties={"pressure": "light"}).known("pressure")
        'light'
        """
        value = self.properties[name] if name in self.properties else getattr(self, name, "")
        return value.name.lower() if isinstance(value, Touch) else str(value or "")


def _arrived(*values: Any) -> Recording:
    *others, properties = values
    return replace(Recording(*others), properties=MappingProxyType(properties))


@dataclass(frozen=True, slots=True)
class Problem:
    """Something wrong with a file or a manifest's line, in words that say what to do.

    ``fatal`` is true when the file cannot be used at all; otherwise it is merely suspicious.
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

    ``problems`` are those met while reading the manifest; the lines concerned are left out or corrected, as told.
    """

    name: str
    root: Path
    recordings: tuple[Recording, ...]
    problems: tuple[Problem, ...] = ()

    @property
    def surfaces(self) -> tuple[str, ...]:
        """The surfaces, sorted."""
        return tuple(sorted({recording.surface for recording in self.recordings}))

    def where(self, keep: Callable[[Recording], bool]) -> "Dataset":
        """Keep some of the recordings."""
        return Dataset(self.name, self.root, tuple(filter(keep, self.recordings)), self.problems)

    def labelled(self) -> "Dataset":
        """Keep the recordings that a person called smooth or rough.

        Raises
        ------
        DatasetError
            If there are none.
        """
        kept = self.where(lambda recording: recording.label in (Touch.SMOOTH, Touch.ROUGH))
        if not kept.recordings:
            raise DatasetError(
                f"{self.root}: none of its {len(self.recordings)} recordings is labelled smooth or rough; "
                "fill in the manifest's label column"
            )
        return kept

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 over every file's name, surface, label and bytes: changes when anything a model learns from does."""
        return fingerprint(self.recordings)


def fingerprint(recordings: Iterable[Recording]) -> str:
    """Hash recordings by content, whatever their order and wherever their folder lies; missing files count as empty."""
    total = hashlib.sha256()
    for recording in sorted(recordings, key=lambda one: (one.path.name, one.surface)):
        total.update(f"{recording.path.name}\0{recording.surface}\0{recording.known('label')}\0".encode())
        if recording.path.is_file():
            stat = recording.path.stat()
            total.update(_digest(recording.path, stat.st_mtime_ns, stat.st_size))
    return total.hexdigest()


@functools.lru_cache(maxsize=1 << 16)
def _digest(path: Path, changed_ns: int, byte_count: int) -> bytes:
    """Hash a file's bytes, once for each state of it: cross-validation asks in every fold."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").digest()
