"""The sound in a log: its packets decoded as the operator decoded them, concealment included."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import cast

import numpy as np
import soundfile

from tactophone.bridges import LogEntry, read_log
from tactophone.bridges.mcap import LogEnd, LogFile, read_messages
from tactophone.bridges.sound import SoundMessages
from tactophone.bridges.topics import topics_of
from tactophone.errors import ConfigError, DatasetError
from tactophone.hand import channels_of, names_of
from tactophone.link import Address, Connected, DecodedAudio, LoggedSession, ReceiveSession, Session
from tactophone.offline.replay.logged_run import WakeUp, settings_of, wake_ups
from tactophone.telemetry import RunStart
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray

_NOWHERE: Address = ("", 0)


def decoded_sessions(entries: Iterable[LogEntry]) -> Iterator[list[AudioBlock]]:
    """Return the blocks of sound of each session in a log; sessions without sound are left out."""
    logged = LoggedSession()
    session, blocks = ReceiveSession(cast(Session, logged)), list[AudioBlock]()
    for item in wake_ups(entries):
        if isinstance(item, RunStart):
            logged = LoggedSession()
            session = ReceiveSession(cast(Session, logged))
        if not isinstance(item, WakeUp):
            continue
        logged.polled = list(item.polled)
        events = session.receive([(content, _NOWHERE) for content in item.received], now=item.time)
        for event in [*events, *session.poll(item.time)]:
            match event:
                case DecodedAudio(block):
                    blocks.append(block)
                case Connected() if blocks:
                    yield blocks
                    blocks = []
    if blocks:
        yield blocks


def joined(blocks: Iterable[AudioBlock]) -> FloatArray:
    """Join blocks to one array, ``(samples, channels)``; gaps too long to be concealed are silence."""
    parts: list[FloatArray] = []
    reached = 0
    for block in blocks:
        if block.start > reached and parts:
            parts.append(np.zeros((block.start - reached, block.channels), np.float32))
        parts.append(block.samples)
        reached = block.end
    channels = max(part.shape[1] for part in parts)
    return np.concatenate([part if part.shape[1] == channels else np.repeat(part, channels, axis=1) for part in parts])


@dataclass(frozen=True, slots=True)
class SessionSound:
    """The sound of one session of a log, counted from 1, at one finger; its name is empty for the only one."""

    path: Path
    session: int
    finger: str = ""


def write_sound(log: Path, folder: Path, *, finger: str = "") -> list[SessionSound]:
    """Write the sound of each session and finger, or of one, as WAV with 32-bit floats, which hold it exactly.

    Raises `DatasetError` if the log holds no sound, as one of a link that carries predictions only, or has no such
    finger.
    """
    start = next((entry for entry in read_log(log) if isinstance(entry, RunStart)), RunStart(role=""))
    settings = settings_of(start)
    names, channels = names_of(settings), channels_of(settings, alone=2)
    if finger and finger not in names:
        known = f"there are {', '.join(names)}" if any(names) else "it is of a single one"
        raise DatasetError(f"{log}: no finger {finger!r} in this log; {known}")
    written = []
    for number, blocks in enumerate(decoded_sessions(read_log(log)), 1):
        sound = joined(blocks)
        if max(1, sound.shape[1] // 2) != len(names):
            continue  # of a robot with another number of fingers, which the operator refused
        for place, (name, count) in enumerate(zip(names, channels, strict=True)):
            if finger in ("", name):
                parts = (log.stem, name, "" if number == 1 else str(number))
                path = folder / f"{'-'.join(filter(None, parts))}.wav"
                soundfile.write(path, sound[:, 2 * place : 2 * place + count], LIVE_SAMPLE_RATE, subtype="FLOAT")
                written.append(SessionSound(path, number, name))
    if not written:
        raise DatasetError(f"{log}: no sound in it; was it recorded with predictions sent in place of sound?")
    return written


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
    except OSError as error:
        raise ConfigError(f"cannot write {path} ({error.strerror}): choose another file for --audio") from error
    return path
