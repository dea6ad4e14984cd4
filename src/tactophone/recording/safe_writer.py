"""Writes a take so that neither a kill nor a full disk loses more than the last second.

A FLAC file whose writer was killed has no length in its header, and readers refuse it (measured with libsndfile 1.2).
A WAV file written without a buffer can be read to its last block. So sound goes into ``TAKE.part.wav`` first, is copied
into a FLAC when the take ends, and the part goes when the FLAC is whole and the manifest names it. What is cut off, in
whatever step, :func:`recover` finishes later: ``TAKE.part.json`` says what the manifest should.
"""

import dataclasses
import json
import os
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Self

import soundfile

from tactophone.dataset.metadata import FILE_NAME, read_metadata, write_metadata
from tactophone.dataset.values import WORDS, Recording
from tactophone.errors import DatasetError
from tactophone.types import AudioBlock

PART = ".part.wav"
STORY = ".part.json"
READ_SIZE = 1 << 16

SYNC_EVERY = 0.5
"""Seconds after which sound is sure to be on the disk, even if the power fails."""


class TakeFile:
    """A take being written: :meth:`begin`, then :meth:`write`, then :meth:`finish` or :meth:`discard`."""

    def __init__(self, root: Path, recording: Recording, file: soundfile.SoundFile) -> None:
        self.recording = recording
        self.size = 0
        self._root, self._file = root, file
        self._unsynced = 0

    @classmethod
    def begin(cls, root: Path, recording: Recording, *, sample_rate: int) -> Self:
        """Open the part file and write down what the manifest will say.

        Raises
        ------
        DatasetError
            If the folder cannot be written to.
        """
        path = recording.path
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_suffix(STORY).write_text(_tell(recording), encoding="utf-8")
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
                _sync(self.recording.path.with_suffix(PART))
                self._unsynced = 0
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(self._lost(str(error))) from None
        self.size += block.size

    def finish(self, **properties: str) -> Recording:
        """Make the FLAC and its line in the manifest, with further properties.

        Raises
        ------
        DatasetError
            If the disk is full; the sound stays in the part file.
        """
        self._file.close()
        told = {**self.recording.properties, **properties}
        recording = dataclasses.replace(self.recording, properties=MappingProxyType(told))
        try:
            recording.path.with_suffix(STORY).write_text(_tell(recording), encoding="utf-8")
            return _finish(self._root, recording)
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(self._lost(str(error))) from None

    def discard(self) -> None:
        """Forget this take; an earlier one of the same name stays."""
        self._file.close()
        for suffix in (PART, STORY):
            self.recording.path.with_suffix(suffix).unlink(missing_ok=True)

    def _lost(self, reason: str) -> str:
        part = self.recording.path.with_suffix(PART)
        return f"{part}: cannot go on ({reason}); what was recorded is kept. Free some space and run the command again"


def recover(root: Path) -> Iterator[Recording]:
    """Finish every take below a folder that was cut off, as far as it had come; gives each.

    Raises
    ------
    DatasetError
        If one cannot be finished, for want of space.
    """
    for story in sorted(root.rglob(f"*{STORY}")):
        recording = _read_story(story)
        if recording is None:
            continue
        try:
            yield _finish(root, _cut_off(recording))
        except (OSError, soundfile.LibsndfileError) as error:
            raise DatasetError(
                f"{story.parent}: cannot finish {recording.path.name} ({error}); free some space"
            ) from None


def _cut_off(recording: Recording) -> Recording:
    """Say that a take ended early, unless it was judged and only its copying was cut off."""
    part = recording.path.with_suffix(PART)
    if "verdict" in recording.properties or not part.is_file():
        return recording
    told = {**recording.properties, "verdict": f"cut off after {soundfile.info(part).duration:.1f} s"}
    return dataclasses.replace(recording, properties=MappingProxyType(told))


def _finish(root: Path, recording: Recording) -> Recording:
    part, whole = recording.path.with_suffix(PART), recording.path.with_suffix(".part.flac")
    if part.is_file() and soundfile.info(part).frames:
        with soundfile.SoundFile(part) as wav:
            with soundfile.SoundFile(whole, "w", wav.samplerate, wav.channels, "PCM_24") as flac:
                for samples in wav.blocks(READ_SIZE, dtype="int32"):
                    flac.write(samples)
            if soundfile.info(whole).frames != len(wav):
                raise OSError("the copy is shorter than the take")
        _sync(whole)
        os.replace(whole, recording.path)
    if recording.path.is_file():
        _enlist(root, recording)
    part.unlink(missing_ok=True)
    recording.path.with_suffix(STORY).unlink(missing_ok=True)
    return recording


def _enlist(root: Path, recording: Recording) -> None:
    """Put the recording into the manifest, in the place of an earlier one of the same file."""
    known = read_metadata(root).recordings if (root / FILE_NAME).is_file() else ()
    kept = [one for one in known if one.path.resolve() != recording.path.resolve()]
    write_metadata(root, (*kept, recording))


def _tell(recording: Recording) -> str:
    entries = {name: recording.known(name) for name in ("surface", "label", "take", "scenario", "session")}
    story = {"file": recording.path.name, "channels": recording.channels, "properties": dict(recording.properties)}
    return json.dumps({**entries, **story})


def _read_story(story: Path) -> Recording | None:
    """Read what :func:`_tell` wrote; a story that was itself cut off tells of a take without sound, and goes."""
    try:
        told = json.loads(story.read_text(encoding="utf-8"))
        path, label = story.parent / told.pop("file"), WORDS[told.pop("label")]
        channels, properties = tuple(told.pop("channels")), MappingProxyType(told.pop("properties"))
    except (ValueError, KeyError, TypeError):
        story.unlink(missing_ok=True)
        return None
    return Recording(path, label=label, channels=channels, properties=properties, **told)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
