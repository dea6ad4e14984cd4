"""A made-up folder in the layout of published BioTac sets."""

from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import Touch
from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.lab.dataset.checks import check
from tactophone.lab.dataset.layouts import PAC, import_biotac
from tactophone.lab.dataset.read import open_dataset
from tests.lab.dataset.folders import write_text


def biotac(root: Path) -> Path:
    pac = 2048 + 200 * np.sin(2 * np.pi * 110 * np.arange(22 * 100) / 2200)
    for name in ("mat1/mat1_1_bio.csv", "mat2/mat2_1_bio.csv"):
        lines = (",".join(["0", *(f"{value:.0f}" for value in row)]) for row in pac.reshape(-1, 22))
        write_text(root / "raw_data" / name, ",".join(["time", *PAC]), *lines)
    write_text(root / "raw_data" / "mat1" / "notes.csv", "a,b", "1,2")
    write_text(root / "labels.csv", "surface;label", "mat1;rough", "mat2;smooth")
    return root


def test_the_vibration_of_a_biotac_becomes_sound(tmp_path: Path) -> None:
    made, problems = import_biotac(biotac(tmp_path / "theirs"), tmp_path / "ours")
    assert [problem.path.name for problem in problems] == ["notes.csv"]
    opened = open_dataset(tmp_path / "ours")
    assert check(opened) == ()
    labels = {take.surface: take.label for take in opened.recordings}
    assert labels == {"mat1": Touch.ROUGH, "mat2": Touch.SMOOTH}
    sound, rate = soundfile.read(made.recordings[0].path)
    assert (rate, sound.shape) == (2200, (2200,))
    assert np.abs(np.fft.rfft(sound)).argmax() == 110
    assert np.abs(sound).max() == pytest.approx(200 / 2048, rel=0.01)


def test_the_command_names_the_format(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    theirs, ours = str(biotac(tmp_path / "theirs")), str(tmp_path / "ours")
    assert main(["dataset", "import", theirs, ours, "--format", "biotac"]) == 0
    assert capsys.readouterr().out.startswith("2 recordings in")


def test_a_folder_without_such_files_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="nothing to import"):
        import_biotac(tmp_path, tmp_path / "ours")
