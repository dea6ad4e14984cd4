from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.recordings.values import Segment
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.render import (
    RenderMetadata,
    read_render_metadata,
    touch_segments,
    write_sound,
)

METADATA = RenderMetadata(
    "fingerprint", (Segment(0.0, 0.5, "none"), Segment(0.5, 1.0, "rough"))
)


@pytest.mark.parametrize("suffix", [".flac", ".wav"])
def test_a_file_holds_its_metadata(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / "deep" / f"sound{suffix}"
    write_sound(path, np.zeros((100, 2), np.float32), METADATA)
    assert read_render_metadata(path) == METADATA
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_other_files_have_no_metadata(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "other.flac", np.zeros((10, 1)), 48_000)
    (tmp_path / "broken.flac").write_bytes(b"fLaC")
    assert read_render_metadata(tmp_path / "other.flac") is None
    assert read_render_metadata(tmp_path / "broken.flac") is None
    assert read_render_metadata(tmp_path / "absent.flac") is None


def test_bounces_are_merged_and_the_ground_is_contact() -> None:
    index = np.repeat(
        [-1, 0, -1, 0, 1, -1], [4800, 4800, 480, 4800, 4800, 4800]
    ).astype(np.int16)
    segments = touch_segments(index, single(find("lava stone")))
    assert [segment.label_name for segment in segments] == [
        "none",
        "rough",
        "contact",
        "none",
    ]
    assert segments[1].end - segments[1].start == pytest.approx(0.21)


def test_an_unfinished_file_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / ".sound.flac.part").write_bytes(b"half")
    write_sound(tmp_path / "sound.flac", np.zeros((100, 2), np.float32), METADATA)
    assert [file.name for file in tmp_path.iterdir()] == ["sound.flac"]
