import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.types import FloatArray
from tactophone.signal.perception.model_file import read_model
from tactophone_lab.training.onnx_export import write_graph
from tests.models import write_tiny_model
from tests.sounds import noise, tone


@pytest.fixture
def model(tmp_path: Path) -> str:
    return str(write_tiny_model(tmp_path / "tiny.onnx"))


def record(path: Path, *, frequency: float = 400.0, sample_rate: int = 48_000) -> str:
    path.parent.mkdir(exist_ok=True)
    soundfile.write(path, tone(frequency, sample_rate=sample_rate), sample_rate)
    return str(path)


@pytest.mark.slow
def test_everything_lies_beside_each_other(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib")
    out = tmp_path / "new" / "out"
    assert (
        main(
            [
                "feel",
                record(tmp_path / "a.wav"),
                "--model",
                model,
                "--out",
                str(out),
                "--plot",
                "--json",
            ]
        )
        == 0
    )
    (result,) = json.loads(capsys.readouterr().out)
    assert sorted(path.name for path in out.iterdir()) == [
        "a.feel.png",
        "a.haptic.wav",
        "a.timeline.csv",
        "a.timeline.json",
    ]
    assert set(result["files"].values()) == {str(path) for path in out.iterdir()}
    assert result["rough"] > 0.5
    assert result["model"] == "tiny"


@pytest.mark.parametrize("sample_rate", [2_000, 2_200, 11_025, 44_100, 96_000])
def test_any_rate_gives_the_same_vibration(
    model: str, tmp_path: Path, sample_rate: int
) -> None:
    path = record(tmp_path / "a.wav", sample_rate=sample_rate)
    assert main(["feel", path, "--model", model, "--out", str(tmp_path)]) == 0
    wave, rate = soundfile.read(tmp_path / "a.haptic.wav")
    assert (rate, len(wave)) == (48_000, 52_800)
    assert 0.495 < np.abs(wave[24_000:48_000]).max() <= 0.5  # the default ceiling


def test_a_file_that_fails_is_named_and_the_others_go_on(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bad.wav").write_text("no sound")
    paths = [
        str(tmp_path / "bad.wav"),
        record(tmp_path / "good.wav"),
        str(tmp_path / "none.wav"),
    ]
    assert main(["feel", *paths, "--model", model, "--out", str(tmp_path)]) == 1
    printed = capsys.readouterr()
    assert [line.split(": ")[1] for line in printed.err.splitlines()] == [
        paths[0],
        paths[2],
    ]
    assert "good.haptic.wav" in printed.out


def test_recordings_of_one_name_do_not_overwrite_each_other(
    model: str, tmp_path: Path
) -> None:
    paths = [
        record(tmp_path / "x" / "a.wav"),
        record(tmp_path / "y" / "a.wav", frequency=100),
    ]
    assert main(["feel", *paths, "--model", model, "--out", str(tmp_path)]) == 0
    assert {path.name for path in tmp_path.glob("*.wav")} == {
        "a.haptic.wav",
        "a-2.haptic.wav",
    }


def test_a_known_label_is_shown(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(tmp_path / "a.wav")
    (tmp_path / "metadata.csv").write_text(
        "file_name,surface,label\na.wav,slate,rough\n"
    )
    assert main(["feel", path, "--model", model, "--out", str(tmp_path)]) == 0
    assert "labelled rough" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ceiling", "2"], "--ceiling 2: must be 0 to 1 of full drive"),
        (["--threshold", "5"], "must be -120 to 0 dBFS"),
    ],
)
def test_a_wrong_setting_is_one_line(
    model: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: str,
) -> None:
    assert (
        main(
            [
                "feel",
                record(tmp_path / "a.wav"),
                "--model",
                model,
                "--out",
                str(tmp_path),
                *arguments,
            ]
        )
        == 1
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


def test_a_misspelt_profile_brings_the_nearest_of_all(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["feel", "a.wav", "--profile", "percept"])
    assert "did you mean perceptual" in capsys.readouterr().err


def test_a_threshold_over_everything_renders_nothing_and_says_why(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(tmp_path / "a.wav")
    assert (
        main(
            ["feel", path, "--model", model, "--out", str(tmp_path), "--threshold", "0"]
        )
        == 0
    )
    assert "loudest window: -9.0 dBFS" in capsys.readouterr().out
    assert not soundfile.read(tmp_path / "a.haptic.wav")[0].any()


def test_a_microphone_in_one_channel_of_a_stereo_file_is_found_and_said(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mono = Path(record(tmp_path / "mono.wav"))
    samples, rate = soundfile.read(mono, dtype="float32")
    soundfile.write(
        tmp_path / "right.wav", np.stack([0 * samples, samples], axis=1), rate
    )
    paths = [str(mono), str(tmp_path / "right.wav")]
    assert (
        main(["feel", *paths, "--model", model, "--out", str(tmp_path), "--json"]) == 0
    )
    one, other = json.loads(capsys.readouterr().out)
    assert (one["contact"], one["rough"]) == (other["contact"], other["rough"])
    assert (one["notes"], len(other["notes"])) == ([], 1)


def test_a_rate_under_the_models_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record(tmp_path / "a.wav", sample_rate=8000)
    assert main(["feel", path, "--tip", "stylus", "--out", str(tmp_path)]) == 0
    assert "recorded at 8000 Hz" in " ".join(capsys.readouterr().out.split())


def test_a_folder_is_felt_file_by_file_without_earlier_results(
    model: str, tmp_path: Path
) -> None:
    folder = tmp_path / "own"
    for name in ("rough/slate/a.wav", "smooth/glass/b.wav"):
        (folder / name).parent.mkdir(parents=True)
        record(folder / name)
    for _ in range(2):
        assert main(["feel", str(folder), "--model", model, "--out", str(folder)]) == 0
    assert {path.name for path in folder.glob("*.wav")} == {
        "a.haptic.wav",
        "b.haptic.wav",
    }


def test_a_folder_without_sound_is_no_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["feel", str(tmp_path), "--out", str(tmp_path)]) == 1
    assert (
        f"{tmp_path}: a folder; give a WAV or FLAC recording" in capsys.readouterr().err
    )


def test_results_that_cannot_be_written_are_reported_in_one_line(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # A folder stands where the file would go.
    (tmp_path / "out" / "a.haptic.wav").mkdir(parents=True)
    assert (
        main(
            [
                "feel",
                record(tmp_path / "a.wav"),
                "--model",
                model,
                "--out",
                str(tmp_path / "out"),
            ]
        )
        == 1
    )
    (line,) = capsys.readouterr().err.splitlines()
    assert f"the results cannot be written to {tmp_path / 'out'}" in line


def test_a_file_of_integers_in_floats_is_said_to_be_no_sound(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(tmp_path / "a.wav", 32_767 * tone(400.0), 48_000, subtype="FLOAT")
    assert (
        main(
            ["feel", str(tmp_path / "a.wav"), "--model", model, "--out", str(tmp_path)]
        )
        == 0
    )
    printed = capsys.readouterr().out
    assert "scale a file of floats to -1 to 1" in printed
    assert "cause      the samples are no sound: see the note" in printed


def test_digital_silence_is_said_to_be_that(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(tmp_path / "a.wav", np.zeros((48_000, 2)), 48_000)
    assert (
        main(
            ["feel", str(tmp_path / "a.wav"), "--model", model, "--out", str(tmp_path)]
        )
        == 0
    )
    assert (
        "threshold  none: the recording is digital silence\n" in capsys.readouterr().out
    )


def test_sound_for_an_imported_model_stays_as_it_was_recorded(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = 1e-3 * tone(400) + 0.01
    soundfile.write(tmp_path / "a.wav", sound, 48_000)
    own = read_model(Path(model))
    imported = replace(own.card, training={"source": "general.pt"})
    write_graph(tmp_path / "imported.onnx", onnx.load(model), imported)
    for name, notes in ((model, 2), (str(tmp_path / "imported.onnx"), 0)):
        assert (
            main(
                [
                    "feel",
                    str(tmp_path / "a.wav"),
                    "--model",
                    name,
                    "--out",
                    str(tmp_path),
                    "--json",
                ]
            )
            == 0
        )
        (result,) = json.loads(capsys.readouterr().out)
        changed = [
            note for note in result["notes"] if "removed" in note or "amplified" in note
        ]
        assert len(changed) == notes


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sound", "words"),
    [
        (
            np.clip(8 * noise(channels=1), -1, 1),
            "is clipped: record it again with less gain",
        ),
        (np.hstack([noise(channels=1)] * 2), "both channels carry the same sound"),
        (
            np.hstack([noise(level_dbfs=-50, channels=1), tone(330)]),
            "exchange the two plugs",
        ),
        (
            4 * noise(level_dbfs=0, channels=1),
            "",
        ),  # floats may go over 1: that is not clipped
    ],
)
def test_what_is_wrong_with_the_microphones_is_a_note(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], sound: FloatArray, words: str
) -> None:
    path = tmp_path / "a.wav"
    soundfile.write(path, np.tile(sound, (2, 1)), 48_000, subtype="FLOAT")
    assert main(["feel", str(path), "--out", str(tmp_path), "--json"]) == 0
    (result,) = json.loads(capsys.readouterr().out)
    found = [
        note for note in result["notes"] if "clipped" in note or "microphones" in note
    ]
    assert [words in note for note in found] == [True] * bool(words)


def test_a_low_rate_is_said_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = np.hstack(
        [tone(400, duration=2, sample_rate=4000) + noise(duration=1 / 6, channels=1)]
        * 2
    )
    soundfile.write(tmp_path / "a.wav", sound, 4000)
    assert (
        main(["feel", str(tmp_path / "a.wav"), "--out", str(tmp_path), "--json"]) == 0
    )
    (result,) = json.loads(capsys.readouterr().out)
    assert [note for note in result["notes"] if "Hz" in note and "hum" not in note] == [
        "recorded at 4000 Hz, so without sound over 2000 Hz, but the model uses up to "
        "8000: rough may be rendered smooth; record at a higher rate"
    ]


def test_a_recording_shorter_than_a_level_is_no_digital_silence(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(tmp_path / "a.wav", tone(400, duration=0.01), 48_000)
    assert (
        main(
            ["feel", str(tmp_path / "a.wav"), "--model", model, "--out", str(tmp_path)]
        )
        == 0
    )
    assert (
        "threshold  none: the recording is too short to show its noise"
        in capsys.readouterr().out
    )


def test_noise_over_every_threshold_is_said_to_count_as_touch(
    model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(
        tmp_path / "a.wav",
        noise(level_dbfs=-3, duration=2, channels=1),
        48_000,
        subtype="FLOAT",
    )
    assert (
        main(
            ["feel", str(tmp_path / "a.wav"), "--model", model, "--out", str(tmp_path)]
        )
        == 0
    )
    assert "louder than any threshold" in capsys.readouterr().out


def test_noise_far_under_any_microphones_is_not_advised_to_be_touch(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    soundfile.write(
        tmp_path / "quiet.wav",
        noise(level_dbfs=-102, duration=3),
        48_000,
        subtype="FLOAT",
    )
    assert main(["feel", str(tmp_path / "quiet.wav"), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "the microphone or its gain is off" in printed
    assert "--threshold" not in printed
