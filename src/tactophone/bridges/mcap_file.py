"""Reads a log of `tactophone.bridges.mcap_log` back, in the order in which it was written.

The file is read as a stream, so that one whose writer was killed is read to its last chunk.
"""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from tactophone.bridges import schemas
from tactophone.bridges.chunk_writer import MAGIC
from tactophone.bridges.mcap_log import FORMAT
from tactophone.bridges.packet_coding import PacketReader
from tactophone.bridges.prediction_rows import LoggedPrediction, read_columns
from tactophone.errors import DatasetError
from tactophone.telemetry import Controls, EventBatch, RunStart


@dataclass(frozen=True, slots=True)
class LogEnd:
    """The end of the file; ``complete`` if its writer ended in order, ``missed`` what it could not read in time."""

    complete: bool
    missed: int = 0


_SOUND = {topic.kind for topic in (schemas.CONTACT_SOUND, schemas.AIR_SOUND, schemas.PCM_SOUND)}

LogEntry: TypeAlias = RunStart | EventBatch | Controls | LoggedPrediction | LogEnd


def is_mcap(path: Path) -> bool:
    """Whether a file begins as an MCAP file does."""
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def read_log(path: Path) -> Iterator[LogEntry]:
    """Return the entries of a log, in their order.

    Raises `DatasetError` if the file is missing, no MCAP, or not of this program, or holds a message that cannot be
    read.
    """
    try:
        with path.open("rb") as file:
            yield from _entries(path, file)
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror}; give a file written by --record") from error


def _entries(path: Path, file: BinaryIO) -> Iterator[LogEntry]:
    from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
    from mcap.records import Channel, DataEnd, Header, Message, Metadata
    from mcap.stream_reader import StreamReader

    if file.read(len(MAGIC)) != MAGIC:
        raise DatasetError(f"{path}: not an MCAP file; give a file written by --record")
    file.seek(0)
    channels: dict[int, tuple[str, int]] = {}
    packets = PacketReader()
    complete, missed, found = False, 0, False
    try:
        for record in StreamReader(file, record_size_limit=path.stat().st_size).records:
            match record:
                case Header(profile=profile):
                    _check_profile(path, profile)
                case Channel(id=number, topic=topic, metadata=metadata):
                    channels[number] = topic, int(metadata.get("finger", "0"))
                case Message(channel_id=number, data=data):
                    topic, finger = channels.get(number, ("", 0))
                    for entry in _read_message(path, topic, finger, data, packets):
                        found = True
                        yield entry
                case Metadata(name="tactophone", metadata=metadata):
                    missed = sum(json.loads(metadata.get("missed", "{}")).values())
                case DataEnd():
                    complete = True
                    break
    except (EndOfFile, RecordLengthLimitExceeded):
        pass  # its writer was killed, or a changed byte made a record longer than the file
    except (McapError, struct.error, ValueError, EOFError, OverflowError, MemoryError) as error:
        if not found:
            raise DatasetError(f"{path}: a damaged MCAP file ({error}); nothing in it can be read") from error
    except Exception as error:
        # The decompressor of a damaged chunk raises an exception of its own library.
        if type(error).__module__.partition(".")[0] not in ("zstandard", "lz4", "zstd"):
            raise
    yield LogEnd(complete, missed)


def _check_profile(path: Path, profile: str) -> None:
    if profile == FORMAT:
        return
    if profile.partition(" ")[0] == FORMAT.partition(" ")[0]:
        raise DatasetError(
            f"{path}: the format is {profile!r}, this version reads {FORMAT!r}; use the version that wrote it"
        )
    raise DatasetError(f"{path}: an MCAP file of another program (profile {profile!r}); give one written by --record")


def _read_message(path: Path, topic: str, finger: int, data: bytes, packets: PacketReader) -> Iterator[LogEntry]:
    kind = topic.rpartition("/")[2]
    try:
        if topic == schemas.PACKETS.name:
            yield from packets.decode(data)
        elif topic == schemas.RUN.name:
            yield RunStart(**_known(RunStart, json.loads(data)))
        elif topic == schemas.CONTROLS.name:
            yield Controls(**_known(Controls, json.loads(data)))
        elif topic.startswith("/tactophone/") and kind in _SOUND:
            packets.sound.add(finger, kind, data)
        elif topic.startswith("/tactophone/") and kind == schemas.PREDICTIONS.kind:
            yield from read_columns(data, finger)
    except (ValueError, KeyError, TypeError, IndexError, struct.error) as error:
        raise DatasetError(f"{path}: a message of {topic} cannot be read ({error}); was the file changed?") from error


def _known(kind: type, entries: dict[str, Any]) -> dict[str, Any]:
    """Leave out what a later version may have added."""
    names = {entry.name for entry in fields(kind)}
    return {name: value for name, value in entries.items() if name in names}
