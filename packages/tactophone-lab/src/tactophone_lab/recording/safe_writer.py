"""A writer that loses at most the last second of a take to a kill or a full disk.

A FLAC file whose writer was killed has no length in its header, and readers refuse it
(measured with libsndfile 1.2). A WAV file written without a buffer can be read to its
last block. So sound goes into ``TAKE.part.wav`` first, is copied into a FLAC when the
take ends, and the part is deleted when the FLAC is complete and in the manifest. A take
cut off in any of these steps is finished by :func:`recover`: ``TAKE.part.json`` holds
its entry for the manifest.

A retake takes the place of the take before it, unless it is shorter, as one that was
cut off: then both are kept.
"""

import json
import math
import os
from collections.abc import Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write, flush_to_disk, hold, make_room
from tactophone.core.recordings.links import refuse_link
from tactophone.core.recordings.metadata import (
    add_to_metadata,
    read_to_rewrite,
)
from tactophone.core.recordings.values import LABEL_NAMES, Recording
from tactophone.core.types import AudioBlock
from tactophone_lab.datasets.convert import copy_as_flac

PART = ".part.wav"
ENTRY = ".part.json"

LONGEST_HEADER = 128
"""Bytes before the first sample of a part file."""

SYNC_EVERY = 0.5
"""Seconds after which sound is flushed to the disk, so that it survives a power
failure; on a disk that takes longer, as soon as the flush before has ended."""


class TakeWriter:
    """Writes a take: :meth:`begin`, then :meth:`write`, then :meth:`finish` or
    :meth:`discard`.

    Sound is flushed in a thread of its own, as some disks take seconds for it.
    """

    def __init__(
        self, root: Path, recording: Recording, file: soundfile.SoundFile
    ) -> None:
        self.recording = recording
        self.size = 0
        self._root = root
        self._file = file
        self._unsynced = 0
        self._thread = ThreadPoolExecutor(1, "flush the take")
        self._flush: Future[None] | None = None
        self._noted = False

    @classmethod
    def begin(cls, root: Path, recording: Recording, *, sample_rate: int) -> Self:
        """Open the part file, and write the manifest entry beside it.

        Raises `DatasetError` if the folder cannot be written to, or sound that nothing
        describes is in the way.
        """
        path = recording.path
        refuse_link(path.parent, root)
        refuse_unknown_part(path)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _write_entry(recording)
            make_room(path.with_suffix(PART))
            file = soundfile.SoundFile(
                path.with_suffix(PART),
                "w",
                sample_rate,
                len(recording.channels),
                "PCM_24",
            )
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(
                f"{path}: cannot be written ({error}); free some space, or choose "
                "another --out"
            ) from None
        return cls(root, recording, file)

    def write(self, block: AudioBlock) -> None:
        """Add sound; raises `DatasetError` if the disk is full, with what was written
        kept."""
        try:
            self._file.write(block.samples)
            self._unsynced += block.size
            flushed = self._flush is None or self._flush.done()
            if flushed and self._unsynced >= SYNC_EVERY * block.sample_rate:
                self._await_flush()
                self._flush = self._thread.submit(self._flush_all)
                self._unsynced = 0
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(self._disk_error(error)) from None
        self.size += block.size

    def note(self, **properties: str) -> None:
        """Add properties to the take's entry; a kill loses them no more than sound."""
        self.recording = self.recording.with_properties(**properties)
        self._noted = True

    def finish(self, **properties: str) -> Recording:
        """Write the FLAC and its line in the manifest, with further properties.

        It gets another name where the take before it is longer. Raises `DatasetError`
        if the disk is full, or the manifest cannot be written again; the sound stays in
        the part file.
        """
        self._file.close()
        recording = self.recording.with_properties(**properties)
        try:
            self._await_flush()
            _write_entry(recording)
            return _finish(self._root, recording)
        except DatasetError as error:
            raise DatasetError(
                f"{error}. The take is kept: run the command again, and it is finished"
            ) from None
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(self._disk_error(error)) from None

    def discard(self) -> None:
        """Delete this take; an earlier take of the same name stays."""
        self._file.close()
        with suppress(OSError):
            self._await_flush()
        _discard(self.recording.path)

    def _flush_all(self) -> None:
        if self._noted:
            self._noted = False
            _write_entry(self.recording)
        flush_to_disk(self.recording.path.with_suffix(PART))

    def _await_flush(self) -> None:
        """Wait for the flush that is under way; raises `OSError` if it failed."""
        flush = self._flush
        self._flush = None
        if flush is not None:
            flush.result()

    def _disk_error(self, error: Exception) -> str:
        part = self.recording.path.with_suffix(PART)
        return (
            f"{part}: cannot go on ({error}); what was recorded is kept. Free some "
            "space and run the command again"
        )


@contextmanager
def recording_in(root: Path) -> Iterator[None]:
    """Hold a folder for one recorder at a time: another one would take its running take
    for one that was cut off.

    The lock is the system's, on the folder itself: it leaves no file, and ends with the
    process that holds it. Raises `DatasetError` if another recorder holds it, or the
    folder cannot be made.
    """
    made = not root.exists()
    try:
        str(root).encode()  # as the library of sound files has it
    except UnicodeEncodeError:
        raise DatasetError(
            f"{root}: its name is no UTF-8, and no sound file can be written there; "
            "choose another --out"
        ) from None
    try:
        root.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(root, os.O_RDONLY)
    except OSError as error:
        raise DatasetError(
            f"{root}: cannot be used ({error.strerror}); choose another --out"
        ) from None
    try:
        _lock(descriptor, root)
        yield
    finally:
        os.close(descriptor)
        with suppress(OSError):  # it holds recordings now
            if made:
                root.rmdir()


