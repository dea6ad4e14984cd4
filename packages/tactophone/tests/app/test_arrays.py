"""Sound that a program already holds is decided as the same sound in a file."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone import ConfigError, DatasetError

RATE = 48_000


@pytest.fixture(scope="module")
def samples() -> "np.ndarray[Any, Any]":
    """A second of noise after half a second of near silence, on two microphones."""
    noise = np.random.default_rng(0).normal(scale=0.1, size=(72_000, 2))
    noise[:24_000] *= 1e-4
    return noise.clip(-1, 1).astype(np.float32)


@pytest.fixture(scope="module")
def path(samples: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("sound") / "finger.wav"
    soundfile.write(path, samples, RATE, subtype="FLOAT")
    return path


class Tensor:
    """As a tensor of torch: no array, but NumPy makes one of it."""

    def __init__(self, samples: Any) -> None:
        self._samples = samples

    def __array__(self, *_: Any, **__: Any) -> Any:
        return self._samples


@pytest.mark.parametrize(
    "given",
    [
        lambda samples: samples,
        lambda samples: samples.astype(np.float64),
        np.asfortranarray,
        Tensor,
    ],
)
def test_an_array_is_decided_as_the_same_sound_in_a_file(
    given: Callable[[Any], Any], samples: Any, path: Path
) -> None:
    expected = tactophone.classify(path)
    table = tactophone.classify(given(samples), sample_rate=RATE)
    assert table.predictions == expected.predictions
    assert table.commands == expected.commands
    assert set(table.touch.tolist()) > {0}


@pytest.mark.parametrize(
    ("dtype", "subtype"), [("int16", "PCM_16"), ("int32", "PCM_24")]
)
def test_integers_are_scaled_as_a_file_of_them(
    dtype: str, subtype: str, samples: Any, tmp_path: Path
) -> None:
    path = tmp_path / "finger.wav"
    soundfile.write(path, samples, RATE, subtype=subtype)
    whole, _ = soundfile.read(path, dtype=dtype)
    table = tactophone.classify(whole, sample_rate=RATE)
    assert table.predictions == tactophone.classify(path).predictions


def test_one_dimension_is_the_contact_microphone(samples: Any, tmp_path: Path) -> None:
    soundfile.write(tmp_path / "mono.wav", samples[:, 0], RATE, subtype="FLOAT")
    table = tactophone.classify(samples[:, 0], sample_rate=RATE)
    assert table.predictions == tactophone.classify(tmp_path / "mono.wav").predictions


def test_an_open_file_is_decided_as_its_path(path: Path) -> None:
    expected = tactophone.classify(path)
    with path.open("rb") as file:
        assert tactophone.classify(file).predictions == expected.predictions
    in_memory = io.BytesIO(path.read_bytes())
    assert tactophone.classify(in_memory).predictions == expected.predictions


def test_a_cut_open_file_is_read_and_named_as_its_path(
    path: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.wav"
    cut.write_bytes(path.read_bytes()[:400_000])
    expected = tactophone.classify(cut)
    table = tactophone.classify(io.BytesIO(cut.read_bytes()))
    assert table.predictions == expected.predictions
    assert table.notes == expected.notes
    assert table.notes


def test_chosen_channels_of_an_array_are_taken(samples: Any, path: Path) -> None:
    wide = np.concatenate([samples[:, 1:], samples[:, :1], samples], axis=1)
    opened = tactophone.open_recording(wide, sample_rate=RATE, channels=(1, 0))
    expected = tactophone.open_recording(path)
    found = [p for step in opened.steps() for p in step.predictions]
    assert found == [p for step in expected.steps() for p in step.predictions]
    assert opened.path is None


def test_an_array_that_is_written_into_later_leaves_the_detectors_sound(
    samples: Any,
) -> None:
    mine = samples.copy()
    steps = tactophone.open_recording(mine, sample_rate=RATE).steps()
    first = next(steps)
    mine[:4096] = 0.5
    again = next(tactophone.open_recording(samples, sample_rate=RATE).steps())
    assert first.predictions == again.predictions


@pytest.mark.parametrize(
    ("given", "words", "message"),
    [
        (np.zeros((2, 9600), np.float32), {"sample_rate": RATE}, r"librosa.*x\.T"),
        (np.zeros((9600, 2), np.float32), {}, "give sample_rate=48000"),
        (np.zeros((9600, 2), np.float32), {"sample_rate": 1e3}, "2000 Hz or more"),
        (np.zeros((9600, 2), np.float32), {"sample_rate": 44100.5}, "whole number"),
        (np.zeros((9600, 3), np.float32), {"sample_rate": RATE}, r"channels=\(0, 1\)"),
        (np.zeros((0, 2), np.float32), {"sample_rate": RATE}, "no sound at all"),
        (np.zeros((9600, 2), np.uint8), {"sample_rate": RATE}, "array of uint8"),
        (np.zeros((9600, 2), complex), {"sample_rate": RATE}, "array of complex128"),
        (np.zeros((9, 96, 2), np.float32), {"sample_rate": RATE}, "has shape"),
        (io.BytesIO(b"no sound"), {}, "the open file: cannot be read as sound"),
        (io.StringIO("text"), {}, "mode 'rb'"),
        (b"finger.wav", {}, "a bytes is no sound"),
        (([0.0], RATE), {}, "a tuple is no sound"),
        ([0.0], {"sample_rate": RATE}, "a list is no sound"),
        ("finger.wav", {"sample_rate": RATE}, "leave it out"),
    ],
)
def test_what_is_no_sound_is_refused_with_the_cure(
    given: Any, words: dict[str, Any], message: str
) -> None:
    with pytest.raises((ConfigError, DatasetError), match=message) as refused:
        tactophone.classify(given, **words)
    assert "\n" not in str(refused.value)


def test_a_table_is_iterated_by_rows_and_printed_in_a_line(path: Path) -> None:
    table = tactophone.classify(path)
    rows = list(table)
    assert len(rows) == len(table)
    assert [row["roughness"] for row in rows] == table.roughness.tolist()
    assert {row["touch"] for row in rows} <= {"none", "smooth", "rough"}
    assert repr(table) == f"<Table of {len(table)} predictions up to 1.5 s>"


def test_a_data_frame_takes_a_table_as_it_is(path: Path) -> None:
    pandas = pytest.importorskip("pandas")
    table = tactophone.classify(path)
    pandas.testing.assert_frame_equal(pandas.DataFrame(table), table.to_pandas())
    assert pandas.DataFrame(table)["contact"].dtype == bool
