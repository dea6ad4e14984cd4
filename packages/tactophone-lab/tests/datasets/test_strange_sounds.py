"""Sound files that are something else, or end otherwise than they say."""

import struct
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.sound_file import length_of, open_file
from tactophone.core.recordings.values import Problem, Recording
from tactophone_lab.datasets.checks import check_recording
from tactophone_lab.datasets.open import open_dataset, phone_sounds
from tests.folders import write_sound

RATE = 44_100


def noise(seconds: float) -> np.ndarray:
    return np.random.default_rng(0).uniform(-0.3, 0.3, (round(seconds * RATE), 2))


def faults(path: Path) -> list[Problem]:
    return list(check_recording(Recording(path, "slate")))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"\0\0\0\x20ftypM4A \0\0\0\0" + bytes(100), "MPEG-4.*ffmpeg -i"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:0", "git lfs pull"),
        (b"<!DOCTYPE html><html>404", "web page"),
        (b"PK\x03\x04" + bytes(100), "archive.*unpack"),
        (bytes(5000), "nothing but zeros"),
    ],
)
def test_what_is_no_sound_is_named_with_its_cure(
    tmp_path: Path, content: bytes, words: str
) -> None:
    path = tmp_path / "a.wav"
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=words):
        open_file(path)


def test_half_an_mp3_is_noticed_and_read_to_its_end_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.mp3"
    soundfile.write(path, noise(8.0), RATE, format="MP3")
    assert not length_of(path).cut
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert length_of(path).share == pytest.approx(0.5, abs=0.01)
    (fault,) = faults(path)
    assert "ends after 4.0 of 8.0 s" in fault.message
    with open_file(path) as file:
        blocks = list(file.blocks(4096, dtype="float32"))
    # After its end there is nothing, instead of the last block again and again.
    assert sum(map(len, blocks)) == pytest.approx(4 * RATE, rel=0.05)


def test_an_mp3_after_tags_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.mp3"
    soundfile.write(path, noise(2.0), RATE, format="MP3")
    tag = b"ID3\x03\0\0" + bytes((0, 0, 7, 0x76)) + bytes(7 * 128 + 0x76)
    path.write_bytes(tag + path.read_bytes() + b"TAG" + bytes(125))
    assert not length_of(path).cut


@pytest.mark.parametrize("lost", [5, 9 * 4])
def test_a_file_that_lacks_a_moment_is_used(tmp_path: Path, lost: int) -> None:
    path = tmp_path / "a.wav"
    soundfile.write(path, noise(1.0), RATE)
    path.write_bytes(path.read_bytes()[:-lost])
    (fault,) = faults(path)
    assert not fault.fatal
    assert "ms that its header claims; the rest is used" in fault.message


def test_a_long_recorders_file_without_its_sizes_is_read_whole(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    soundfile.write(path, noise(1.0), RATE, format="RF64")
    content = bytearray(path.read_bytes())
    sizes = content.index(b"ds64") + 8
    content[sizes : sizes + 24] = bytes(24)
    path.write_bytes(content)
    assert not faults(path)
    with open_file(path) as file:
        assert file.frames == RATE


def test_zeros_at_the_end_of_a_copy_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    sound = noise(2.0)
    sound[RATE:] = 0
    soundfile.write(path, sound, RATE)
    (fault,) = faults(path)
    assert (fault.kind, fault.fatal) == ("zeros", False)
    assert "its last 1.0 s" in fault.message


def test_what_is_in_the_cloud_alone_is_said(tmp_path: Path) -> None:
    write_sound(tmp_path / "rough" / "a_1.wav")
    (tmp_path / "rough" / ".b_1.wav.icloud").write_bytes(b"bplist00")
    assert phone_sounds(tmp_path).startswith("1 file is in iCloud alone")


@pytest.mark.parametrize(
    ("ending", "kind"),
    [(".amb", "WAVEX"), (".snd", "AU"), (".sph", "NIST"), (".voc", "VOC")],
)
def test_every_ending_of_a_readable_sound_is_seen(
    tmp_path: Path, ending: str, kind: str
) -> None:
    (tmp_path / "rough").mkdir()
    sound = noise(1.0)
    soundfile.write(tmp_path / f"rough/a_1{ending}", sound, RATE, "PCM_16", format=kind)
    (recording,) = open_dataset(tmp_path).recordings
    assert not faults(recording.path)


def test_a_header_of_no_channels_is_an_error_in_words(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    form = struct.pack("<HHIIHH", 1, 0, 48_000, 0, 4, 16)
    body = b"WAVEfmt " + struct.pack("<I", 16) + form + b"data" + bytes(4)
    path.write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)
    with pytest.raises(DatasetError, match="cannot be read as sound"):
        open_file(path)