def _lock(descriptor: int, root: Path) -> None:
    if not hold(descriptor):
        raise DatasetError(
            f"{root}: another `tactophone record` is recording into it; wait for its "
            "end, or choose another --out"
        )


def recover(root: Path) -> Iterator[Recording]:
    """Finish every take in a folder that was cut off, and yield it.

    Raises `DatasetError` if the disk is too full to finish a take.
    """
    for draft in root.rglob(f".*{ENTRY}.part"):
        draft.unlink(missing_ok=True)
    for entry in sorted(root.rglob(f"*{ENTRY}")):
        recording = _read_entry(entry) if entry.is_file() else None
        if recording is None:
            continue
        part = recording.path.with_suffix(PART)
        try:
            # Where its quality is known, the take itself had ended, and only its
            # copying was cut off.
            ended = "quality" in recording.properties
            refuse_link(part, root)
            held = _seconds(part) if part.is_file() else 0.0
            if not held:
                # It has no sound, or is in the manifest already. The line of an earlier
                # take of the same name stays as it is.
                _discard(recording.path)
                continue
            if not ended:
                recording = recording.with_properties(
                    quality=f"cut off after {held:.1f} s"
                )
            yield _finish(root, recording)
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(
                f"{entry.parent}: cannot finish {recording.path.name} ({error}); free "
                "some space"
            ) from None


def refuse_unknown_part(path: Path) -> None:
    """Raise `DatasetError` if a take at ``path`` would begin over the sound of one that
    was cut off, and that :func:`recover` could not finish without its entry."""
    part = path.with_suffix(PART)
    seconds = _seconds(part) if part.is_file() else 0.0
    if seconds:
        entry = path.with_suffix(ENTRY).name
        raise DatasetError(
            f"{part}: {seconds:.1f} s of a take that was cut off, and {entry}, which "
            "says what it is, is missing or damaged: move the sound away, or rename it "
            "and add its line to metadata.csv"
        )


def _discard(path: Path) -> None:
    """Delete what belongs to an unfinished take; a finished one of the same name
    stays."""
    for suffix in (PART, ENTRY):
        path.with_suffix(suffix).unlink(missing_ok=True)


def _seconds(part: Path) -> float:
    """Return how much sound is in a part file; 0 for one that ends in its header, as a
    full disk leaves it.

    Raises `DatasetError` for one that is no sound.
    """
    try:
        return float(soundfile.info(part).duration)
    except soundfile.LibsndfileError as error:
        if part.stat().st_size < LONGEST_HEADER:
            return 0.0
        raise DatasetError(
            f"{part}: is no sound that could be finished ({error}); move it away"
        ) from None


def _finish(root: Path, recording: Recording) -> Recording:
    part = recording.path.with_suffix(PART)
    listed = {each.path.resolve() for each in read_to_rewrite(root)}
    finished = replace(recording, path=_place(part, recording.path, listed))
    for path in (part, finished.path):
        refuse_link(path, root)
    copy_as_flac(part, finished.path)
    # Its line replaces the line of an earlier take of the same file.
    add_to_metadata(root, [finished])
    _discard(recording.path)
    return finished


def _place(part: Path, path: Path, listed: Collection[Path]) -> Path:
    """Return where the take of a part file is kept: at ``path``, or beside it where
    that is a longer take, or a file that the manifest does not list."""
    size = _samples(part)
    number = 1
    place = path
    while place.exists():
        taken = _samples(place)
        # An equal one is this take, whose finishing was cut off.
        if taken == size or (taken < size and place.resolve() in listed):
            break
        number += 1
        place = path.with_name(f"{path.stem}-{number}.flac")
    return place


def _samples(path: Path) -> float:
    """Return how many samples a sound file has; infinite for one that cannot be
    read."""
    try:
        return float(soundfile.info(path).frames)
    except soundfile.LibsndfileError:
        return math.inf


def _write_entry(recording: Recording) -> None:
    """Write the entry beside the old one and rename it: a full disk then leaves the old
    one whole."""
    fields: dict[str, Any] = {
        name: recording.known(name)
        for name in ("surface", "label", "take", "scenario", "session")
    }
    fields |= {
        "file": recording.path.name,
        "channels": recording.channels,
        "properties": dict(recording.properties),
    }
    with atomic_write(recording.path.with_suffix(ENTRY)) as draft:
        draft.write_text(json.dumps(fields), encoding="utf-8")


def _read_entry(entry: Path) -> Recording | None:
    """Read what :func:`_write_entry` wrote; of another version's entry, what is known
    here.

    An entry that cannot be read at all is left where it is while there is sound beside
    it, and deleted otherwise.
    """
    try:
        fields = json.loads(entry.read_text(encoding="utf-8"))
        # Raises where a name or a word could be written to no file.
        json.dumps(fields, ensure_ascii=False).encode()
        file = str(fields["file"])
        if file != f"{entry.name.removesuffix(ENTRY)}.flac":  # such as metadata.csv
            raise ValueError("file")
        path = entry.parent / file
        label = LABEL_NAMES[fields["label"]]
        channels = tuple(map(str, fields["channels"]))
        properties = {
            str(name): str(value) for name, value in dict(fields["properties"]).items()
        }
        names = ("surface", "take", "scenario", "session")
        surface, take, scenario, session = (str(fields.get(name, "")) for name in names)
    except (ValueError, KeyError, TypeError, RecursionError):
        if not entry.with_name(entry.name.removesuffix(ENTRY) + PART).exists():
            entry.unlink(missing_ok=True)
        return None
    return Recording(
        path,
        surface,
        label,
        channels,
        take=take,
        scenario=scenario,
        session=session,
        properties=properties,
    )
