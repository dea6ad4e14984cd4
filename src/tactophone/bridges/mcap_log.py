"""Writes a run to an MCAP file, from outside its process."""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Self

from tactophone.bridges.chunk_writer import ChunkWriter
from tactophone.bridges.run_reader import Message, RunReader
from tactophone.bridges.schemas import (
    AIR_SOUND,
    CONTACT_SOUND,
    CONTROLS,
    EVENTS,
    HEALTH,
    PACKETS,
    PCM_SOUND,
    PREDICTION,
    PREDICTIONS,
    RUN,
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

TIME_STEP = 1 << 20
"""Nanoseconds, about one ms, of the times by which viewers order messages; whole steps compress to fewer bytes."""

FORMAT = "tactophone 4"
"""Profile in the header of the file; a later layout gets a later number."""

BLOCKS = (
    (CONTACT_SOUND, AIR_SOUND, PCM_SOUND),
    (RUN, PACKETS, CONTROLS, PREDICTIONS),
    (PREDICTION, STATE, HEALTH, EVENTS),
)
"""Of a chunk: sound, before the packets that are read back from it; what is computed again; text."""


class McapLog:
    """Keeps a run in an MCAP file, which it overwrites; a context manager whose `read` is called every `READ_INTERVAL`.

    Raises `ConfigError` when the file cannot be written.
    """

    interval = READ_INTERVAL

    def __init__(self, name: str, path: Path) -> None:
        self.path = path
        self._reader = RunReader(name, in_columns=True)
        self._waiting: list[Message] = []
        self._held: list[Message] = []
        self._reads = 0

    def __enter__(self) -> Self:
        try:
            self._file = self.path.open("wb")
            self._writer = ChunkWriter(self._file, profile=FORMAT, topics=topics_of(self._reader.names))
        except OSError as error:
            raise ConfigError(
                f"cannot write {self.path} ({error.strerror}): choose another file for --record"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        # A full disk has been reported by `read`; the index is then missing, and the chunks are there.
        with suppress(OSError, ValueError):
            self._waiting += self._held + self._reader.flush()
            self._write_waiting()
            self._writer.finish({"format": FORMAT, "missed": json.dumps(self._reader.missed)})
        with suppress(OSError, ValueError):
            self._file.close()

    def read(self) -> None:
        """Write what is new; raises `ConfigError` when the disk is full or gone: the log ends, not the run."""
        try:
            self._waiting += self._reader.read()
            self._reads += 1
            if self._reads % CHUNK_INTERVAL == 0:
                self._end_chunk()
        except OSError as error:
            raise ConfigError(f"{self.path}: the log ends here ({error.strerror}); the run goes on") from error

    def _hold_back(self) -> None:
        """Let predictions to look at wait for more of them, where they compress better; columns hold all of them."""
        looked_at = [message for message in self._waiting if message.topic.kind == PREDICTION.kind]
        if len(looked_at) < LOOKED_AT:
            self._waiting = [message for message in self._waiting if message.topic.kind != PREDICTION.kind]
            self._held = looked_at

    def _write_waiting(self) -> None:
        waiting, self._waiting = self._waiting, []
        self._writer.write(*[_block(waiting, topics) for topics in BLOCKS])

    def _end_chunk(self) -> None:
        # The sound of these packets too, though its message is not full, as they are read back from it.
        self._waiting += self._held + self._reader.flush()
        self._held = []
        self._hold_back()
        self._write_waiting()


def _block(messages: Sequence[Message], topics: Sequence[Topic]) -> list[tuple[str, int, bytes]]:
    """Return the messages of these topics: those of packets in their order, which a replay needs, others by topic."""
    kinds = [topic.kind for topic in topics]
    chosen = [message for message in messages if message.topic.kind in kinds]
    if PACKETS not in topics:
        chosen.sort(key=lambda message: (kinds.index(message.topic.kind), message.topic.finger))
    return [
        (message.topic.name, round(message.time * 1e9) // TIME_STEP * TIME_STEP, message.data) for message in chosen
    ]
