from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.signal.perception.model_file import read_model
from tests.folders import audiofolder

QUICK = ["--recipe", str(Path(__file__).with_name("quick.toml"))]


def recipe(folder: Path, line: str) -> Path:
    """Write the quick recipe with another line, or with another value for one of its
    lines."""
    lines = Path(QUICK[1]).read_text().splitlines()
    name = line.partition(" ")[0]
    kept = [each for each in lines if each.partition(" ")[0] != name]
    path = folder / "recipe.toml"
    path.write_text("\n".join([*kept, line]) + "\n")
    return path


@pytest.mark.slow
def test_trains_a_model_that_the_live_side_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "stones.onnx"
    assert (
        main(["train", str(audiofolder(tmp_path / "sound")), "--out", str(out), *QUICK])
        == 0
    )
    assert capsys.readouterr().out == f"{out}\n"
    card = read_model(out).card
    assert (card.name, card.channels, card.gate.rule) == ("stones", 2, "mean_absolute")
    assert card.training["recipe"] == "authors/general"
    assert card.training["settings"]["hop"] == 64
    assert sorted(path.name for path in tmp_path.iterdir()) == ["sound", "stones.onnx"]


def test_few_surfaces_are_said_to_say_little_of_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = str(audiofolder(tmp_path / "sound")), str(tmp_path / "a.onnx")
    few = ["--filter", "surface=stone 00,stone 03"]
    assert main(["train", data, "--recipe", "level", "--out", out, *few]) == 0
    assert "warning: 1 smooth and 1 rough surface(s)" in capsys.readouterr().err


def test_the_same_sound_under_two_surfaces_is_warned_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    long = np.random.default_rng(0).uniform(-0.3, 0.3, (60_000, 2))
    for number in range(6):
        label = "rough" if number % 2 else "smooth"
        path = tmp_path / "sound" / label / f"thing{'abcdef'[number]}_1.wav"
        path.parent.mkdir(parents=True, exist_ok=True)
        soundfile.write(path, long[8000 * number :][:16_000], 4000)
    data, out = str(tmp_path / "sound"), str(tmp_path / "a.onnx")
    main(["train", data, "--recipe", "level", "--out", out])
    assert "the same sound stands under two surfaces" in capsys.readouterr().err


def test_training_continues_from_a_model(tmp_path: Path) -> None:
    sound, first, second = (
        str(audiofolder(tmp_path / "sound")),
        tmp_path / "a.onnx",
        tmp_path / "b.onnx",
    )
    main(["train", sound, "--out", str(first), *QUICK])
    assert (
        main(["train", sound, "--out", str(second), "--from", str(first), *QUICK]) == 0
    )
    assert read_model(second).card.training["start"] == "a.onnx"
    one_channel = recipe(tmp_path, 'variant = "one-channel"')
    assert (
        main(["train", sound, "--from", str(first), "--recipe", str(one_channel)]) == 1
    )


@pytest.mark.parametrize(
    ("line", "options", "message"),
    [
        ("epochs = 0", [], "`int` >= 1 - at `$.epochs`"),
        ("noise = nan", [], "`float` >= 0.0 - at `$.noise`"),
        ('contact_threshold = "loud"', [], "at `$.contact_threshold`"),
        ("opus_bitrate = 5", [], "`int` >= 16 - at `$.opus_bitrate`"),
        ("epoch = 3", [], "unknown field `epoch`; did you mean epochs?"),
        ('recipe = "textur"', [], "did you mean texture?"),
        (
            "",
            ["--filter", "label=soft"],
            "no recording has it; label is one of rough, smooth",
        ),
    ],
)
def test_an_impossible_request_is_one_line(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    line: str,
    options: list[str],
    message: str,
) -> None:
    sound = audiofolder(tmp_path / "sound")
    assert (
        main(
            [
                "train",
                str(sound),
                "--out",
                str(tmp_path / "a.onnx"),
                "--recipe",
                str(recipe(tmp_path, line)),
                *options,
            ]
        )
        == 1
    )
    assert message in capsys.readouterr().err
    assert not (tmp_path / "a.onnx").exists()


def test_quiet_recordings_are_too_quiet_for_the_papers_threshold(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--recipe", str(recipe(tmp_path, "reference_code = false"))]
    assert (
        main(
            [
                "train",
                str(audiofolder(tmp_path / "sound")),
                "--out",
                str(tmp_path / "a.onnx"),
                *options,
            ]
        )
        == 1
    )
    assert (
        "no window of the smooth recordings is louder than -26.0 dBFS"
        in capsys.readouterr().err
    )
    assert not (tmp_path / "a.onnx").exists()


def test_a_broken_recording_is_named_and_the_others_train(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = audiofolder(tmp_path / "sound")
    (sound / "audio" / "00_0.flac").write_text("no sound")
    assert main(["train", str(sound), "--out", str(tmp_path / "a.onnx"), *QUICK]) == 0
    assert "left out: " in capsys.readouterr().err


def noisy_folder(root: Path, surfaces: int) -> Path:
    """Write a recording of each of so many smooth and as many rough surfaces: noise
    that is loud where it is rough."""
    rng = np.random.default_rng(0)
    for label, level in (("smooth", 0.05), ("rough", 0.5)):
        for number in range(surfaces):
            path = root / label / f"{label}{'abcdef'[number]}" / "1.wav"
            path.parent.mkdir(parents=True)
            soundfile.write(path, level * rng.uniform(-1, 1, 16_000), 8000)
    return root


def test_training_ends_with_the_score_of_surfaces_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, out = str(noisy_folder(tmp_path / "sound", 3)), str(tmp_path / "a.onnx")
    assert main(["train", data, "--recipe", "level", "--out", out]) == 0
    said = capsys.readouterr().err
    assert "trained on 6 recordings of 3 smooth and 3 rough surfaces" in said
    assert "felt of surfaces left out in turn (3-fold): " in said
    assert f"evaluate --data {data} --recipe level --split 3-fold" in said


@pytest.mark.parametrize(("surfaces", "options"), [(2, []), (3, ["--no-score"])])
def test_without_a_score_training_ends_with_the_command_for_one(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    surfaces: int,
    options: list[str],
) -> None:
    data = str(noisy_folder(tmp_path / "sound", surfaces))
    out = str(tmp_path / "a.onnx")
    assert main(["train", data, "--recipe", "level", "--out", out, *options]) == 0
    said = capsys.readouterr().err
    assert "left out in turn" not in said
    assert "score it on surfaces that it never met: `tactophone evaluate" in said


def test_kin_that_cannot_be_divided_do_not_cost_the_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = noisy_folder(tmp_path / "sound", 3)
    for number, path in enumerate(sorted((data / "rough").iterdir()), 1):
        path.rename(path.with_name(f"stone v{number}"))
    out = tmp_path / "a.onnx"
    assert main(["train", str(data), "--recipe", "level", "--out", str(out)]) == 0
    assert "not scored by leaving surfaces out: " in capsys.readouterr().err
    assert out.is_file()
