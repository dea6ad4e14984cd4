import json
import shutil
from pathlib import Path

import pytest

from tactophone.cli import main


def test_a_small_set_is_rendered_by_one_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "set"
    args = [
        "simulate",
        "dataset",
        str(out),
        "--objects",
        "lava stone,3",
        "--takes",
        "wiggle",
        "--seconds",
        "0.5",
    ]
    assert main([*args, "--jobs", "1"]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    assert len((out / "metadata.csv").read_text().splitlines()) == 3


@pytest.mark.slow
def test_a_hand_has_a_labelled_recording_for_each_finger(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", "hand", str(tmp_path / "hand"), "--fingers", "2"]) == 0
    names = [Path(line).name for line in capsys.readouterr().out.split()]
    assert names == ["microphones-thumb.wav", "microphones-index.wav"]
    manifest = (tmp_path / "hand" / "metadata.csv").read_text()
    assert all(name in manifest for name in (*names, "=smooth", "=rough"))
    assert main(["simulate", "hand", str(tmp_path), "--fingers", "11"]) == 1
    assert "1 to 10" in capsys.readouterr().err


@pytest.mark.slow
def test_runs_are_rendered_with_their_truth(tmp_path: Path) -> None:
    assert main(["simulate", "competition", str(tmp_path), "--runs", "1"]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {
        "day_1_run_1.flac",
        "day_2_run_1.flac",
        "metadata.csv",
    }


@pytest.mark.slow
def test_the_catalogue_is_printed_with_its_roughness(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["simulate", "objects", "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) >= 23
    assert {"object", "label", "material", "mounting", "Ra_um", "Rq_um"} <= set(rows[0])


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--objects", "cheese"], "is not an object"),
        (["--takes", "long"], "is not a take"),
        (["--takes", "short_ligth"], "--takes: 'short_ligth' is not a take"),
        (["--seconds", "0"], "must be 0.1 to 600 s"),
        (["--seconds", "1e9"], "must be 0.1 to 600 s"),
        (["--jobs", "1000000000"], "must be 1 to 256"),
        (["--seed", "-1"], "--seed -1: must be 0 to 4294967295"),
        (["--authors-layout", "--objects", "all"], "00 to 22"),
        (["--authors-layout", "--tip", "stylus"], "needs their finger, tip pad"),
    ],
)
def test_a_mistake_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], args: list[str], message: str
) -> None:
    assert main(["simulate", "dataset", str(tmp_path), *args]) == 1
    assert message in capsys.readouterr().err


def test_what_does_not_fit_on_the_disk_is_refused_before_it_is_rendered(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=10_000_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    words = ["simulate", "dataset", str(tmp_path), "--objects", "random:1000:1"]
    assert main(words) == 1
    said = capsys.readouterr().err
    assert "210000 s of sound take 16.1 GB or more, but 0.0 GB are free" in said
    assert list(tmp_path.rglob("*.flac")) == []
