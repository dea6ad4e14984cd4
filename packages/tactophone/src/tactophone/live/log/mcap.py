"""Logs of runs as MCAP files: written from outside the run's process, and read back in
the order of writing.

A file is read as a stream, so that one whose writer was killed is read to its last
chunk.
"""

import errno
import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, Self, TypeAlias

import msgspec

from tactophone.core.errors import ConfigError, DatasetError
from tactophone.core.prediction_fields import PREDICTION_FIELDS, prediction_of
from tactophone.core.processes import (
    atomic_write,
    flush_open_file,
    hold,
    make_private,
)
from tactophone.core.types import (
    EVENT_KINDS,
    MOST_FINGERS,
    HapticCommand,
    Prediction,
    Touch,
)
from tactophone.live.log import log_topics
from tactophone.live.log.log_topics import Message, Topic, topics_of
from tactophone.live.log.reader import RunReader, words_for_missed
from tactophone.live.telemetry.records import Controls, EventBatch, RunStart

LOG_READ_INTERVAL = 0.2
"""Seconds between two reads: telemetry keeps 10 s of packets and over a minute of
predictions."""

CHUNK_INTERVAL = 4
"""Reads in one chunk, 0.8 s: the disk then lacks under 1 s after a kill, and a chunk is
long enough to compress."""

FORMAT = "tactophone 5"
"""Profile in the header of the file; a later layout gets a later number."""

MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of every MCAP file."""

CHUNK_SIZE = 1 << 20
"""Bytes after which the writer ends a chunk by itself."""

LARGEST_CHUNK = 64 << 20
"""Bytes of a chunk once it is decompressed, and of a record outside of chunks; the
writer's own have 1 MB or little more. Nothing of a larger one is made."""


LARGEST_SCHEMA = 1 << 16
"""Bytes of a schema; the largest of a log has a few thousand."""

LONGEST_WORDS = 1000
"""Characters of a topic's name and description."""

MOST_TOPICS = 1000
"""Topics and schemas of a log; a hand of ten fingers has under a hundred."""

UNREADABLE = (ValueError, KeyError, TypeError, AttributeError, RecursionError)
"""What parsing a message of a log from anywhere may raise."""


class LogFile(AbstractContextManager["LogFile", None]):
    """An MCAP file of the library's own writer, with chunks (zstd) and an index; a
    context manager.

    ``ended``: whether it has its end, with the index.

    Raises `OSError` when the file cannot be written.
    """

    def __init__(self, path: Path, written: Sequence[Topic]) -> None:
        from mcap.writer import Writer

        self.metadata: dict[str, str] = {"format": FORMAT}
        self.ended = False
        self._path = path
        make_private(path)  # nobody else on this machine hears the sound in it
        self._file = path.open("wb")
        hold(self._file.fileno())
        self._writer: Any = Writer(self._file, chunk_size=CHUNK_SIZE)
        self._writer.start(profile=FORMAT, library="tactophone")
        schemas = {topic.schema.name: topic.schema for topic in written}
        numbers = {
            name: self._writer.register_schema(name, schema.encoding, schema.data)
            for name, schema in schemas.items()
        }
        self._channels = {
            topic.name: self._writer.register_channel(
                topic.name,
                topic.schema.message_encoding,
                numbers[topic.schema.name],
                {"description": topic.words, "finger": str(topic.finger)},
            )
            for topic in written
        }
        try:
            self._file.flush()
        except OSError:
            self._leave_no_empty_file()
            raise

    def __exit__(self, *_: object) -> None:
        # A full disk has been reported by `end_chunk`; the index is then missing, and
        # the chunks are there.
        with suppress(OSError, ValueError):
            self._writer.add_metadata("tactophone", self.metadata)
            self._writer.finish()
            self._write_to_disk()
            self.ended = True
        self._leave_no_empty_file()

    def _leave_no_empty_file(self) -> None:
        """Close the file, and remove it if a full disk took none of it."""
        with suppress(OSError, ValueError):
            self._file.close()
        with suppress(OSError):
            # A device, such as /dev/full, is nobody's to remove.
            if self._path.is_file() and self._path.stat().st_size == 0:
                self._path.unlink()

    def write(self, message: Message) -> None:
        nanoseconds = round(message.time * 1e9)
        channel = self._channels[message.topic.name]
        self._writer.add_message(channel, nanoseconds, message.data, nanoseconds)

    def end_chunk(self) -> None:
        """Bring what was written so far to the disk, so that it outlives this process
        and a power failure."""
        self._writer.flush()
        self._write_to_disk()

    def _write_to_disk(self) -> None:
        # A system left to itself may take half a minute.
        self._file.flush()
        flush_open_file(self._file.fileno())


