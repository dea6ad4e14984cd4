"""A file of a stranger costs what its size allows, not what its content asks for.

Each is read by a process with limits, within which a file that is read in one pass
stays by far; what grows with the square of its size would take hours.
"""

import os
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile
from mcap.writer import Writer

from tactophone.live.log.mcap import FORMAT

CPU = 30
"""Seconds of processor time."""

MEMORY = 3 << 30
"""Bytes of address space; the libraries take a third of them."""

LIMITED = f"""
import resource, sys
from pathlib import Path
resource.setrlimit(resource.RLIMIT_CPU, ({CPU}, {CPU}))
resource.setrlimit(resource.RLIMIT_AS, ({MEMORY}, {MEMORY}))
from tactophone.core.errors import TactophoneError
path = Path(sys.argv[1])
try:
    {{read}}
except TactophoneError as error:
    print(str(error).replace(sys.argv[1], ""))
"""

MANIFEST = """
    from tactophone.core.recordings.metadata import read_metadata
    print(len(read_metadata(path).recordings))
"""

NAMES = """
    from tactophone.core.recordings.layouts import surface_and_take
    from tactophone.core.recordings.metadata import read_metadata
    found = read_metadata(path, surface_of=lambda path: surface_and_take(path.stem)[0])
    print(len(found.recordings))
"""

TRACK = """
    from tactophone.core.recordings.label_tracks import read_track
    print(len(read_track(path / "a.wav", path, [])))
"""

SOUND = """
    from tactophone.core.recordings.sound_file import sound_info
    print(sound_info(path))
"""

WHOLE = """
    from tactophone.core.recordings.values import Recording
    print(Recording(path, "felt", None).read().size)
"""

FOLDER = """
    from tactophone.core.recordings import label_tracks
    sounds = sorted(path.rglob("*.wav"))
    label_tracks.read_selections(path, sounds, [])
    print(len(sounds), label_tracks.find_event_tables(path))
"""

LOG = """
    from tactophone.live.log.mcap import read_log
    print(len(list(read_log(path))))
"""

FEEL = """
    from tactophone.app.recordings import open_recording
    print(len(list(open_recording(path).steps())))
"""

MODEL = """
    from tactophone.signal.perception.model_file import read_model
    read_model(path)
"""


def data_set(folder: Path) -> Path:
    soundfile.write(folder / "a.wav", np.zeros((480, 2), np.float32), 48_000)
    (folder / "metadata.csv").write_text("file_name,surface,label\na.wav,felt,smooth\n")
    return folder


def card_of_newlines(folder: Path) -> Path:
    data_set(folder)
    text = "class_label:\n names:" + "\n" * 500_000 + "x"
    (folder / "README.md").write_text(text)
    return folder


def manifest_of_a_long_name(folder: Path) -> Path:
    names = ("_" * 100_000, "1" * 100_000 + "a", "take" * 25_000)
    lines = [f"{name}.wav,smooth" for name in names]
    (folder / "metadata.csv").write_text("\n".join(["file_name,label", *lines]) + "\n")
    return folder


def grid_of_tiers(folder: Path) -> Path:
    (folder / "a.TextGrid").write_text('"IntervalTier" ' * 400_000)
    return folder


def grid_of_an_open_text(folder: Path) -> Path:
    (folder / "a.TextGrid").write_text('"' + "a" * 30_000_000)
    return folder


def tables_that_never_end(folder: Path) -> Path:
    for surface in ("rough", "smooth"):
        (folder / surface).mkdir()
        sound = np.zeros((480, 2), np.float32)
        soundfile.write(folder / surface / "a.wav", sound, 48_000)
    (folder / "x.txt").symlink_to("/dev/zero")
    (folder / "x.tsv").symlink_to("/dev/zero")
    os.mkfifo(folder / "y.txt")
    os.mkfifo(folder / "y.tsv")
    return folder


def log_of_schemas(folder: Path) -> Path:
    path = folder / "a.mcap"
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 20)
        writer.start(profile=FORMAT, library="x")
        for number in range(60):
            schema = writer.register_schema(f"{number}", "x", bytes(60 << 20))
            channel = writer.register_channel(f"/{number}", "json", schema)
            writer.add_message(channel, 0, bytes(1 << 20), 0)
        writer.finish()
    return path


