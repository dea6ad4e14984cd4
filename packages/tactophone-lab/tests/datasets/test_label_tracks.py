"""Labels over time as Audacity and DCASE write them, read and written."""

from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.core.types import Touch
from tactophone_lab.datasets.checks import check
from tactophone_lab.datasets.open import open_dataset
from tests.folders import write_sound


def audacity(folder: Path) -> Path:
    write_sound(folder / "stone1.wav", seconds=2)
    (folder / "stone1.txt").write_text(
        "0.000000\t0.500000\tnone\n\\\t100.0\t200.0\n0.500000\t1.500000\trough\n"
    )
    return folder


def dcase(folder: Path) -> Path:
    for seed, name in enumerate("ab"):
        write_sound(folder / "audio" / f"{name}.wav", seconds=2, seed=seed)
    (folder / "metadata.tsv").write_text(
        "filename\tonset\toffset\tevent_label\n"
        "a.wav\t0.5\t1.5\trough\nb.wav\t0.5\t1\tsmooth\nb.wav\t1.2\t1.5\tsmooth\n"
    )
    return folder


def test_a_label_track_beside_a_sound_is_read(tmp_path: Path) -> None:
    dataset = open_dataset(audacity(tmp_path))
    (recording,) = dataset.recordings
    assert recording.surface == "stone"
    assert recording.label is Touch.ROUGH
    assert [(each.start, each.end, each.label_name) for each in recording.segments] == [
        (0.0, 0.5, "none"),
        (0.5, 1.5, "rough"),
    ]
    assert not [problem for problem in check(dataset) if problem.fatal]


def test_a_table_of_events_is_read(tmp_path: Path) -> None:
    one, two = open_dataset(dcase(tmp_path)).recordings
    assert (one.label, two.label) == (Touch.ROUGH, Touch.SMOOTH)
    assert [(each.start, each.end) for each in two.segments] == [(0.5, 1), (1.2, 1.5)]


@pytest.mark.parametrize("make", [audacity, dcase])
@pytest.mark.parametrize("dialect", ["audacity", "dcase"])
def test_what_is_written_for_another_program_is_read_again(
    make: object,
    dialect: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = {audacity: audacity, dcase: dcase}[make](tmp_path / "own")  # type: ignore[index]
    before = open_dataset(folder).recordings
    out = tmp_path / "theirs"
    command = ["dataset", "labels", str(folder), str(out), "--format", dialect]
    assert main(command) == 0
    for recording in before:
        path = out / recording.path.relative_to(folder)
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(recording.path.read_bytes())
    again = open_dataset(out).recordings
    assert [each.segments for each in again] == [each.segments for each in before]


@pytest.mark.parametrize("dialect", ["audacity", "dcase"])
def test_labels_of_a_person_are_not_replaced(
    dialect: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = {"audacity": audacity, "dcase": dcase}[dialect](tmp_path / "own")
    written = tmp_path / "new"
    for out, status in ((written, 0), (written, 0), (folder, 1)):
        before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
        command = ["dataset", "labels", str(folder), str(out), "--format", dialect]
        assert main(command) == status
        for path, content in before.items():
            assert path.read_bytes() == content
    assert "is there already, and may hold labels of yours" in capsys.readouterr().err


def test_a_text_beside_a_sound_that_is_no_label_track_is_left_alone(
    tmp_path: Path,
) -> None:
    write_sound(tmp_path / "rough" / "stone1.wav")
    (tmp_path / "rough" / "stone1.txt").write_text("bought a stone\t1\n")
    (recording,) = open_dataset(tmp_path).recordings
    assert not recording.segments
