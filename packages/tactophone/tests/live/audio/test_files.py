import itertools
import os
from collections import deque
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.types import FloatArray
from tactophone.live.audio.files import FileSource
from tests.sounds import noise

from . import contract


def write(path: Path, samples: FloatArray, *, sample_rate: int = 48_000) -> Path:
    soundfile.write(
        path, samples, sample_rate, subtype="FLOAT" if path.suffix == ".wav" else None
    )
    return path


@pytest.mark.parametrize("promise", contract.ALL)
@pytest.mark.parametrize("loop", [False, True])
def test_files_keep_the_contract(promise: Callable, loop: bool, tmp_path: Path) -> None:
    path = write(tmp_path / "a.wav", noise(duration=0.1))
    promise(lambda: FileSource(path, block_size=480, loop=loop))


def test_a_file_that_was_exited_yields_no_more(tmp_path: Path) -> None:
    with FileSource(
        write(tmp_path / "a.wav", noise(duration=0.1)), loop=True
    ) as source:
        next(iter(source))
    assert list(source) == []


@pytest.mark.parametrize("block_size", [1, 17, 480, 509, 100_000])
def test_every_sample_comes_once(tmp_path: Path, block_size: int) -> None:
    samples = noise(duration=0.1)
    with FileSource(
        write(tmp_path / "a.wav", samples), block_size=block_size
    ) as source:
        np.testing.assert_array_equal(
            np.concatenate([block.samples for block in source]), samples
        )


def test_a_loop_goes_on_in_time(tmp_path: Path) -> None:
    samples = noise(duration=0.01)
    with FileSource(
        write(tmp_path / "a.wav", samples), block_size=320, loop=True
    ) as source:
        blocks = list(itertools.islice(source, 5))
    assert [block.start for block in blocks] == [0, 320, 480, 800, 960]
    np.testing.assert_array_equal(blocks[2].samples, samples[:320])


def test_a_loop_of_a_file_that_was_emptied_ends_in_one_line(tmp_path: Path) -> None:
    """It took a core, at the priority of sound, for as long as the run lasted."""
    path = write(tmp_path / "a.wav", noise(duration=0.1))
    with FileSource(path, block_size=480, loop=True) as source:
        played = iter(source)
        next(played)
        os.truncate(path, 44)
        with pytest.raises(DatasetError, match="no sound is left in it"):
            deque(itertools.islice(played, 1000), maxlen=0)


@pytest.mark.parametrize(
    ("name", "rate", "channels"),
    [("a.flac", 44_100, 1), ("a.wav", 2_200, 2), ("a.wav", 2_000, 1)],
)
def test_rates_and_formats(tmp_path: Path, name: str, rate: int, channels: int) -> None:
    source = FileSource(
        write(tmp_path / name, noise(duration=0.1, channels=channels), sample_rate=rate)
    )
    assert (source.sample_rate, source.channels, source.size) == (rate, channels, 4800)
    assert source.duration == 4800 / rate


@pytest.mark.parametrize(
    ("samples", "rate", "words"),
    [
        (noise(duration=0.1, channels=3), 48_000, "3 channels"),
        (noise(duration=0.1), 1_000, "1000 Hz, but 2000"),
        (noise(duration=0.0), 48_000, "no sound at all"),
    ],
)
def test_an_unusable_file_is_refused_by_name(
    tmp_path: Path, samples: FloatArray, rate: int, words: str
) -> None:
    with pytest.raises(DatasetError, match=rf"finger\.wav: .*{words}"):
        FileSource(write(tmp_path / "finger.wav", samples, sample_rate=rate))


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"none\.wav: no such file"):
        FileSource(tmp_path / "none.wav")


def test_a_file_that_is_no_sound(tmp_path: Path) -> None:
    path = tmp_path / "notes.wav"
    path.write_text("bought a finger")
    with pytest.raises(DatasetError, match=r"notes\.wav: cannot be read as sound"):
        FileSource(path)


def test_a_file_damaged_later_on_says_where(tmp_path: Path) -> None:
    path = write(tmp_path / "a.flac", noise(duration=2))
    content = bytearray(path.read_bytes())
    hole = slice(len(content) // 2, len(content) * 3 // 4)
    content[hole] = bytes(len(content[hole]))
    path.write_bytes(content)
    with (
        FileSource(path) as source,
        pytest.raises(DatasetError, match=r"a\.flac: damaged \d\.\d s in"),
    ):
        list(source)
