"""Logs from anybody: what is no log is refused in one line, and takes no more memory
than a log."""

import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest
import soundfile

from tactophone.app.logged_run import write_sound
from tactophone.app.replay import Replay, write_replay
from tactophone.cli import main
from tactophone.core.errors import TactophoneError
from tactophone.live.log.log_topics import (
    CONTROLS,
    PACKETS,
    RUN,
    Message,
    Packets,
    topics_of,
)
from tactophone.live.log.mcap import FORMAT, LARGEST_CHUNK, MAGIC, LogFile, read_log
from tactophone.live.telemetry.records import EventBatch, RunStart
from tactophone.net.link.events import Connected, PacketReceived, write_event
from tactophone.net.link.packet import Packet, Payload, PayloadType
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model

pytest.importorskip("mcap")
zstandard = pytest.importorskip("zstandard")


def _text(text: str | bytes) -> bytes:
    encoded = text.encode() if isinstance(text, str) else text
    return struct.pack("<I", len(encoded)) + encoded


def _record(kind: int, body: bytes, size: int | None = None) -> bytes:
    return struct.pack("<BQ", kind, len(body) if size is None else size) + body


def _channel(number: int, topic: str, finger: str = "0") -> bytes:
    metadata = _text("finger") + _text(finger)
    body = (
        struct.pack("<HH", number, 1)
        + _text(topic)
        + _text("json")
        + struct.pack("<I", len(metadata))
        + metadata
    )
    return _record(4, body)


def _message(number: int, content: object) -> bytes:
    data = content if isinstance(content, bytes) else json.dumps(content).encode()
    return _record(5, struct.pack("<HIQQ", number, 0, 0, 0) + data)


def _chunk(compression: str, data: bytes, claimed: int) -> bytes:
    return _record(
        6,
        struct.pack("<QQQI", 0, 0, claimed, 0)
        + _text(compression)
        + struct.pack("<Q", len(data))
        + data,
    )


_SCHEMA = _record(
    3, struct.pack("<H", 1) + _text("x") + _text("jsonschema") + _text("{}")
)


def _log(*records: bytes) -> bytes:
    header = _record(1, _text(FORMAT) + _text("x"))
    return (
        MAGIC + header + b"".join(records) + _record(15, struct.pack("<I", 0)) + MAGIC
    )


def _run(**entries: Any) -> bytes:
    channels = [
        _SCHEMA,
        _channel(1, RUN.name),
        _channel(2, CONTROLS.name),
        _channel(3, PACKETS.name),
    ]
    return b"".join(channels) + _message(1, {"role": "operator", **entries})


_FINGER = {"name": "", "settings": {}, "calibration": ""}
_CONTROLS = {
    "armed": True,
    "ceiling": 0.5,
    "output_level": 1.0,
    "profile": "paper",
    "threshold_dbfs": None,
    "step": 0,
    "finger": 0,
}
_HEAD = b"".join([_SCHEMA, _channel(1, RUN.name)])


def _controls(**entries: Any) -> bytes:
    return _log(_run(fingers=[_FINGER]), _message(2, {**_CONTROLS, **entries}))


def _arrivals(**entries: Any) -> bytes:
    return _log(
        _run(fingers=[_FINGER]),
        _message(3, {"arrivals": [{"time": 1.0, "events": [], **entries}]}),
    )


