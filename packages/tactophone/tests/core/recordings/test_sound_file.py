"""What a header claims is compared with what the file holds, whatever wrote it."""

import contextlib
import ctypes
import os
import platform
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.c_stderr import without_c_stderr
from tactophone.core.recordings.sound_file import (
    Length,
    _crc,
    _end_of_metadata,
    create_long_wav,
    is_hidden,
    length_of,
    open_file,
    sound_info,
)
from tactophone.core.recordings.values import Recording

RATE = 48000
SIZE = 2 * RATE


def written(path: Path, **options: str) -> Path:
    noise = np.random.default_rng(0).normal(0, 0.05, (SIZE, 2))
    soundfile.write(path, noise, RATE, **options)
    return path


def count(path: Path) -> int:
    with open_file(path) as file:
        return sum(len(block) for block in file.blocks(4096))


KINDS = [
    ("a.wav", {"subtype": "PCM_16"}),
    ("b.wav", {"subtype": "DOUBLE"}),
    ("c.wav", {"subtype": "MS_ADPCM"}),
    ("d.wav", {"format": "RF64", "subtype": "PCM_16"}),
    ("e.w64", {"format": "W64", "subtype": "PCM_16"}),
    ("f.caf", {"format": "CAF", "subtype": "PCM_16"}),
    ("g.aiff", {"format": "AIFF", "subtype": "PCM_16"}),
    ("h.au", {"format": "AU", "subtype": "PCM_16"}),
    ("i.flac", {"subtype": "PCM_16"}),
    ("j.flac", {"subtype": "PCM_24"}),
    ("k.ogg", {"format": "OGG", "subtype": "VORBIS"}),
]


@pytest.mark.parametrize(("name", "options"), KINDS)
def test_a_whole_file_holds_what_it_claims(
    name: str, options: dict[str, str], tmp_path: Path
) -> None:
    path = written(tmp_path / name, **options)
    assert not length_of(path).cut
    assert count(path) == sound_info(path).size >= SIZE


@pytest.mark.parametrize(("name", "options"), KINDS)
def test_half_a_file_is_read_to_its_end_and_known_to_be_cut(
    name: str, options: dict[str, str], tmp_path: Path
) -> None:
    path = written(tmp_path / name, **options)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    held = count(path)
    assert 0.3 * SIZE < held < 0.6 * SIZE
    length = length_of(path)
    assert length.cut
    if length.closed:
        assert length.share == pytest.approx(held / SIZE, abs=0.02)


def test_flac_of_unknown_length_is_read_whole(tmp_path: Path) -> None:
    path = written(tmp_path / "segment.flac", subtype="PCM_16")
    content = bytearray(path.read_bytes())
    content[21] &= 0xF0  # STREAMINFO's 36 bits of length
    content[22:26] = bytes(4)
    path.write_bytes(content)
    assert count(path) == SIZE == sound_info(path).size
    assert not length_of(path).cut


@pytest.mark.parametrize("size", [0, 0xFFFFFFFF, 0x7FFFF000])
def test_a_header_that_was_never_finished_hides_no_sound(
    size: int, tmp_path: Path
) -> None:
    path = written(tmp_path / "pipe.wav", subtype="PCM_16")
    content = bytearray(path.read_bytes())
    content[4:8] = content[40:44] = size.to_bytes(4, "little")
    path.write_bytes(content)
    assert count(path) == SIZE
    assert not length_of(path).cut


@pytest.mark.skipif(
    sys.platform == "win32", reason="a file with a hole in it takes its whole size"
)
@pytest.mark.parametrize("wrapped", [False, True])
@pytest.mark.parametrize(("subtype", "channels"), [("FLOAT", 2), ("PCM_24", 1)])
def test_a_wav_file_of_over_4_gb_is_read_to_its_end(
    tmp_path: Path, subtype: str, channels: int, wrapped: bool
) -> None:
    path = tmp_path / "long.wav"
    ramp = np.linspace(-0.5, 0.5, 1200 * channels).reshape(1200, channels)
    soundfile.write(path, ramp, 48_000, subtype)
    content = path.read_bytes()
    place = content.index(b"data") + 8
    frame = (len(content) - place) // 1200
    size = 4_500_000_000 // frame
    # The largest number, as libsndfile and ffmpeg write it, or what 32 bits leave.
    claimed = size * frame & 0xFFFFFFFF if wrapped else 0xFFFFFFFF
    with path.open("wb") as file:
        file.write(content[: place - 4] + claimed.to_bytes(4, "little"))
        file.seek(place + (size - 1200) * frame)
        file.write(content[place:])
    assert (sound_info(path).size, length_of(path).cut) == (size, False)
    with open_file(path) as sound:
        assert not sound.read(10).any()
        sound.seek(size - 1200)
        np.testing.assert_allclose(
            sound.read(always_2d=True), ramp, atol=1e-6, strict=True
        )


