import json
from pathlib import Path

import numpy as np
import pytest

from tactophone.cli import main
from tactophone_lab.datasets.open import open_dataset
from tests.datasets.test_heights import STEP, SURFACES, ridges
from tests.folders import audiofolder


def test_a_map_is_measured_and_written_into_a_data_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "map.npy", ridges())
    data = audiofolder(tmp_path / "data")
    command = ["roughness", str(tmp_path / "map.npy"), "--pixel", str(STEP)]
    assert main([*command, "--write-metadata", str(data), "--surface", "stone 01"]) == 0
    printed = capsys.readouterr().out
    assert "Ra   2.5" in printed
    assert "Rq   2.8" in printed
    values = {
        (take.surface, take.known("ra_um")[:3])
        for take in open_dataset(data).recordings
    }
    assert values == {
        ("stone 00", ""),
        ("stone 01", "2.5"),
        ("stone 02", ""),
        ("stone 03", ""),
    }


def test_a_measured_profile_speaks_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["roughness", str(SURFACES / "plywood.npz"), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert 3e-6 < found["profile"]["ra"] < 4.5e-6
    assert "area" not in found


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "give --pixel"),
        (["--pixel", "-1"], "--pixel -1: must be over 0 m"),
        (["--pixel", "1e-6"], "measure a longer line"),
        (["--pixel", "1e-5", "--surface", "stone"], "belong together"),
    ],
)
def test_an_impossible_request_is_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    np.save(tmp_path / "line.npy", ridges()[0, :100])
    assert main(["roughness", str(tmp_path / "line.npy"), *options]) == 1
    assert message in capsys.readouterr().err


def test_a_plane_has_no_elements_to_measure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "flat.npy", np.zeros((200, 500)))
    data = audiofolder(tmp_path / "data")
    command = [
        "roughness",
        str(tmp_path / "flat.npy"),
        "--pixel",
        str(STEP),
        "--write-metadata",
        str(data),
    ]
    assert main([*command, "--surface", "stone 01"]) == 0
    assert "nan" not in capsys.readouterr().out
    assert {take.known("rsm_um") for take in open_dataset(data).recordings} == {""}