LOGS: dict[str, bytes] = {
    "run is a list": _log(_HEAD, _message(1, [])),
    "run is nested": _log(_HEAD, _message(1, b"[" * 200_000)),
    "settings are a list": _log(_run(settings=[])),
    "a section is a list": _log(_run(settings={"rendering": [1]})),
    "a number of 400 digits": _log(_run(settings={"rendering": {"ceiling": 10**400}})),
    "a ceiling of 5": _log(_run(settings={"rendering": {"ceiling": 5}})),
    "models are a list": _log(_run(models=[1])),
    "fingers are empty tables": _log(_run(fingers=[{}])),
    "fingers are a text": _log(_run(fingers="ab")),
    "a finger's settings are a list": _log(_run(fingers=[{**_FINGER, "settings": []}])),
    "a finger's calibration is a number": _log(
        _run(fingers=[{**_FINGER, "calibration": 5}])
    ),
    "a calibration that is no TOML": _log(
        _run(fingers=[{**_FINGER, "calibration": "{"}])
    ),
    "a calibration of brackets": _log(
        _run(fingers=[{**_FINGER, "calibration": "[" * 100_000}])
    ),
    "a finger that leaves the folder": _log(
        _run(fingers=[{**_FINGER, "name": "/../../x"}])
    ),
    "a finger with a line break": _log(_run(fingers=[{**_FINGER, "name": "index\n"}])),
    "a finger with an escape": _log(_run(fingers=[{**_FINGER, "name": "b\x1b[31m"}])),
    "eleven fingers": _log(_run(fingers=[_FINGER] * 11)),
    "a file of this machine as model": _log(
        _run(settings={"detector": {"model": "/etc/passwd"}}, fingers=[_FINGER])
    ),
    "a model that is a number": _log(
        _run(settings={"detector": {"model": 10**400}}, fingers=[_FINGER])
    ),
    "a model with an escape": _log(
        _run(settings={"detector": {"model": "\x1b]0;PWNED\x07"}}, fingers=[_FINGER])
    ),
    "controls with a ceiling of 1e308": _controls(ceiling=1e308),
    "controls that are not finite": _log(
        _run(fingers=[_FINGER]), _message(2, b'{"armed":true,"ceiling":NaN}')
    ),
    "controls of text": _controls(ceiling="x", output_level=[]),
    "controls of a finger of text": _controls(finger="0"),
    "controls of the seventh finger": _controls(finger=6),
    "an arrival in 1e300 s": _arrivals(time=1e300),
    "an arrival of text": _arrivals(events="x"),
    "an arrival of wild events": _arrivals(events=["AGFiYw==", "CQ==", ""]),
    "a finger number of 5000 digits": _log(
        _SCHEMA, _channel(9, "/a/predictions", "9" * 5000)
    ),
    "a finger number below 0": _log(_SCHEMA, _channel(9, "/a/predictions", "-5")),
    "a topic with an escape": _log(
        _SCHEMA, _channel(9, "/\x1b]0;PWNED\x07/predictions")
    ),
    "a prediction of other types": _log(
        _SCHEMA, _channel(9, "/a/prediction"), _message(9, {"touch": 5})
    ),
    "metadata of a list": _log(
        _record(12, _text("tactophone") + _text(_text("missed") + _text("[1]")))
    ),
    "metadata of text": _log(
        _record(12, _text("tactophone") + _text(_text("missed") + _text('{"a":"b"}')))
    ),
    "a chunk of unknown compression": _log(_chunk("xz", b"x" * 50, 50)),
    "a chunk of other bytes": _log(_chunk("zstd", b"x" * 50, 50)),
    "a chunk of 2^62 bytes": _log(
        _record(6, struct.pack("<QQQI", 0, 0, 1 << 63, 0) + _text("") + b"\xff" * 8)
    ),
    "a record of 2^63 bytes": _log(_record(5, b"", 1 << 63)),
    "a record of 2^40 bytes": _log(_record(5, b"abc", 1 << 40)),
    "nothing": _log(),
}


