"""Where the bytes of a log are: sound, what surrounds it, packets, predictions, chunks.

``python benchmarks/log_size.py [RUN.mcap]``: of a log; without one, of a minute that a loopback of the simulated finger
records now, two microphones as Opus.
"""

import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

from mcap.records import Channel, Chunk, Message
from mcap.stream_reader import StreamReader, breakup_chunk

from tactophone.bridges import protobuf
from tactophone.bridges.chunk_writer import BlockCompressor, encode
from tactophone.bridges.mcap_log import BLOCKS
from tactophone.opus_packets import FRAME_SIZES, split_frames
from tactophone.types import LIVE_SAMPLE_RATE

KINDS = [[topic.kind for topic in topics] for topics in BLOCKS]


def frames_of(message: Message) -> list[bytes]:
    (packet,) = (bytes(value) for number, value in protobuf.fields(message.data) if number == 2)
    return split_frames(packet)


def sizes(messages: dict[str, list[Message]]) -> Counter[str]:
    """Return the compressed bytes of a chunk by topic.

    The bytes of a topic are those that its block would lack without it; what topics share is the block's own part.
    """
    found, compressor = Counter[str](), BlockCompressor()
    for number, kinds in enumerate(KINDS):
        block = {topic: each for topic, each in messages.items() if topic.rpartition("/")[2] in kinds}

        def size(without: str = "", block: dict[str, list[Message]] = block) -> int:
            kept = [message for topic, each in block.items() if topic != without for message in each]
            return len(compressor.compress([encode(*kept)]))

        shares = {topic: size() - size(topic) for topic in block}
        found.update(shares)
        found[f"shared in block {number + 1} of a chunk"] += size() * bool(block) - sum(shares.values())
    return found


def breakdown(path: Path) -> tuple[float, Counter[str], Counter[str]]:
    """Return seconds of sound, bytes by part, and messages by topic."""
    topics: dict[int, str] = {}
    parts, counts, samples = Counter[str](), Counter[str](), 0
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if not isinstance(record, Chunk):
                continue
            messages = defaultdict[str, list[Message]](list)
            for each in breakup_chunk(record):
                if isinstance(each, Channel):
                    topics[each.id] = each.topic
                if isinstance(each, Message):
                    messages[topics[each.channel_id]].append(each)
            counts.update({topic: len(found) for topic, found in messages.items()})
            parts.update(sizes(messages) if messages else {"once in a file": len(record.data)})
            parts["heads of chunks"] += len(encode(record)) - len(record.data)
            for topic in [topic for topic in messages if "/sound/" in topic]:
                frames = [frame for message in messages[topic] for frame in frames_of(message)]
                parts["Opus frames"] += sum(len(frame) - 1 for frame in frames)
                parts[topic] -= sum(len(frame) - 1 for frame in frames)
                samples += topic.endswith("contact") * sum(FRAME_SIZES[frame[0] >> 3 & 3] for frame in frames)
    parts["once in a file"] += path.stat().st_size - parts.total()
    return samples / LIVE_SAMPLE_RATE, parts, counts


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(folder) / "run.mcap"
        if len(sys.argv) == 1:
            command = "loopback --source finger --actuator none --duration 60 --record"
            subprocess.run([sys.executable, "-m", "tactophone", *command.split(), str(path)], check=True)
        seconds, parts, counts = breakdown(path)
    print(f"{seconds:.2f} s of sound, {parts.total()} bytes")
    for name, size in parts.most_common():
        print(f"{name:34} {size:9} bytes {size / seconds * 600 / 1e6:7.3f} MB in 10 min {counts.get(name, ''):6}")
    once = parts["once in a file"]
    print(f"ten minutes: {((parts.total() - once) / seconds * 600 + once) / 1e6:.2f} MB")


if __name__ == "__main__":
    main()
