"""A writer that loses at most the last second of a take to a kill or a full disk.

A FLAC file whose writer was killed has no length in its header, and readers refuse it (measured with libsndfile 1.2).
A WAV file written without a buffer can be read to its last block. So sound goes into ``TAKE.part.wav`` first, is copied
into a FLAC when the take ends, and the part is deleted when the FLAC is complete and in the manifest. A take cut off in
any of these steps is finished by :func:`recover`: ``TAKE.part.json`` holds its entry for the manifest.
"""

import dataclasses
import json
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import soundfile

from tactophone.dataset import FILE_NAME, LABEL_NAMES, Recording, read_metadata, write_metadata
from tactophone.dataset.converters import copy_as_flac, flush_to_disk
from tactophone.errors import DatasetError
from tactophone.types import AudioBlock

PART = ".part.wav"
ENTRY = ".part.json"

SYNC_EVERY = 0.5
"""Seconds after which sound is flushed to the disk, so that it survives a power failure."""


class TakeWriter:
    """Writes a take: :meth:`begin`, then :meth:`write`, then :meth:`finish` or :meth:`discard`."""

    def __init__(self, root: Path, recording: Recording, file: soundfile.SoundFile) -> None:
        self.recording = recording
        self.size = 0
        self._root, self._file = root, file
        self._unsynced = 0

    @classmethod
    def begin(cls, root: Path, recording: Recording, *, sample_rate: int) -> Self:
        """Open the part file, and write the manifest entry beside it.

        Raises
        ------
        DatasetError
            If the folder cannot be written to.
        """
        path = recording.path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_suffix(ENTRY).write_text(_entry_json(recording), encoding="utf-8")
            file = soundfile.SoundFile(path.with_suffix(PART), "w", sample_rate, len(recording.channels), "PCM_24")
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(
                f"{path}: cannot be written ({error}); free some space, or choose another --out"
            ) from None
        return cls(root, recording, file)

    def write(self, block: AudioBlock) -> None:
        """Add sound.

        Raises
        ------
        DatasetError
            If the disk is full; what was written is kept.
        """
        try:
            self._file.write(block.samples)
            self._unsynced += block.size
            if self._unsynced >= SYNC_EVERY * block.sample_rate:
                flush_to_disk(self.recording.path.with_suffix(PART))
                self._unsynced = 0
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(self._disk_error(error)) from None
        self.size += block.size

    def finish(self, **properties: str) -> Recording:
        """Write the FLAC and its line in the manifest, with further properties.

        Raises
        ------
        DatasetError
            If the disk is full; the sound stays in the part file.
        """
        self._file.close()
        merged = MappingProxyType({**self.recording.properties, **properties})
        recording = dataclasses.replace(self.recording, properties=merged)
        try:
            recording.path.with_suffix(ENTRY).write_text(_entry_json(recording), encoding="utf-8")
            return _finish(self._root, recording)
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(self._disk_error(error)) from None

    def discard(self) -> None:
        """Delete this take; an earlier take of the same name stays."""
        self._file.close()
        for suffix in (PART, ENTRY):
            self.recording.path.with_suffix(suffix).unlink(missing_ok=True)

    def _disk_error(self, error: Exception) -> str:
        part = self.recording.path.with_suffix(PART)
        return f"{part}: cannot go on ({error}); what was recorded is kept. Free some space and run the command again"


def recover(root: Path) -> Iterator[Recording]:
    """Finish every take in a folder that was cut off, and yield it.

    Raises
    ------
    DatasetError
        If the disk is too full to finish a take.
    """
    for entry in sorted(root.rglob(f"*{ENTRY}")):
        recording = _read_entry(entry)
        if recording is None:
            continue
        try:
            yield _finish(root, _cut_off(recording))
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(
                f"{entry.parent}: cannot finish {recording.path.name} ({error}); free some space"
            ) from None


def _cut_off(recording: Recording) -> Recording:
    """Note that a take ended early, unless its quality is known and only its copying was cut off."""
    part = recording.path.with_suffix(PART)
    if "quality" in recording.properties or not part.is_file():
        return recording
    quality = f"cut off after {soundfile.info(part).duration:.1f} s"
    properties = MappingProxyType({**recording.properties, "quality": quality})
    return dataclasses.replace(recording, properties=properties)


def _finish(root: Path, recording: Recording) -> Recording:
    part = recording.path.with_suffix(PART)
    if part.is_file() and soundfile.info(part).frames:
        copy_as_flac(part, recording.path)
    if recording.path.is_file():
        # Its line replaces that of an earlier take of the same file.
        known = read_metadata(root).recordings if (root / FILE_NAME).is_file() else ()
        path = recording.path.resolve()
        write_metadata(root, (*(other for other in known if other.path.resolve() != path), recording))
    part.unlink(missing_ok=True)
    recording.path.with_suffix(ENTRY).unlink(missing_ok=True)
    return recording


def _entry_json(recording: Recording) -> str:
    fields: dict[str, Any] = {
        name: recording.known(name) for name in ("surface", "label", "take", "scenario", "session")
    }
    fields |= {"file": recording.path.name, "channels": recording.channels, "properties": dict(recording.properties)}
    return json.dumps(fields)


def _read_entry(entry: Path) -> Recording | None:
    """Read what :func:`_entry_json` wrote; an incomplete entry has no sound yet, and is deleted."""
    try:
        fields = json.loads(entry.read_text(encoding="utf-8"))
        path, label = entry.parent / fields.pop("file"), LABEL_NAMES[fields.pop("label")]
        channels, properties = tuple(fields.pop("channels")), MappingProxyType(fields.pop("properties"))
    except (ValueError, KeyError, TypeError):
        entry.unlink(missing_ok=True)
        return None
    return Recording(path, label=label, channels=channels, properties=properties, **fields)
