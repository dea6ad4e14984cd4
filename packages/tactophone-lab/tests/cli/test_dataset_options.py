from pathlib import Path

import pytest

from tactophone import DatasetError
from tactophone_lab.cli.data import open_filtered
from tests.folders import audiofolder, write_sound


def test_every_filter_must_match(tmp_path: Path) -> None:
    kept = open_filtered(
        audiofolder(tmp_path), ["surface=stone 00,stone 01", "scenario=table"]
    )
    assert [recording.path.name for recording in kept.recordings] == [
        "00_1.flac",
        "01_1.flac",
    ]
    assert len(open_filtered(tmp_path, None).recordings) == 8


def test_bad_files_are_left_out(tmp_path: Path) -> None:
    (audiofolder(tmp_path) / "audio" / "02_0.flac").write_bytes(b"")
    assert len(open_filtered(tmp_path, None).recordings) == 7


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scenario", "write KEY=VALUE"),
        ("scenario=box", "scenario is one of hand, table"),
    ],
)
def test_a_filter_without_a_match_says_what_there_is(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(DatasetError, match=message):
        open_filtered(audiofolder(tmp_path), [text])


def test_a_mono_file_among_stereo_ones_is_left_out_and_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sound(audiofolder(tmp_path) / "audio" / "02_0.flac", channels=1)
    manifest = (
        (tmp_path / "metadata.csv")
        .read_text()
        .replace(
            "02_0.flac,stone 02,rough,contact|air", "02_0.flac,stone 02,rough,contact"
        )
    )
    (tmp_path / "metadata.csv").write_text(manifest)
    assert len(open_filtered(tmp_path, None, channels=2).recordings) == 7
    printed = capsys.readouterr().err
    assert "02_0.flac: channels: one microphone" in printed
    assert "--channels 1" in printed
    assert len(open_filtered(tmp_path, None, channels=1).recordings) == 8
