"""`feel`, `classify` and `evaluate` open a recording by one function, so that they
decide alike."""

import os
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone.app.recordings import open_recording
from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Recording
from tactophone.core.types import FloatArray
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.evaluation.predict import recording_predictor

RATE = 48_000
REAL = os.environ.get("TACTOPHONE_RECORDINGS", "")
REAL_FILES = [
    "G1RhombAluminumMeshVersion2_01",
    "G7FineFoamVersion1_01",
    "G7FineFoamVersion2_01",
    "G3CeramicTile_01",
]


def sound(seed: int = 0, *, begins_in_contact: bool = False) -> FloatArray:
    samples = np.random.default_rng(seed).normal(scale=0.1, size=(2 * RATE, 2))
    samples[RATE:] *= 1e-3
    return np.clip(samples if begins_in_contact else samples[::-1], -1, 1).astype(
        np.float32
    )


def with_fault(name: str, samples: FloatArray) -> FloatArray:
    time = np.arange(len(samples))[:, None] / RATE
    match name:
        case "offset":
            return samples + np.float32(0.05)
        case "hum":
            return samples + np.float32(0.1) * np.sin(2 * np.pi * 50 * time).astype(
                np.float32
            )
        case "quiet":
            return samples * np.float32(0.005)
        case "one channel":
            return samples * np.array([1, 0], np.float32)
        case "mono":
            return samples[:, :1]
    return samples


def decide_alike(path: Path, folder: Path, model: str, *, tip: str = "pad") -> None:
    """Compare the bytes of the tables of `feel`, `classify` and what `evaluate`
    scores."""
    command = ["feel", str(path), "--model", model, "--out", str(folder), "--tip", tip]
    assert main(command) == 0
    table = tactophone.classify(path, model, tip=tip)
    table.to_csv(folder / "classified.csv")
    felt = (folder / f"{path.stem}.timeline.csv").read_bytes()
    assert (folder / "classified.csv").read_bytes() == felt
    take = recording_predictor(model)(Recording(path, "any"))
    assert take.touch is not None
    assert take.touch.tobytes() == table.touch.astype(np.int8).tobytes()
    assert take.time.tobytes() == table.times.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("begins_in_contact", [False, True])
@pytest.mark.parametrize(
    "fault", ["none", "offset", "hum", "quiet", "one channel", "mono"]
)
def test_feel_classify_and_evaluate_decide_alike(
    fault: str, begins_in_contact: bool, tmp_path: Path
) -> None:
    path = tmp_path / "a.wav"
    soundfile.write(
        path,
        with_fault(fault, sound(begins_in_contact=begins_in_contact)),
        RATE,
        subtype="FLOAT",
    )
    decide_alike(path, tmp_path, "texture")


@pytest.mark.skipif(
    not REAL, reason="TACTOPHONE_RECORDINGS names no folder of real recordings"
)
@pytest.mark.parametrize("name", REAL_FILES)
def test_they_decide_alike_on_real_recordings(name: str, tmp_path: Path) -> None:
    path = Path(REAL, "lmt", f"{name}.flac")
    if not path.is_file():
        pytest.skip(f"{path} is not there")
    decide_alike(path, tmp_path, "stylus", tip="stylus")


def test_a_recording_that_begins_in_contact_is_touch_from_its_beginning(
    tmp_path: Path,
) -> None:
    soundfile.write(
        tmp_path / "a.wav", sound(begins_in_contact=True), RATE, subtype="FLOAT"
    )
    table = tactophone.classify(tmp_path / "a.wav")
    assert np.all(
        table.touch[(table.times > 0.3) & (table.times < 0.9)] != tactophone.Touch.NONE
    )


def test_the_notes_say_what_was_corrected(tmp_path: Path) -> None:
    soundfile.write(
        tmp_path / "a.wav", with_fault("offset", sound()), RATE, subtype="FLOAT"
    )
    recording = open_recording(tmp_path / "a.wav")
    assert "offset of +0.050" in recording.notes[0]
    list(recording.steps())
    assert tactophone.classify(tmp_path / "a.wav").notes == tuple(recording.notes)


def test_a_threshold_that_is_given_stands(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", sound(), RATE, subtype="FLOAT")
    recording = open_recording(tmp_path / "a.wav", threshold_dbfs=0.0)
    assert recording.floor is None
    touches = {each.touch for step in recording.steps() for each in step.predictions}
    assert touches == {tactophone.Touch.NONE}


def test_steps_begin_anew_each_time(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", sound(), RATE, subtype="FLOAT")
    recording = open_recording(tmp_path / "a.wav")
    first, again = ([step.predictions for step in recording.steps()] for _ in range(2))
    assert first == again
    assert recording.duration == 2.0


def test_a_model_that_was_read_decides_as_its_name_does(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", sound(), RATE, subtype="FLOAT")
    named, read = (
        [step.predictions for step in open_recording(tmp_path / "a.wav", model).steps()]
        for model in ("texture", read_model(model_path("texture")))
    )
    assert named == read


def test_a_manifest_that_puts_air_first_is_heeded(tmp_path: Path) -> None:
    samples = sound()
    samples[:, 1] *= 0.1
    for folder, order in (("right", [0, 1]), ("exchanged", [1, 0])):
        (tmp_path / folder).mkdir()
        soundfile.write(
            tmp_path / folder / "a.wav", samples[:, order], RATE, subtype="FLOAT"
        )
    manifest = "file_name,surface,label,channels\na.wav,slate,rough,air|contact\n"
    (tmp_path / "exchanged" / "metadata.csv").write_text(manifest)
    right, exchanged = (
        tactophone.classify(tmp_path / folder / "a.wav")
        for folder in ("right", "exchanged")
    )
    assert right.predictions == exchanged.predictions


def test_other_microphones_than_the_model_takes_are_refused(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", sound(), RATE)
    with pytest.raises(
        DatasetError, match="holds contact and contact, but contact and air are needed"
    ):
        recording_predictor("texture")(
            Recording(tmp_path / "a.wav", "any", channels=("contact", "contact"))
        )


def test_a_given_threshold_decides_on_contact(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    soundfile.write(path, sound(), RATE)
    shares = {
        threshold: recording_predictor("texture", threshold_dbfs=threshold)(
            Recording(path, "any")
        ).contact.mean()
        for threshold in (None, -120.0, 0.0)
    }
    # Half of the sound is over its own noise floor.
    assert shares[None] == pytest.approx(0.5, abs=0.1)
    assert shares[-120.0] > 0.9
    assert shares[0.0] == 0