@contextmanager
def copied_log(path: Path, written: Sequence[Topic]) -> Iterator[LogFile]:
    """Yield a log to fill; it replaces what is at ``path`` when it is whole.

    Raises `OSError` when it cannot be written; ``path`` is then what it was.
    """
    with atomic_write(path) as unfinished:
        with LogFile(unfinished, written) as log:
            yield log
        if not log.ended:
            raise OSError(errno.EIO, "its end could not be written", str(path))


class McapLog:
    """Keeps a run in an MCAP file, which it overwrites; a context manager.

    Call `read` every `LOG_READ_INTERVAL`.

    Raises `ConfigError` when the file cannot be written.
    """

    interval = LOG_READ_INTERVAL
    title = "the recorder"

    def __init__(self, name: str, path: Path) -> None:
        self.path = path
        self._reader = RunReader(name)
        self._reads = 0

    def __enter__(self) -> Self:
        try:
            self._log = LogFile(self.path, topics_of(self._reader.names, sound=False))
        except OSError as error:
            raise ConfigError(
                f"cannot write {self.path} ({error.strerror}): choose another file "
                "for --record"
            ) from error
        return self

    def __exit__(self, *error: object) -> None:
        self._log.metadata["missed"] = json.dumps(self._reader.missed)
        self._log.__exit__(*error)

    def lost(self) -> str:
        return words_for_missed(self._reader.missed)

    def read(self) -> None:
        """Write what is new; raises `ConfigError` when the disk is full or gone: the
        log ends, not the run."""
        try:
            for message in self._reader.read():
                self._log.write(message)
            self._reads += 1
            if self._reads % CHUNK_INTERVAL == 0:
                self._log.end_chunk()
        except OSError as error:
            raise ConfigError(
                f"{self.path}: the log ends here ({error.strerror}); the run goes on"
            ) from error


@dataclass(frozen=True, slots=True)
class LoggedPrediction:
    """A prediction and its command, of one finger; the command is NaN where there was
    none."""

    prediction: Prediction
    command: HapticCommand
    finger: int = 0


@dataclass(frozen=True, slots=True)
class LogEnd:
    """The end of the file; ``complete`` if its writer ended in order, ``missed`` what
    it could not read in time: predictions, and bytes of the session log."""

    complete: bool
    missed: Mapping[str, int] = field(default_factory=dict)


LogEntry: TypeAlias = RunStart | EventBatch | Controls | LoggedPrediction | LogEnd


def is_mcap(path: Path) -> bool:
    """Return whether a file begins as a log does; a pipe, which may never begin, does
    not."""
    if not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def read_log(path: Path) -> Iterator[LogEntry]:
    """Return the entries of a log, in their order.

    Raises `DatasetError` if the file is missing, no MCAP, or not of this program, or
    holds a message that cannot be read.
    """
    for message in read_messages(path):
        if isinstance(message, LogEnd):
            yield message
            continue
        topic = message.topic
        data = message.data
        try:
            if topic.name == log_topics.PACKETS.name:
                yield from msgspec.json.decode(data, type=log_topics.Packets).arrivals
            elif topic.name == log_topics.RUN.name:
                yield msgspec.json.decode(data, type=RunStart)
            elif topic.name == log_topics.CONTROLS.name:
                yield msgspec.json.decode(data, type=Controls)
            elif topic.kind == log_topics.PREDICTION_TOPIC.kind:
                yield _prediction_of(
                    msgspec.json.decode(data, type=dict[str, float | str | None]),
                    topic.finger,
                )
        except UNREADABLE as error:
            raise DatasetError(
                f"{path}: a message of {topic.name} cannot be read ({error}); was the "
                "file changed?"
            ) from error


def read_messages(path: Path) -> Iterator[Message | LogEnd]:
    """Return the messages of a log as they are, and at last its end.

    Raises `DatasetError` as `read_log` does, except for the content of a message.
    """
    if path.exists() and not (path.is_file() or path.is_dir()):  # it may never end
        raise DatasetError(f"{path}: no regular file; give a file written by --record")
    try:
        with path.open("rb") as file:
            yield from _messages(path, file)
    except OSError as error:
        raise DatasetError(
            f"{path}: {error.strerror}; give a file written by --record"
        ) from error


