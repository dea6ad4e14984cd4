"""An MCAP file of compressed chunks that the caller ends.

The writer of the library `mcap` ends a chunk by its size and has no access to the compressor. Its records serve here,
in the order of the specification (mcap.dev/spec).
"""

import zlib
from collections import Counter
from collections.abc import Sequence
from typing import Any, BinaryIO

from tactophone.bridges.schemas import Topic

COMPRESSION_LEVEL = 13
"""Of zstd: 0.6 ms for 0.8 s of Opus. 5 takes 0.3 ms, and 0.04 MB more in 10 minutes; 19, 2.5 ms and 0.02 MB less."""

TYPICAL_CHUNK = 1 << 15
"""Bytes before compression; zstd then takes small tables, which are quick to prepare."""

MAGIC = b"\x89MCAP0\r\n"


class ChunkWriter:
    """Writes an MCAP file without an index.

    Parameters
    ----------
    file
        Open for writing, at its beginning.
    profile
        Name of the layout of topics.
    topics
        All that there are; each becomes a channel, with a schema of its kind.
    """

    def __init__(self, file: BinaryIO, *, profile: str, topics: Sequence[Topic]) -> None:
        from mcap.records import Channel, Header, Schema

        self._compressor = BlockCompressor()
        self._file, self._counts, self._chunks = file, Counter[int](), 0
        self._begun = self._end = self._size = 0
        kinds = {topic.schema.name: topic.schema for topic in topics}
        self._schemas = [
            Schema(number, kind.data, kind.encoding, kind.name) for number, kind in enumerate(kinds.values(), 1)
        ]
        numbers = {schema.name: schema.id for schema in self._schemas}
        self._channels = {
            topic.name: Channel(
                number, topic.name, topic.schema.message_encoding,
                {"description": topic.words, "finger": str(topic.finger)}, numbers[topic.schema.name],
            )
            for number, topic in enumerate(topics, 1)
        }  # fmt: skip
        self._put(MAGIC + encode(Header(profile, "tactophone")))
        self._write_chunk([encode(*self._schemas, *self._channels.values())], [0])

    def write(self, *blocks: Sequence[tuple[str, int, bytes]]) -> None:
        """Write a chunk of messages, each with the name of its topic and its time in ns since 1970.

        Each block is compressed by its own statistics: sound would spoil those of text.
        """
        from mcap.records import Message

        numbered = [[(self._channels[name].id, time, data) for name, time, data in block] for block in blocks]
        times = [time for block in numbered for _, time, _ in block]
        if not times:
            return
        self._counts.update(number for block in numbered for number, _, _ in block)
        self._begun, self._end = min(self._begun or min(times), *times), max(self._end, *times)
        self._write_chunk(
            [encode(*[Message(number, time, data, time, 0) for number, time, data in block]) for block in numbered],
            times,
        )

    def finish(self, metadata: dict[str, str]) -> None:
        """Write what a reader finds at the end: all topics again, counts, and `metadata` under the profile's name."""
        from mcap.records import DataEnd, Footer, Metadata, Statistics

        self._put(encode(Metadata("tactophone", metadata), DataEnd(0)))
        start = self._size
        counts = Statistics(
            attachment_count=0, channel_count=len(self._channels), channel_message_counts=dict(self._counts),
            chunk_count=self._chunks, message_count=self._counts.total(), metadata_count=1,
            message_start_time=self._begun, message_end_time=self._end, schema_count=len(self._schemas),
        )  # fmt: skip
        summary = encode(*self._schemas, *self._channels.values(), counts)
        # A checksum of 0 means that there is none.
        self._put(summary + encode(Footer(start, 0, 0)) + MAGIC)

    def _write_chunk(self, blocks: Sequence[bytes], times: Sequence[int]) -> None:
        from mcap.records import Chunk

        records, compressed = b"".join(blocks), self._compressor.compress(blocks)
        chunk = Chunk("zstd", compressed, max(times), min(times), zlib.crc32(records), len(records))
        self._put(encode(chunk))
        self._file.flush()
        self._chunks += 1

    def _put(self, data: bytes) -> None:
        self._file.write(data)
        self._size += len(data)


class BlockCompressor:
    """Compresses blocks of a chunk to one zstd frame, each by its own statistics."""

    def __init__(self) -> None:
        from zstandard import ZstdCompressionParameters, ZstdCompressor

        parameters = ZstdCompressionParameters.from_level(COMPRESSION_LEVEL, source_size=TYPICAL_CHUNK)
        self._compressor = ZstdCompressor(compression_params=parameters)

    def compress(self, blocks: Sequence[bytes]) -> bytes:
        """Return the frame."""
        from zstandard import COMPRESSOBJ_FLUSH_BLOCK

        frame = self._compressor.compressobj(size=sum(map(len, blocks)))
        compressed = b"".join(frame.compress(block) + frame.flush(COMPRESSOBJ_FLUSH_BLOCK) for block in blocks if block)
        return compressed + frame.flush()


def encode(*records: Any) -> bytes:
    """Encode records of the library, one after another."""
    from mcap.data_stream import RecordBuilder

    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    encoded: bytes = builder.end()
    return encoded
