from pathlib import Path

import pytest

from tactophone import DatasetError
from tactophone.cli._support.dataset_options import choose
from tests.dataset.folders import audiofolder


def test_every_wish_must_hold(tmp_path: Path) -> None:
    kept = choose(audiofolder(tmp_path), ["surface=stone 00,stone 01", "scenario=table"])
    assert [one.path.name for one in kept.recordings] == ["00_1.flac", "01_1.flac"]
    assert len(choose(tmp_path, None).recordings) == 8


def test_bad_files_are_left_out(tmp_path: Path) -> None:
    (audiofolder(tmp_path) / "audio" / "02_0.flac").write_bytes(b"")
    assert len(choose(tmp_path, None).recordings) == 7


@pytest.mark.parametrize(
    ("wish", "told"), [("scenario", "write KEY=VALUE"), ("scenario=box", "scenario is one of hand, table")]
)
def test_a_wish_that_cannot_hold_says_what_there_is(tmp_path: Path, wish: str, told: str) -> None:
    with pytest.raises(DatasetError, match=told):
        choose(audiofolder(tmp_path), [wish])
