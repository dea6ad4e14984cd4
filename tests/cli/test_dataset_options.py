from pathlib import Path

import pytest

from tactophone import DatasetError
from tactophone.cli._support.dataset_options import open_filtered
from tests.dataset.folders import audiofolder


def test_every_filter_must_match(tmp_path: Path) -> None:
    kept = open_filtered(audiofolder(tmp_path), ["surface=stone 00,stone 01", "scenario=table"])
    assert [recording.path.name for recording in kept.recordings] == ["00_1.flac", "01_1.flac"]
    assert len(open_filtered(tmp_path, None).recordings) == 8


def test_bad_files_are_left_out(tmp_path: Path) -> None:
    (audiofolder(tmp_path) / "audio" / "02_0.flac").write_bytes(b"")
    assert len(open_filtered(tmp_path, None).recordings) == 7


@pytest.mark.parametrize(
    ("text", "message"), [("scenario", "write KEY=VALUE"), ("scenario=box", "scenario is one of hand, table")]
)
def test_a_filter_without_a_match_says_what_there_is(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(DatasetError, match=message):
        open_filtered(audiofolder(tmp_path), [text])
