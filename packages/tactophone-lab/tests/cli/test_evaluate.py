import json
from pathlib import Path

import pytest
import soundfile

from tactophone.cli import main
from tactophone.signal.perception.model_file import read_model
from tests.cli.test_train import QUICK
from tests.folders import audiofolder
from tests.sounds import noise


@pytest.fixture(autouse=True)
def own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture
def sound(tmp_path: Path) -> str:
    return str(audiofolder(tmp_path / "sound"))


@pytest.mark.slow
def test_scores_a_model_and_writes_them_into_its_card(
    tmp_path: Path, sound: str, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "a.onnx"
    main(["train", sound, "--out", str(model), *QUICK])
    capsys.readouterr()
    assert (
        main(["evaluate", str(model), "--data", sound, "--note", "stones", "--json"])
        == 0
    )
    captured = capsys.readouterr()
    report = json.loads(captured.out)[str(model)]
    assert (report["recordings"], report["surfaces"]) == (8, 4)
    assert 0 <= report["windows"]["balanced_accuracy"]["value"] <= 1
    assert "trained on these very recordings" in captured.err
    assert read_model(model).card.scores["stones"]["surfaces"] == 4


@pytest.mark.slow
def test_cross_validates_a_recipe_beside_its_baselines(
    sound: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = [
        "evaluate",
        "--data",
        sound,
        "--split",
        "2-fold",
        "--baselines",
        "1",
        *QUICK,
    ]
    assert main(command) == 0
    table = capsys.readouterr().out
    for row in (
        "authors/general",
        "level",
        "permuted 1",
        "area under ROC",
        "stone 03",
    ):
        assert row in table
    assert main([*command, "--json"]) == 0
    reports = json.loads(capsys.readouterr().out)
    # The rough stones of this folder are simply louder.
    assert reports["level"]["windows"]["balanced_accuracy"]["value"] == 1.0


def test_a_note_needs_a_model(sound: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "--data", sound, "--note", "x"]) == 1
    assert "name the MODEL" in capsys.readouterr().err


def test_a_model_that_does_without_the_air_microphone_is_scored_on_files_of_one_channel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = ["file_name,surface,label,tip"]
    for name, label, level in (("a", "smooth", -40), ("b", "rough", -20)):
        soundfile.write(
            tmp_path / f"{name}.wav",
            noise(level_dbfs=level, duration=2, channels=1),
            48_000,
        )
        lines.append(f"{name}.wav,{name},{label},stylus")
    (tmp_path / "metadata.csv").write_text("\n".join(lines))
    assert main(["evaluate", "texture", "--data", str(tmp_path)]) == 0
    assert (
        "the model is for the tip pad, but the recordings are of stylus"
        in capsys.readouterr().err
    )


def test_exchanged_labels_are_suspected(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, model = audiofolder(tmp_path / "sound"), str(tmp_path / "a.onnx")
    main(["train", str(folder), "--recipe", "level", "--out", model])
    manifest = folder / "metadata.csv"
    text = (
        manifest.read_text()
        .replace("rough", "?")
        .replace("smooth", "rough")
        .replace("?", "smooth")
    )
    manifest.write_text(text)
    capsys.readouterr()
    assert main(["evaluate", model, "--data", str(folder)]) == 0
    assert "far worse than chance" in capsys.readouterr().err