def _messages(path: Path, file: BinaryIO) -> Iterator[Message | LogEnd]:
    from mcap.exceptions import EndOfFile, McapError, RecordLengthLimitExceeded
    from mcap.records import Channel, DataEnd, Header, Metadata, Schema
    from mcap.records import Message as Record

    if file.read(len(MAGIC)) != MAGIC:
        raise DatasetError(f"{path}: not an MCAP file; give a file written by --record")
    file.seek(0)
    schemas: dict[int, log_topics.Schema] = {}
    channels: dict[int, Topic] = {}
    complete = False
    missed = {"predictions": 0, "log": 0}
    found = False
    try:
        for record in _records(path, file):
            match record:
                case Header(profile=profile):
                    _check_profile(path, profile)
                case Schema(id=number, name=name, encoding=encoding, data=data):
                    if len(data) > LARGEST_SCHEMA or len(schemas) > MOST_TOPICS:
                        raise ValueError("schemas that no log of this program has")
                    schemas[number] = log_topics.Schema(name, encoding, data)
                case Channel(
                    id=number, topic=name, schema_id=schema, metadata=metadata
                ):
                    finger = int(metadata.get("finger", "0"))
                    if not (0 <= finger < MOST_FINGERS and name.isprintable()):
                        raise ValueError(f"a topic {name[:99]!r} of finger {finger}")
                    words = metadata.get("description", "")
                    if len(name + words) > LONGEST_WORDS or len(channels) > MOST_TOPICS:
                        raise ValueError("topics that no log of this program has")
                    channels[number] = Topic(name, schemas[schema], words, finger)
                case Record(channel_id=number, log_time=time, data=data) if (
                    number in channels
                ):
                    found = True
                    yield Message(channels[number], time / 1e9, data)
                case Metadata(name="tactophone", metadata=metadata):
                    stated = msgspec.json.decode(
                        metadata.get("missed", "{}"), type=dict[str, int]
                    )
                    missed |= {name: stated.get(name, 0) for name in missed}
                case DataEnd():
                    complete = True
                    break
    except (EndOfFile, RecordLengthLimitExceeded):
        # Its writer was killed, or a changed byte made a record longer than the file.
        pass
    except (
        McapError,
        struct.error,
        ValueError,
        KeyError,
        EOFError,
        OverflowError,
        MemoryError,
    ) as error:
        if not found:
            raise DatasetError(
                f"{path}: a damaged MCAP file ({error}); nothing in it can be read"
            ) from error
    yield LogEnd(complete, missed)


def _records(path: Path, file: BinaryIO) -> Iterator[Any]:
    """Return the records of a file, inside and outside of chunks. The library would
    unpack a chunk to whatever size the chunk claims."""
    from mcap.exceptions import EndOfFile
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader

    size = min(path.stat().st_size, LARGEST_CHUNK)
    for record in StreamReader(file, emit_chunks=True, record_size_limit=size).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        data = _decompressed(record)
        if len(data) > LARGEST_CHUNK:
            raise DatasetError(
                f"{path}: a chunk of over {LARGEST_CHUNK >> 20} MB, but --record "
                "writes chunks of 1 MB; was it changed?"
            )
        with suppress(EndOfFile):
            # A message may be longer than all of a short log, which is compressed.
            limit = len(data)
            yield from StreamReader(
                BytesIO(data),
                skip_magic=True,
                emit_chunks=True,
                record_size_limit=limit,
            ).records


def _decompressed(chunk: Any) -> bytes:
    """Decompress a chunk, up to one byte more than `LARGEST_CHUNK`; raises `ValueError`
    for a damaged one."""
    if chunk.compression == "zstd":
        import zstandard

        try:
            return (
                zstandard.ZstdDecompressor()
                .stream_reader(chunk.data)
                .read(LARGEST_CHUNK + 1)
            )
        except zstandard.ZstdError as error:
            raise ValueError(str(error)) from error
    if chunk.compression == "lz4":  # of other programs that rewrite a log
        from lz4 import frame  # type: ignore[import-untyped]

        try:
            return bytes(
                frame.LZ4FrameDecompressor().decompress(chunk.data, LARGEST_CHUNK + 1)
            )
        except RuntimeError as error:
            raise ValueError(str(error)) from error
    if chunk.compression:
        raise ValueError(f"a chunk compressed with {chunk.compression!r}")
    return bytes(chunk.data)


def _check_profile(path: Path, profile: str) -> None:
    if profile == FORMAT:
        return
    if profile.partition(" ")[0] == FORMAT.partition(" ")[0]:
        raise DatasetError(
            f"{path}: the format is {profile!r}, this version reads {FORMAT!r}; use "
            "the version that wrote it"
        )
    raise DatasetError(
        f"{path}: an MCAP file of another program (profile {profile!r}); give one "
        "written by --record"
    )


def _prediction_of(entries: dict[str, Any], finger: int) -> LoggedPrediction:
    """Return a prediction and its command again; a number left out is NaN, a level left
    out silence."""
    row = (
        dict.fromkeys((field.name for field in PREDICTION_FIELDS), math.nan)
        | {"level_dbfs": -math.inf}
        | entries
    )
    row |= {
        "touch": Touch[entries["touch"].upper()],
        "event": ("", *EVENT_KINDS).index(entries["event"]),
    }
    return LoggedPrediction(*prediction_of(row), finger)
