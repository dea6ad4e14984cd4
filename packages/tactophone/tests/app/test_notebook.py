"""What a notebook shows, and what the API page says of parameters."""

import inspect
import re
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone import classify, open_live, open_recording

SECTION = re.compile(r"\nParameters\n-+\n(.*?)(?=\n\S[^\n]*\n-+\n|\Z)", re.DOTALL)


@pytest.fixture
def finger(tmp_path: Path) -> Path:
    """A second of quiet noise with half a second of scratching."""
    rng = np.random.default_rng(0)
    sound = 1e-4 * rng.standard_normal((48_000, 2))
    sound[16_000:40_000] += 0.05 * rng.standard_normal((24_000, 2))
    path = tmp_path / "finger.wav"
    soundfile.write(path, sound, 48_000)
    return path


def test_a_table_is_a_line_and_in_a_notebook_a_picture(finger: Path) -> None:
    table = classify(finger)
    line = repr(table)
    assert "\n" not in line
    assert len(line) < 100
    assert f"{len(table)} predictions" in line
    pytest.importorskip("matplotlib")
    assert 'src="data:image/png;base64,' in table._repr_html_()


def test_an_open_recording_is_a_line_and_decides_the_same_after_its_picture(
    finger: Path,
) -> None:
    pytest.importorskip("matplotlib")
    recording = open_recording(finger)
    assert repr(recording).startswith("<OpenRecording: finger.wav, 1.0 s, 2 channels")
    before = [step.predictions for step in recording.steps()]
    assert "data:image/png" in recording._repr_html_()
    assert [step.predictions for step in recording.steps()] == before


def test_a_live_run_says_what_it_is() -> None:
    live = open_live(_Silence())
    assert repr(live) == "<Live: _Silence at 48000 Hz, not started or ended>"


class _Silence:
    """A source without a block."""

    sample_rate = 48_000
    channels = 2

    def __enter__(self) -> "_Silence":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def __iter__(self) -> "_Silence":
        return self

    def __next__(self) -> tactophone.AudioBlock:
        raise StopIteration


PUBLIC = [
    name
    for name in tactophone.__all__
    if SECTION.search(inspect.getdoc(getattr(tactophone, name)) or "")
]


@pytest.mark.parametrize("name", PUBLIC)
def test_the_parameters_of_the_api_page_are_the_signature_s(name: str) -> None:
    thing = getattr(tactophone, name)
    found = SECTION.search(inspect.getdoc(thing) or "")
    assert found is not None
    entries = [line for line in found[1].splitlines() if line and line[0] != " "]
    documented = [entry.split(":")[0].strip() for entry in entries]
    wanted = [
        each for each in inspect.signature(thing).parameters if not each.startswith("_")
    ]
    assert documented == wanted
