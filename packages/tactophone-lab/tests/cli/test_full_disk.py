"""A full disk ends a verb with one sentence that names what was to be written, and what
was there stays."""

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest
import torch

from tactophone.cli import main
from tactophone.core.errors import ConfigError
from tactophone.core.recordings.metadata import write_metadata
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import Gate
from tactophone_lab.training.onnx_export import make_card, write_model
from tactophone_lab.training.paper_network import PaperNetwork, weights_of
from tests.folders import audiofolder
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model
from tests.signal.perception.test_calibration_file import CALIBRATION
from tests.surfaces import surfaces

VERBS = {
    "pair init": ("pair init --name me --identity {disk}/keys", "{disk}/keys"),
    "feel": (
        "feel {data}/audio/00_0.flac --out {disk} --plot",
        "cannot be written to {disk}",
    ),
    "replay": ("replay {log} --out {disk}", "{disk}"),
    "replay --to-rosbag": ("replay {log} --to-rosbag {disk}/bag", "{disk}/bag"),
    "replay --audio": ("replay {log} --audio {disk}/sound.mcap", "{disk}/sound.mcap"),
    "dataset show": ("dataset show {data} --plot {disk}/new.png", "{disk}/new.png"),
    "dataset card": ("dataset card {disk}/data", "{disk}/data/README.md"),
    "dataset split": (
        "dataset split {disk}/data --by 2-fold --write",
        "{disk}/data/metadata.csv",
    ),
    "dataset import": ("dataset import {data} {disk}/new", "free some space"),
    "dataset import of a log": (
        "dataset import {log} {disk}/new --label rough",
        "{disk}/new",
    ),
    "demo": ("demo --out {disk}/demo", "{disk}/demo/microphones.wav"),
    "finetune": (
        "finetune {paper} {data} --general {data} --anyway --out {disk}/old.onnx",
        "{disk}/old.onnx",
    ),
    "import-model": (
        "import-model {published} --out {disk}/old.onnx",
        "{disk}/old.onnx",
    ),
    "simulate hand": (
        "simulate hand {disk}/hand --fingers 1",
        "{disk}/hand/microphones-thumb.wav",
    ),
    "simulate dataset": (
        "simulate dataset {disk}/sim --objects 0 --takes long_light --seconds 1",
        "{disk}/sim",
    ),
    "train": (
        "train {scrapes} --recipe level --out {disk}/old.onnx",
        "{disk}/old.onnx",
    ),
    "train a network": (
        "train {data} --recipe {quick} --out {disk}/old.onnx",
        "{disk}/old.onnx",
    ),
    "evaluate": (
        "evaluate --data {scrapes} --recipe level --split 2-fold --cache {disk}/c "
        "--workers 1",
        "{disk}/c/",
    ),
    "benchmark": (
        "benchmark --data {scrapes} --methods level --splits 2-fold --workers 1 --out "
        "{disk}/b --cache {disk}/c",
        "{disk}/c/",
    ),
    "set-threshold": (
        "set-threshold texture --out {disk}/old.onnx --data {scrapes} --false-bumps "
        "9/min",
        "{disk}/old",
    ),
}
"""A command line, and what its message names."""

ROOM = 5 * 4096
"""Bytes, less than a result takes."""


@pytest.fixture(scope="module")
def places(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("full")
    (folder / "scrapes").mkdir()
    write_metadata(folder / "scrapes", surfaces(folder / "scrapes").recordings)
    model = write_tiny_model(folder / "tiny.onnx")
    log = record(folder / "run.mcap", model)
    data, quick = audiofolder(folder / "data"), Path(__file__).with_name("quick.toml")
    weights = weights_of(PaperNetwork())
    write_model(
        folder / "paper.onnx",
        make_card(weights, name="paper", gate=Gate(-60.0)),
        weights,
    )
    torch.save({"model": PaperNetwork().state_dict()}, folder / "published.pt")
    return {
        "data": data,
        "scrapes": folder / "scrapes",
        "log": log,
        "model": model,
        "quick": quick,
        "paper": folder / "paper.onnx",
        "published": folder / "published.pt",
    }


@pytest.fixture
def disk(tmp_path: Path, places: dict[str, Path]) -> Iterator[Path]:
    """A disk that holds a data set and results, and has no space left."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=4M", "tmpfs", str(disk)],
        capture_output=True,
    )
    if mounted.returncode:
        pytest.skip("a small disk needs root and tmpfs")
    try:
        audiofolder(disk / "data")
        shutil.copy(places["model"], disk / "old.onnx")
        CALIBRATION.write(disk / "calibration.toml")
        with suppress(OSError), (disk / "filler").open("wb", buffering=0) as filler:
            while True:
                filler.write(bytes(4096))
        yield disk
    finally:
        subprocess.run(["umount", "--lazy", str(disk)], check=True)


def old(disk: Path) -> dict[Path, bytes]:
    return {
        path: path.read_bytes()
        for path in disk.rglob("*")
        if path.is_file() and path.name != "filler"
    }


@pytest.mark.slow
@pytest.mark.parametrize(("command", "named"), VERBS.values(), ids=VERBS)
def test_a_full_disk_is_one_sentence_and_costs_nothing_that_was_there(
    disk: Path,
    tmp_path: Path,
    places: dict[str, Path],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    named: str,
) -> None:
    monkeypatch.setattr(
        "tactophone.cli._discard_output", lambda: None
    )  # pytest has taken its descriptor
    monkeypatch.setattr("tactophone_lab.simulation.demonstration.STROKING", 0.1)
    monkeypatch.setattr(
        "tactophone_lab.training.finetuning.train_on_both",
        lambda *_, **__: weights_of(PaperNetwork()),
    )
    before = old(disk)
    assert main([word.format(disk=disk, **places) for word in command.split()]) == 1
    line = capsys.readouterr().err.replace("\n", " ")
    assert named.format(disk=disk) in line
    assert (
        "No space left on device" in line
        or "is the disk full?" in line
        or "choose another" in line
        or "are free" in line
    )
    after = old(disk)
    assert {path: after[path] for path in before} == before
    new = set(after) - set(before)
    assert not any("key" in path.name or path.suffix == ".flac" for path in new)
    assert [path for path in new if not after[path]] == []


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["feel", "replay", "demo", "simulate hand"])
def test_a_disk_that_fills_on_the_way_holds_the_old_results_and_no_half_ones(
    disk: Path,
    tmp_path: Path,
    places: dict[str, Path],
    monkeypatch: pytest.MonkeyPatch,
    verb: str,
) -> None:
    monkeypatch.setattr("tactophone_lab.simulation.demonstration.STROKING", 0.1)
    os.truncate(disk / "filler", (disk / "filler").stat().st_size - ROOM)
    (disk / "00_0.haptic.wav").write_text("old")
    before = old(disk)
    assert (
        main([word.format(disk=disk, **places) for word in VERBS[verb][0].split()]) == 1
    )
    assert old(disk) == before


def test_a_calibration_survives_a_full_disk(disk: Path) -> None:
    with pytest.raises(ConfigError, match="No space left"):
        CALIBRATION.write(disk / "calibration.toml")
    assert Calibration.read(disk / "calibration.toml") == CALIBRATION
