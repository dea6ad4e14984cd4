"""A full disk ends the export with one sentence, and leaves no half data set."""

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tactophone.cli import main

pytest.importorskip("pyarrow")


@pytest.fixture(params=["16k", "64k"])
def disk(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Path]:
    """A disk that holds less than the data set, or less than what is added to it."""
    disk = tmp_path / "disk"
    disk.mkdir()
    options = f"size={request.param}"
    mount = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(disk)]
    if subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("a small disk needs root and tmpfs")
    yield disk
    subprocess.run(["umount", "--lazy", str(disk)], check=True)


def test_a_full_disk_is_one_sentence_and_leaves_nothing(
    disk: Path, log: Path, dataset: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = disk / "felt"
    command = ["export-lerobot", str(log), "--with", str(dataset), "--out", str(out)]
    assert main(command) == 1
    line = capsys.readouterr().err.replace("\n", " ")
    assert str(out) in line
    assert "No space left on device" in line
    assert list(disk.rglob("*")) == []
