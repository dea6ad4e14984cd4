import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tests.folders import audiofolder, authors, write_sound


def test_check_names_the_bad_file_and_exits_with_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    audiofolder(tmp_path)
    assert main(["dataset", "check", str(tmp_path)]) == 0
    (tmp_path / "audio" / "00_0.flac").unlink()
    assert main(["dataset", "check", str(tmp_path)]) == 1
    printed = capsys.readouterr().out
    assert "00_0.flac: missing" in printed
    assert printed.endswith("8 recordings, 1 unusable, 1 problem\n")


def test_check_and_show_speak_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    audiofolder(tmp_path)
    assert main(["dataset", "check", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"recordings": 8, "problems": []}
    assert main(["dataset", "show", str(tmp_path), "--json"]) == 0
    surface = {
        "surface": "stone 00",
        "label": "rough",
        "tier": "-",
        "scenario": "hand, table",
        "recordings": 2,
    }
    assert json.loads(capsys.readouterr().out)["surfaces"][0] == surface


def test_check_prints_one_line_for_a_warning_of_many(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    audiofolder(tmp_path)
    for path in (tmp_path / "audio").iterdir():
        sound = np.tile([1.0, -1.0], 24_000)
        soundfile.write(path, np.stack([sound, 0.1 * sound], axis=1), 48_000)
    main(["dataset", "check", str(tmp_path)])
    printed = capsys.readouterr().out
    assert printed.count("clipped: 50.00%") == 1
    assert "8 times 'clipped', such as" in printed


def test_show_prints_a_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "show", str(audiofolder(tmp_path))]) == 0
    assert "stone 03" in capsys.readouterr().out


def test_no_dataset_is_one_line_and_exit_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["dataset", "check", str(tmp_path)]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_a_split_is_shown_written_and_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    audiofolder(tmp_path)
    assert (
        main(["dataset", "split", str(tmp_path), "--by", "2-fold", "--write", "--json"])
        == 0
    )
    assert [row["fold"] for row in json.loads(capsys.readouterr().out)] == [
        "fold 1",
        "fold 2",
    ]
    assert main(["dataset", "check", str(tmp_path)]) == 0
    assert main(["dataset", "split", str(tmp_path), "--by", "predefined"]) == 0
    assert (
        main(
            [
                "dataset",
                "split",
                str(tmp_path),
                "--by",
                "2-fold",
                "--fold",
                "3",
                "--write",
            ]
        )
        == 1
    )


def test_a_layout_is_imported_and_has_a_card(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(
            [
                "dataset",
                "import",
                str(authors(tmp_path / "theirs")),
                str(tmp_path / "ours"),
            ]
        )
        == 0
    )
    assert capsys.readouterr().out.startswith("7 recordings in")
    assert main(["dataset", "card", str(tmp_path / "ours")]) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "ours" / "README.md")


def test_check_refuses_the_channels_that_feel_refuses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_sound(audiofolder(tmp_path) / "audio" / "00_0.flac", channels=4)
    manifest = (
        (tmp_path / "metadata.csv")
        .read_text()
        .replace("00_0.flac,stone 00,rough,contact|air", "00_0.flac,stone 00,rough,")
    )
    (tmp_path / "metadata.csv").write_text(manifest)
    assert main(["dataset", "check", str(tmp_path)]) == 1
    assert "4 channels, but a finger has contact and air" in capsys.readouterr().out
    assert main(["feel", str(path), "--out", str(tmp_path / "felt.wav")]) == 1


def test_class_folders_are_imported_with_their_surfaces_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("rough/granite_1", "rough/granite_2", "smooth/glass_1"):
        write_sound(tmp_path / "theirs" / f"{name}.wav")
    assert (
        main(["dataset", "import", str(tmp_path / "theirs"), str(tmp_path / "ours")])
        == 0
    )
    printed = capsys.readouterr()
    assert printed.out.startswith("3 recordings in")
    assert (
        "warning: 2 surfaces were taken from file names: glass, granite" in printed.err
    )
    assert main(["dataset", "check", str(tmp_path / "ours")]) == 0
