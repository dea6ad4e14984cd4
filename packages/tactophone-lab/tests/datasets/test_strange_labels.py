"""Labels over time as Praat, Raven and others keep them."""

from pathlib import Path

import pytest

from tactophone.core.errors import DatasetError
from tactophone_lab.datasets.open import open_dataset
from tests.folders import write_sound, write_text

LONG = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0
xmax = 0.5
tiers? <exists>
size = 2
item []:
    item [1]:
        class = "IntervalTier"
        name = "words"
        xmin = 0
        xmax = 0.5
        intervals: size = 1
        intervals [1]:
            xmin = 0
            xmax = 0.5
            text = "take 3"
    item [2]:
        class = "IntervalTier"
        name = "touch"
        xmin = 0
        xmax = 0.5
        intervals: size = 2
        intervals [1]:
            xmin = 0
            xmax = 0.1
            text = ""
        intervals [2]:
            xmin = 0.1
            xmax = 0.4
            text = "rough"
"""

SHORT = """File type = "ooTextFile"
Object class = "TextGrid"

0
0.5
<exists>
1
"IntervalTier"
"touch"
0
0.5
2
0
0.1
""
0.1
0.4
"rough"
"""

RAVEN = "Selection\tView\tChannel\tBegin Time (s)\tEnd Time (s)"


def found(folder: Path) -> dict[str, list[tuple[float, float, str]]]:
    dataset = open_dataset(folder)
    assert not dataset.problems
    return {
        recording.path.name: [
            (each.start, each.end, each.label_name) for each in recording.segments
        ]
        for recording in dataset.recordings
    }


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("text", [LONG, SHORT])
def test_a_textgrid_beside_a_sound_is_read(
    tmp_path: Path, text: str, encoding: str
) -> None:
    write_sound(tmp_path / "a.wav")
    (tmp_path / "a.TextGrid").write_bytes(text.encode(encoding))
    assert found(tmp_path) == {"a.wav": [(0.1, 0.4, "rough")]}


def test_audacitys_labels_in_utf_16_are_read(tmp_path: Path) -> None:
    write_sound(tmp_path / "a.wav")
    (tmp_path / "a.txt").write_bytes("0,1\t0,4\trough\r\n".encode("utf-16"))
    assert found(tmp_path) == {"a.wav": [(0.1, 0.4, "rough")]}


def test_a_selection_table_beside_its_sound_is_read_once_for_all_views(
    tmp_path: Path,
) -> None:
    write_sound(tmp_path / "site1.WAV")
    write_text(
        tmp_path / "site1.Table.1.selections.txt",
        f"{RAVEN}\tAnnotation",
        "1\tWaveform 1\t1\t0.1\t0.4\trough",
        "1\tSpectrogram 1\t1\t0.1\t0.4\trough",
    )
    assert found(tmp_path) == {"site1.WAV": [(0.1, 0.4, "rough")]}


def test_a_selection_table_of_many_sounds_counts_within_each(tmp_path: Path) -> None:
    for name in ("a.wav", "b.wav"):
        write_sound(tmp_path / name)
    write_text(
        tmp_path / "all.selections.txt",
        f"{RAVEN}\tBegin Path\tFile Offset (s)\tBegin File\tAnnotation",
        "1\tWaveform 1\t1\t0.0\t0.25\tC:\\\\rec\\\\a.wav\t0.0\ta.wav\trough",
        "2\tWaveform 1\t1\t0.75\t1.0\tC:\\\\rec\\\\b.wav\t0.25\tb.wav\tsmooth",
    )
    assert found(tmp_path) == {
        "a.wav": [(0.0, 0.25, "rough")],
        "b.wav": [(0.25, 0.5, "smooth")],
    }


@pytest.mark.parametrize("ending", [".eaf", ".vtt", ".srt", ".aup3"])
def test_labels_that_are_not_read_are_named_with_the_way_to_ones_that_are(
    tmp_path: Path, ending: str
) -> None:
    write_sound(tmp_path / "a.wav")
    (tmp_path / f"a{ending}").write_text("labels")
    with pytest.raises(DatasetError, match=rf"a\{ending} is .*: .*[Ee]xport"):
        open_dataset(tmp_path)
