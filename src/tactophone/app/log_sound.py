"""The sound in the log of a run: decoded, written as WAV, and added to the log for Foxglove to play."""

import itertools
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import soundfile

from tactophone.app.logged_run import NOWHERE, WakeUp, open_session, settings_of, wake_ups
from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.hand import channels_of, names_of
from tactophone.core.processes import make_room
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray
from tactophone.live.log.log_topics import topics_of
from tactophone.live.log.mcap import LogEnd, LogEntry, LogFile, read_log, read_messages
from tactophone.live.log.sound import SoundMessages
from tactophone.live.telemetry.records import RunStart
from tactophone.net.link.events import Connected
from tactophone.net.link.stream import DecodedAudio

LONGEST_GAP = 1.0
"""Seconds without sound that are rendered as silence; a longer gap, such as a night, is noted and left out."""


class SoundDecoder:
    """Decodes the sound of a log as it comes: ``push`` takes its next entries."""

    def __init__(self) -> None:
        self._logged, self._session = open_session()

    def push(self, entries: Iterable[LogEntry]) -> Iterator[AudioBlock | Connected]:
        """Yield the blocks of sound, and where another session begins."""
        for item in wake_ups(entries):
            if isinstance(item, RunStart):
                self._logged, self._session = open_session()
            if not isinstance(item, WakeUp):
                continue
            self._logged.polled = list(item.polled)
            events = self._session.receive([(content, NOWHERE) for content in item.received], now=item.time)
            for event in [*events, *self._session.poll(item.time)]:
                match event:
                    case DecodedAudio(block):
                        yield block
                    case Connected():
                        yield event


def decoded_blocks(entries: Iterable[LogEntry]) -> Iterator[tuple[int, AudioBlock]]:
    """Yield the blocks of sound in a log, each with the number of its session; a gap over `LONGEST_GAP` begins one."""
    number, reached = 0, None
    for item in SoundDecoder().push(entries):
        if not isinstance(item, AudioBlock):
            reached = None
            continue
        if reached is None or not 0 <= item.start - reached <= LONGEST_GAP * LIVE_SAMPLE_RATE:
            number += 1
        reached = item.end
        yield number, item


@dataclass(frozen=True, slots=True)
class SessionSound:
    """The sound of one session of a log, counted from 1, at one finger; its name is empty for the only one."""

    path: Path
    session: int
    finger: str = ""


def write_sound(log: Path, folder: Path, *, finger: str = "") -> list[SessionSound]:
    """Write the sound of each session and finger, or of one, as WAV with 32-bit floats, which hold it exactly.

    Gaps too long to be concealed are silence; over `LONGEST_GAP` another file begins. Raises `DatasetError` if the log
    has no such finger or no sound: a link may carry predictions only.
    """
    start = next((entry for entry in read_log(log) if isinstance(entry, RunStart)), RunStart(role=""))
    settings = settings_of(start)
    names, channels = names_of(settings), channels_of(settings, alone=2)
    if finger and finger not in names:
        known = f"there are {', '.join(names)}" if any(names) else "it has a single, unnamed finger"
        raise DatasetError(f"{log}: no finger {finger!r} in this log; {known}")
    written: list[SessionSound] = []
    for number, group in itertools.groupby(decoded_blocks(read_log(log)), key=lambda each: each[0]):
        blocks = (block for _, block in group)
        first = next(blocks)
        if max(1, first.channels // 2) != len(names):
            continue  # of a robot with another number of fingers, which the operator refused
        with ExitStack() as stack:
            files = []
            for place, (name, count) in enumerate(zip(names, channels, strict=True)):
                if finger in ("", name):
                    parts = (log.stem, name, "" if number == 1 else str(number))
                    path = folder / f"{'-'.join(filter(None, parts))}.wav"
                    make_room(path)
                    columns = slice(2 * place, min(2 * place + count, first.channels))
                    size = columns.stop - columns.start
                    file = soundfile.SoundFile(path, "w", LIVE_SAMPLE_RATE, size, "FLOAT")
                    files.append((stack.enter_context(file), columns))
                    written.append(SessionSound(path, number, name))
            for samples in _without_gaps(itertools.chain([first], blocks)):
                for file, columns in files:
                    file.write(samples[:, columns])
    if not written:
        raise DatasetError(f"{log}: no sound in it; was it recorded with predictions sent in place of sound?")
    return written


def _without_gaps(blocks: Iterable[AudioBlock]) -> Iterator[FloatArray]:
    """Yield the samples of blocks with silence between them where some are missing, all with as many channels."""
    reached = channels = 0
    for block in blocks:
        channels = channels or block.channels
        if reached and block.start > reached:
            yield np.zeros((block.start - reached, channels), np.float32)
        reached = block.end
        yield block.samples if block.channels == channels else np.repeat(block.samples, channels, axis=1)[:, :channels]


def add_sound(log: Path, path: Path) -> Path:
    """Copy a log and add its sound as topics that Foxglove plays: Opus as it came, or samples of 16 bits.

    Raises `DatasetError` if the log cannot be read, and `ConfigError` if the copy cannot be written.
    """
    start = next((entry for entry in read_log(log) if isinstance(entry, RunStart)), RunStart(role=""))
    names = names_of(settings_of(start))
    if path.exists() and path.samefile(log):
        raise ConfigError(f"{path}: the log itself; name another file")
    sound = SoundMessages(names)
    try:
        with LogFile(path, topics_of(names, sound=True)) as copy:
            for message in read_messages(log):
                if isinstance(message, LogEnd):
                    added = sound.flush()
                else:
                    added = sound.push(message.topic.name, message.data)
                    copy.write(message)
                for each in added:
                    copy.write(each)
    except ValueError as error:
        raise DatasetError(f"{log}: a message cannot be read ({error}); was the file changed?") from error
    except OSError as error:
        raise ConfigError(f"cannot write {path} ({error.strerror}): choose another file for --audio") from error
    return path