@pytest.mark.parametrize("content", LOGS.values(), ids=LOGS)
def test_a_log_that_is_none_is_refused_in_printable_words(
    content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(content)
    with pytest.raises(TactophoneError) as refused:
        list(Replay(read_log(path)).steps())
    assert str(refused.value).isprintable()


def test_a_log_names_no_file_of_this_machine_for_its_hash(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(
        _log(_run(models={"/dev/zero": "0", "/proc/kmsg": "0"}, fingers=[_FINGER]))
    )
    replay = Replay(read_log(path))
    assert list(replay.steps()) == []
    assert replay.endpoint is not None
    assert not any("/" in note for note in replay.notes)


@pytest.mark.slow
@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claimed", [100, 1 << 30])
def test_a_chunk_that_grows_is_refused_before_it_fills_the_memory(
    tmp_path: Path, compression: str, claimed: int
) -> None:
    path = tmp_path / "bomb.mcap"
    path.write_bytes(
        _log(_run(fingers=[_FINGER]), _chunk(compression, _bomb(compression), claimed))
    )
    assert path.stat().st_size < 10_000_000
    # In its own process: the peak memory of this one comes from the tests before.
    code = (
        "import sys, resource; from pathlib import Path; from "
        "tactophone.live.log.mcap import read_log\n"
        "from tactophone.core.errors import DatasetError\n"
        "import zstandard, mcap.stream_reader; before = "
        "resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n"
        "try: list(read_log(Path(sys.argv[1])))\n"
        "except DatasetError as error: print(error, file=sys.stderr)\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(path)],
        check=True,
        capture_output=True,
        text=True,
    )
    assert f"over {LARGEST_CHUNK >> 20} MB" in done.stderr
    assert int(done.stdout) < 300_000  # kB


def _bomb(compression: str) -> bytes:
    """One gigabyte of zeros."""
    if compression == "zstd":
        compressor = zstandard.ZstdCompressor().compressobj()
        parts = [compressor.compress(bytes(1 << 20)) for _ in range(1024)]
        return b"".join([*parts, compressor.flush()])
    frame = pytest.importorskip("lz4.frame")
    lz4 = frame.LZ4FrameCompressor()
    return b"".join(
        [lz4.begin(), *(lz4.compress(bytes(1 << 22)) for _ in range(256)), lz4.flush()]
    )


@pytest.mark.slow
def test_a_log_cannot_raise_this_machines_ceiling_and_the_user_can(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = write_tiny_model(tmp_path / "tiny.onnx")
    log = record(tmp_path / "run.mcap", model, "rendering.ceiling=1.0")

    def peak(*words: str) -> float:
        assert main(["replay", str(log), "--out", str(tmp_path / "out"), *words]) == 0
        return float(
            np.abs(soundfile.read(tmp_path / "out" / "run.haptic.wav")[0]).max()
        )

    assert 0.1 < peak() <= 0.5
    said = capsys.readouterr().out
    assert "equal to the bit" in said  # at the ceiling of the log
    assert "ceiling of the run was above 0.5" in said
    assert peak("--ceiling", "1") > 0.5


def test_only_its_user_reads_a_log(tmp_path: Path) -> None:
    log = record(tmp_path / "run.mcap", write_tiny_model(tmp_path / "tiny.onnx"))
    assert log.stat().st_mode & 0o777 == 0o600


def _with_gap(path: Path, samples: int) -> Path:
    """Write a log of two seconds of sound, whose timestamps jump by ``samples`` after
    the first second."""
    connected = write_event(Connected("robot", 1, 2))
    batches, size = [EventBatch(100.0, (connected,))], 240
    for number in range(400):
        timestamp = 1000 + number * size + (samples if number >= 200 else 0)
        payload = Payload(
            PayloadType.L16_STEREO, timestamp % (1 << 32), b"\x10\x00\xf0\x00" * size
        )
        event = write_event(PacketReceived(bytes(Packet(number, 1, payload)), False))
        batches.append(EventBatch(round(100 + number * 0.005, 5), (event,)))
    with LogFile(path, topics_of([""], sound=False)) as log:
        log.write(
            Message(
                RUN,
                0.0,
                msgspec.json.encode(
                    RunStart(role="operator", settings={}, epoch=1.7e9)
                ),
            )
        )
        log.write(Message(PACKETS, 0.0, msgspec.json.encode(Packets(batches))))
        log.end_chunk()
    return path


def test_a_jump_in_time_is_noted_and_takes_neither_memory_nor_disk(
    tmp_path: Path,
) -> None:
    log = _with_gap(tmp_path / "run.mcap", 1 << 28)
    replay = Replay(read_log(log))
    (finger,) = write_replay(replay, tmp_path / "out", "run")
    assert soundfile.info(finger.files["vibration"]).duration == pytest.approx(
        2.0, abs=0.2
    )
    assert any(
        "5592 s without sound at 1.00 s are left out" in note for note in replay.notes
    )
    sounds = write_sound(log, tmp_path)
    assert [soundfile.info(each.path).frames for each in sounds] == [48_000, 48_000]