def test_a_seek_in_a_corrected_file_arrives(tmp_path: Path) -> None:
    path = written(tmp_path / "a.flac", subtype="PCM_16")
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with open_file(path) as cut:
        cut.seek(RATE // 2)
        found = cut.read(100)
    path.write_bytes(content)
    with open_file(path) as whole:
        whole.seek(RATE // 2)
        assert np.array_equal(found, whole.read(100))


@pytest.mark.parametrize(
    "content", [b"fLaC", b"fLaC" + bytes(300), b"RIFF\0\0\0\0WAVE", b"caff", b".snd"]
)
def test_a_scrap_of_a_header_is_refused_in_a_line(
    content: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "scrap.wav"
    path.write_bytes(content)
    with pytest.raises(DatasetError, match="cannot be read as sound"):
        open_file(path)


def test_an_endless_chain_of_empty_chunks_ends(tmp_path: Path) -> None:
    path = tmp_path / "chain.wav"
    path.write_bytes(b"RIFF\0\0\0\0WAVE" + bytes(8_000_000))
    assert length_of(path) == Length(0, 0)


def test_the_sound_of_a_phone_is_refused_with_the_command_that_converts_it(
    tmp_path: Path,
) -> None:
    path = tmp_path / "memo.m4a"
    path.write_bytes(b"\0\0\0\x18ftypM4A ")
    with pytest.raises(DatasetError, match=r"`ffmpeg -i memo\.m4a memo\.wav`"):
        open_file(path)


def test_what_a_mac_adds_is_hidden(tmp_path: Path) -> None:
    assert is_hidden(tmp_path / "rough" / "._stone.wav", tmp_path)
    assert is_hidden(tmp_path / "__MACOSX" / "rough" / "stone.wav", tmp_path)
    assert not is_hidden(tmp_path / "rough" / "stone.wav", tmp_path)


def test_a_last_frame_with_an_impossible_number_is_no_frame(tmp_path: Path) -> None:
    """It states more samples than any file has, and a length was made of it."""
    path = written(tmp_path / "a.flac", subtype="PCM_16")
    whole = length_of(path)
    content = path.read_bytes()
    first = content[_end_of_metadata(BytesIO(content)) :][:4]
    greatest = b"\xfe" + 6 * b"\xbf"  # 36 bits
    # A block of 4096 samples, as code 12 says.
    head = first[:2] + bytes([first[2] & 0x0F | 0xC0, first[3]]) + greatest
    path.write_bytes(content + head + bytes([_crc(head, bits=8)]) + bytes(40))
    assert length_of(path).claimed == whole.claimed
    assert count(path) <= SIZE


@pytest.mark.parametrize("damage", ["sound", "length"])
def test_a_damaged_mp3_is_read_or_refused_in_our_words_alone(
    damage: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Its decoder has much to say, on C's stderr."""
    path = tmp_path / "a.mp3"
    content = bytearray(written(path).read_bytes())
    path.write_bytes(
        content[:600] + bytes(2000) + content[2600:]
        if damage == "sound"
        else content[:5000]
    )
    with contextlib.suppress(DatasetError):
        Recording(path, "felt").read(start=0.1)
    assert capfd.readouterr().err == ""


def test_what_c_libraries_print_appears_again_once_no_thread_reads(
    capfd: pytest.CaptureFixture[str],
) -> None:
    if platform.libc_ver()[0] != "glibc":
        pytest.skip("only glibc lets its stderr be exchanged")
    libc = ctypes.CDLL(None)
    with contextlib.ExitStack() as first, contextlib.ExitStack() as second:
        first.enter_context(without_c_stderr())
        second.enter_context(without_c_stderr())
        first.close()
        libc.perror(b"within")
        sys.stderr.write("ours\n")
        second.close()
        libc.perror(b"after")
    found = capfd.readouterr().err
    assert "within" not in found
    assert "ours" in found
    assert "after" in found


@pytest.mark.skipif(os.name == "nt", reason="the file would take 4.8 GB there")
def test_sound_of_over_4_gb_is_read_to_its_end(tmp_path: Path) -> None:
    """Of a log of three hours and more, the rest was left out without a word."""
    for name, place in (("short.wav", 4_800), ("long.wav", 600_000_000)):
        path = tmp_path / name
        with create_long_wav(
            path, sample_rate=48_000, channels=2, subtype="FLOAT"
        ) as file:
            file.write(np.zeros((4_800, 2), np.float32))
            file.seek(place)  # what lies between takes no room on the disk
            file.write(np.full((480, 2), 0.5, np.float32))
        with path.open("rb") as content:
            assert content.read(4) == (b"RF64" if place > 4_800 else b"RIFF")
        assert sound_info(path).size == place + 480
        assert not length_of(path).cut
        with open_file(path) as read:
            read.seek(place)
            assert set(read.read(480)[:, 0]) == {0.5}
