"""Writes a run to an MCAP file, from outside its process."""

import itertools
import json
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Self

from tactophone.bridges.run_reader import Message, RunReader
from tactophone.bridges.schemas import (
    AIR_SOUND,
    CONTACT_SOUND,
    EVENTS,
    HEALTH,
    PCM_SOUND,
    PREDICTION,
    PREDICTIONS,
    STATE,
    Topic,
    topics_of,
)
from tactophone.errors import ConfigError

READ_INTERVAL = 0.2
"""Seconds between two reads: telemetry keeps 10 s of packets and over a minute of predictions."""

CHUNK_INTERVAL = 4
"""Reads in one chunk, 0.8 s: the disk then lacks under 1 s after a kill, and a chunk is long enough to compress."""

LOOKED_AT = 20
"""Predictions to look at in one chunk, about 4 s of them."""

COMPRESSION_LEVEL = 5
"""Of zstd; saves 0.1 MB in 10 minutes over the default; 16 would save as much again, but takes 10 ms for a chunk."""

TIME_STEP = 1 << 20
"""Nanoseconds, about one ms, of the times by which viewers order messages; whole steps compress to fewer bytes."""

FORMAT = "tactophone 3"
"""Profile in the header of the file; a later layout gets a later number."""

_PACKETS = 3  # after the sound, with all that is in the order of events
_GROUPS = {topic.kind: group for group, topic in enumerate((CONTACT_SOUND, AIR_SOUND, PCM_SOUND))} | {
    topic.kind: group for group, topic in enumerate((PREDICTIONS, PREDICTION, STATE, HEALTH, EVENTS), _PACKETS + 1)
}


def _group(message: Message) -> tuple[int, int]:
    return _GROUPS.get(message.topic.kind, _PACKETS), message.topic.finger


class McapLog:
    """Keeps a run in an MCAP file; a context manager whose `read` is called every `READ_INTERVAL`.

    Parameters
    ----------
    name
        Of a run that exists already.
    path
        The file, overwritten if it exists.

    Raises
    ------
    ConfigError
        When the file cannot be written.
    """

    interval = READ_INTERVAL

    def __init__(self, name: str, path: Path) -> None:
        self.path = path
        self._reader = RunReader(name, in_columns=True)
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._waiting: list[Message] = []
        self._held: list[Message] = []
        self._reads = 0

    def __enter__(self) -> Self:
        import zstandard
        from mcap import writer
        from mcap.writer import CompressionType, IndexType, Writer

        # The library has no setting for this.
        writer.zstandard = SimpleNamespace(compress=partial(zstandard.compress, level=COMPRESSION_LEVEL))
        try:
            self._file = self.path.open("wb")
            # A chunk is ended by `_end_chunk`, in time; its size never does. An index of messages would be a twentieth
            # of the file; viewers read files without one up to 1 GB, and `mcap recover` makes one.
            self._writer: Any = Writer(
                self._file, chunk_size=1 << 30, compression=CompressionType.ZSTD, index_types=IndexType.METADATA
            )
            self._writer.start(profile=FORMAT, library="tactophone")
            self._file.flush()
        except OSError as error:
            raise ConfigError(
                f"cannot write {self.path} ({error.strerror}): choose another file for --record"
            ) from error
        for topic in topics_of(self._reader.names):
            self._register(topic)
        return self

    def __exit__(self, *_: object) -> None:
        # A full disk has been reported by `read`; the index is then missing, and the chunks are there.
        with suppress(OSError, ValueError):
            self._waiting += self._held + self._reader.flush()
            self._write_waiting()
            self._writer.add_metadata("tactophone", {"format": FORMAT, "missed": json.dumps(self._reader.missed)})
            self._writer.finish()
        with suppress(OSError, ValueError):
            self._file.close()

    def read(self) -> None:
        """Write what is new.

        Raises
        ------
        ConfigError
            When the disk is full or gone: the log ends, not the run.
        """
        try:
            self._waiting += self._reader.read()
            self._reads += 1
            if self._reads % CHUNK_INTERVAL == 0:
                self._end_chunk()
        except OSError as error:
            raise ConfigError(f"{self.path}: the log ends here ({error.strerror}); the run goes on") from error

    def _register(self, topic: Topic) -> None:
        schema = topic.schema
        if schema.name not in self._schemas:
            self._schemas[schema.name] = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        self._channels[topic.name] = self._writer.register_channel(
            topic.name, schema.message_encoding, self._schemas[schema.name],
            {"description": topic.words, "finger": str(topic.finger)},
        )  # fmt: skip

    def _hold_back(self) -> None:
        """Let predictions to look at wait for more of them, where they compress better; columns hold all of them."""
        looked_at = [message for message in self._waiting if message.topic.kind == PREDICTION.kind]
        if len(looked_at) < LOOKED_AT:
            self._waiting = [message for message in self._waiting if message.topic.kind != PREDICTION.kind]
            self._held = looked_at

    def _write_waiting(self) -> None:
        # Sound before the packets that are read back from it; packets and controls in one group, whose order stays.
        # Text has a chunk of its own, as its statistics differ.
        waiting, self._waiting = self._waiting, []
        for _, group in itertools.groupby(
            sorted(waiting, key=_group), key=lambda message: _group(message)[0] <= _PACKETS
        ):
            for message in group:
                self._write(message)
            # The library ends a chunk by its size only; in time is what bounds the loss. Its version is pinned, and
            # `test_each_chunk_reaches_the_disk` notices if this private name goes away.
            self._writer._Writer__finalize_chunk()

    def _write(self, message: Message) -> None:
        name = message.topic.name
        nanoseconds = round(message.time * 1e9) // TIME_STEP * TIME_STEP
        self._writer.add_message(self._channels[name], nanoseconds, message.data, nanoseconds)

    def _end_chunk(self) -> None:
        # The sound of these packets too, though its message is not full, as they are read back from it.
        self._waiting += self._held + self._reader.flush()
        self._held = []
        self._hold_back()
        self._write_waiting()
        self._file.flush()
