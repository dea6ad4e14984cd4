"""A log whose recorder was killed becomes a file that other programs read."""

from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.live.log.mcap import LogEnd, read_messages
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model

reader = pytest.importorskip("mcap.reader")
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