def mp3_of_a_claim(folder: Path) -> Path:
    """Its header claims a thousand million frames of 1152 samples."""
    path = folder / "a.mp3"
    sound = np.random.default_rng(0).normal(0, 0.1, (48_000, 2))
    soundfile.write(path, sound, 48_000)
    content = bytearray(path.read_bytes())
    place = max(content.find(name, 0, 200) for name in (b"Xing", b"Info"))
    assert place > 0
    content[place + 8 : place + 12] = (1_000_000_000).to_bytes(4, "big")
    path.write_bytes(content)
    return path


def manifest_of_zeros(folder: Path) -> Path:
    os.truncate(data_set(folder) / "metadata.csv", 4 << 30)
    return folder


def labels_of(folder: Path, text: str, size: int = 0) -> Path:
    labels = data_set(folder) / "labels.toml"
    labels.write_text(text)
    os.truncate(labels, size or len(text))
    return folder


def labels_of_zeros(folder: Path) -> Path:
    return labels_of(folder, "a = 1\n", 4 << 30)


def labels_of_many_dots(folder: Path) -> Path:
    return labels_of(folder, "a." * 40_000 + "a = 1")


def labels_of_brackets(folder: Path) -> Path:
    return labels_of(folder, "a = " + "[" * 10_000)


def labels_of_digits(folder: Path) -> Path:
    return labels_of(folder, "a = " + "1" * 5_000)


def labels_of_tables(folder: Path) -> Path:
    return labels_of(folder, "a." * 1_000 + "a = 1")


def flac_of_empty_blocks(folder: Path) -> Path:
    path = folder / "a.flac"
    with path.open("wb") as file:
        file.write(b"fLaC")
        file.truncate(1 << 30)
    return path


def wav_of_a_rate(folder: Path) -> Path:
    """A prime rate, which shares no factor with any other."""
    rate = 10_000_019
    header = struct.pack("<IHHIIHH", 16, 1, 1, rate, 2 * rate, 2, 16)
    sound = np.random.default_rng(0).integers(-3000, 3000, 24_000, np.int16).tobytes()
    path = folder / "a.wav"
    path.write_bytes(
        b"RIFF"
        + struct.pack("<I", 36 + len(sound))
        + b"WAVEfmt "
        + header
        + b"data"
        + struct.pack("<I", len(sound))
        + sound
    )
    return path


def varint(value: int) -> bytes:
    content = b""
    while value > 0x7F:
        content += bytes([value & 0x7F | 0x80])
        value >>= 7
    return content + bytes([value])


def field(number: int, content: bytes) -> bytes:
    return varint(number << 3 | 2) + varint(len(content)) + content


def model_of(folder: Path, graph: bytes) -> Path:
    path = folder / "model.onnx"
    path.write_bytes(field(7, graph))
    return path


def model_of_many_dimensions(folder: Path) -> Path:
    dimensions = varint((1 << 62) + 1) * 500_000
    tensor = field(1, dimensions) + varint(2 << 3) + varint(1) + field(9, b"")
    return model_of(folder, field(5, tensor))


def model_of_empty_fields(folder: Path) -> Path:
    return model_of(folder, field(1, b"\x0a\x00" * 20_000_000))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "read", "said"),
    [
        (card_of_newlines, MANIFEST, "1"),
        (manifest_of_a_long_name, NAMES, "3"),
        (manifest_of_zeros, MANIFEST, "over 64 MB"),
        (labels_of_zeros, MANIFEST, "but at most 16384 are read"),
        (labels_of_many_dots, MANIFEST, "but at most 16384 are read"),
        (labels_of_brackets, MANIFEST, "recursion"),
        (labels_of_digits, MANIFEST, "4300 digits"),
        (labels_of_tables, MANIFEST, "a is a dict, no name"),
        (grid_of_tiers, TRACK, "0"),
        (grid_of_an_open_text, TRACK, "0"),
        (tables_that_never_end, FOLDER, "2 []"),
        (log_of_schemas, LOG, "schemas that no log of this program has"),
        (mp3_of_a_claim, WHOLE, "48"),
        (flac_of_empty_blocks, SOUND, "cannot be read as sound"),
        (wav_of_a_rate, FEEL, "768000 Hz or less is needed"),
        (model_of_many_dimensions, MODEL, "over 8 dimensions"),
        (model_of_empty_fields, MODEL, "over 100000 fields"),
    ],
    ids=lambda given: getattr(given, "__name__", ""),
)
def test_a_file_is_read_within_bounds(
    make: Callable[[Path], Path], read: str, said: str, tmp_path: Path
) -> None:
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            LIMITED.replace("{read}", read.strip()),
            str(make(tmp_path)),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert said in done.stdout
    assert len(done.stdout) < 300
