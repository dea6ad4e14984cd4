"""Published data sets: fetched from a local server, imported from made-up files in their layout."""

import functools
import hashlib
import http.server
import io
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.core.types import Touch
from tactophone.lab.dataset.cluster import import_cluster
from tactophone.lab.dataset.fetch import SHARES, fetch
from tactophone.lab.dataset.read import open_dataset


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    folder = tmp_path / "served"
    folder.mkdir()
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as serving:
        thread = threading.Thread(target=serving.serve_forever)
        thread.start()
        yield folder, f"http://127.0.0.1:{serving.server_port}"
        serving.shutdown()
        thread.join()


def archive(path: Path, *, name: str = "share/opus/stereo/00_long_light.wav") -> str:
    sound = io.BytesIO()
    soundfile.write(sound, np.zeros((4800, 2)), 48_000, format="WAV")
    with zipfile.ZipFile(path, "w") as files:
        files.writestr(name, sound.getvalue())
        files.writestr("share/LICENSE", "BSD-3")
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_authors_share_is_fetched_checked_and_read(
    server: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, address = server
    sha256 = archive(folder / "share.zip")
    words = ["dataset", "fetch", "authors", str(tmp_path / "out"), "--archive", f"{address}/share.zip"]
    assert main([*words, "--sha256", sha256]) == 0
    shown = capsys.readouterr()
    assert "BSD 3-Clause" in shown.err + shown.out
    (recording,) = open_dataset(shown.out.strip().splitlines()[-1]).recordings
    assert recording.label == Touch.ROUGH
    assert SHARES["authors"].archive.startswith("https://cloud.vi.cs.uni-bonn.de/")


def test_a_wrong_checksum_a_page_in_place_of_an_archive_and_a_dead_server_are_told(
    server: tuple[Path, str], tmp_path: Path
) -> None:
    folder, address = server
    archive(folder / "share.zip")
    (folder / "page.zip").write_text("<html>moved</html>")
    with pytest.raises(DatasetError, match="its SHA-256 is"):
        fetch("authors", tmp_path / "one", archive=f"{address}/share.zip", sha256="0" * 64)
    with pytest.raises(DatasetError, match="is no zip archive"):
        fetch("authors", tmp_path / "two", archive=f"{address}/page.zip")
    with pytest.raises(DatasetError, match="cannot be downloaded"):
        fetch("authors", tmp_path / "three", archive=f"{address}/missing.zip")
    archive(folder / "evil.zip", name="../../evil.wav")
    with pytest.raises(DatasetError, match="outside its folder"):
        fetch("authors", tmp_path / "four", archive=f"{address}/evil.zip")
    assert not list(tmp_path.rglob("evil.wav"))


def cluster(folder: Path) -> Path:
    """Write three surfaces in the layout of the Cluster Haptic Texture Dataset."""
    place = folder / "sensor_data" / "raw_audio"
    place.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for name in ("0_0_20_500_0", "0_45_60_1000_1", "65_0_20_500_0", "74_0_20_500_0"):
        soundfile.write(place / f"{name}.flac", rng.normal(0, 0.1, (4410, 2)), 44_100)
    (place / "notes.flac").write_bytes(b"none")
    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    texts = "".join(f"<si><t>{text}</t></si>" for text in ("id", "name", "Nyatoh", "Stainless steel"))
    rows = (
        '<row r="1"><c r="A1" t="s"><v>0</v></c><c r="B1" t="s"><v>1</v></c></row>'
        '<row r="2"><c r="A2"><v>0</v></c><c r="B2" t="s"><v>2</v></c><c r="C2"><v>0.4</v></c></row>'
        '<row r="3"><c r="A3"><v>65</v></c><c r="B3" t="s"><v>3</v></c></row>'
    )
    with zipfile.ZipFile(folder / "texture_list.xlsx", "w") as book:
        book.writestr("xl/sharedStrings.xml", f"<sst {space}>{texts}</sst>")
        book.writestr("xl/worksheets/sheet1.xml", f"<worksheet {space}><sheetData>{rows}</sheetData></worksheet>")
    return folder


def test_the_cluster_set_becomes_slides_of_one_air_microphone(tmp_path: Path) -> None:
    theirs = cluster(tmp_path / "theirs")
    (theirs / "labels.csv").write_text("surface,label\nNyatoh,rough\nStainless steel,smooth\n")
    words = ["dataset", "import", str(theirs), str(tmp_path / "ours"), "--format", "cluster"]
    assert main(words) == 0
    made = open_dataset(tmp_path / "ours")
    assert {(each.surface, each.label) for each in made.recordings} == {
        ("Nyatoh", Touch.ROUGH), ("Stainless steel", Touch.SMOOTH), ("texture 74", None),
    }  # fmt: skip
    assert {each.channels for each in made.recordings} == {("air",)}
    first = next(each for each in made.recordings if each.take == "0_45_60_1000_1")
    assert (first.known("speed_mm_s"), first.known("direction_deg"), first.known("force_mn")) == ("60", "45", "1000")
    theirs_main = soundfile.read(theirs / "sensor_data/raw_audio/0_45_60_1000_1.flac")[0][:, 0]
    assert soundfile.read(first.path)[0] == pytest.approx(theirs_main, abs=2**-20)


def test_what_is_not_the_cluster_set_is_refused_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="name the unpacked folder"):
        import_cluster(tmp_path, tmp_path / "out")
    theirs = cluster(tmp_path / "theirs")
    (theirs / "texture_list.xlsx").write_bytes(b"none")
    with pytest.raises(DatasetError, match="download it beside"):
        import_cluster(theirs, tmp_path / "out")
