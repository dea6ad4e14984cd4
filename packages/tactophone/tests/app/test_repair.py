"""A log whose recorder was killed becomes a file that other programs read."""

import errno
import os
from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.live.log.mcap import LogEnd, LogFile, read_messages
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model

reader = pytest.importorskip("mcap.reader")
writer = pytest.importorskip("mcap.writer")
exceptions = pytest.importorskip("mcap.exceptions")


@pytest.fixture(scope="module")
def killed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log that ends in the middle, in its second half."""
    folder = tmp_path_factory.mktemp("killed")
    log = record(folder / "whole.mcap", write_tiny_model(folder / "tiny.onnx"))
    content = log.read_bytes()
    path = folder / "killed.mcap"
    path.write_bytes(content[: len(content) * 2 // 3])
    return path


def indexed(path: Path) -> list[bytes]:
    """Read by the index at a file's end, as the public library does."""
    with path.open("rb") as file:
        found = reader.SeekingReader(file, validate_crcs=True)
        assert found.get_summary() is not None
        return [message.data for _, _, message in found.iter_messages()]


def test_a_repaired_log_holds_all_that_was_readable_and_ends_in_order(
    killed: Path, tmp_path: Path
) -> None:
    with pytest.raises(exceptions.McapError):
        indexed(killed)
    finished = tmp_path / "finished.mcap"
    assert main(["replay", str(killed), "--repair", str(finished)]) == 0
    *before, end = read_messages(killed)
    *after, new_end = read_messages(finished)
    assert before
    assert [each.data for each in after] == [each.data for each in before]
    assert (end.complete, new_end.complete) == (False, True)
    assert new_end.missed == end.missed
    assert sorted(indexed(finished)) == sorted(each.data for each in before)
    assert isinstance(new_end, LogEnd)
    assert main(["replay", str(finished)]) == 0


def test_a_log_is_not_repaired_over_itself(
    killed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = killed.read_bytes()
    assert main(["replay", str(killed), "--repair", str(killed)]) == 1
    assert "the log itself" in capsys.readouterr().err
    assert killed.read_bytes() == content


@pytest.mark.parametrize("option", ["--repair", "--audio"])
@pytest.mark.parametrize("fails", ["write", "__exit__"])
def test_a_copy_that_fails_leaves_what_was_there(
    option: str,
    fails: str,
    killed: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A full disk took the log that had the name of the copy."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    kept = tmp_path / "kept.mcap"
    kept.write_bytes(b"another log")
    monkeypatch.setattr(
        *{
            "write": (LogFile, "write", full),
            "__exit__": (writer.Writer, "finish", full),
        }[fails]
    )
    assert main(["replay", str(killed), option, str(kept)]) == 1
    assert f"cannot write {kept}" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["kept.mcap"]
    assert kept.read_bytes() == b"another log"


@pytest.mark.parametrize(
    "words", [["replay"], ["feel"], ["dataset", "import"]], ids=lambda words: words[0]
)
def test_a_pipe_is_no_log(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whoever fills it may never come."""
    pipe = tmp_path / "run.mcap"
    os.mkfifo(pipe)
    after = [str(tmp_path / "out")] if words[0] == "dataset" else []
    assert main([*words, str(pipe), *after]) == 1
    assert str(pipe) in capsys.readouterr().err


def test_a_report_names_a_pipe_that_is_no_log(tmp_path: Path) -> None:
    pipe, report = tmp_path / "run.mcap", tmp_path / "report.md"
    os.mkfifo(pipe)
    assert main(["report", "--log", str(pipe), "--out", str(report)]) == 0
    assert "no regular file" in report.read_text()
