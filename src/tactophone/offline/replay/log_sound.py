"""The sound in a log: its packets decoded as the operator decoded them, concealment included."""

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import cast

import numpy as np
import soundfile

from tactophone.bridges import LogEntry, read_log
from tactophone.errors import DatasetError
from tactophone.link import Address, Connected, DecodedAudio, LoggedSession, ReceiveSession, Session
from tactophone.offline.replay.logged_run import WakeUp, wake_ups
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


def write_sound(log: Path, folder: Path) -> list[Path]:
    """Write the sound of each session of a log as WAV with 32-bit floats, which hold it exactly.

    Raises
    ------
    DatasetError
        If the log holds no sound, as one of a link that carries predictions only.
    """
    paths = []
    for number, blocks in enumerate(decoded_sessions(read_log(log)), 1):
        name = log.stem if number == 1 else f"{log.stem}-{number}"
        paths.append(folder / f"{name}.wav")
        soundfile.write(paths[-1], joined(blocks), LIVE_SAMPLE_RATE, subtype="FLOAT")
    if not paths:
        raise DatasetError(f"{log}: no sound in it; was it recorded with predictions sent in place of sound?")
    return paths
