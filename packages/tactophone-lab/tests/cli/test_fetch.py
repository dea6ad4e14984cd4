"""Published sets are fetched from a local server, or made up in their layouts."""

import functools
import hashlib
import http.server
import io
import threading
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.cli import main
from tactophone.core.errors import DatasetError
from tactophone.core.types import Touch
from tactophone_lab.app import fetch
from tactophone_lab.app.fetch import ARCHIVE, fetch_authors
from tactophone_lab.datasets.biotac import PAC, import_biotac
from tactophone_lab.datasets.checks import check
from tactophone_lab.datasets.cluster import import_cluster
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.published_labels import ImportedSet
from tests.folders import write_text


@pytest.fixture
def server(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    folder = tmp_path / "served"
    folder.mkdir()
    handler = functools.partial(
        http.server.SimpleHTTPRequestHandler, directory=str(folder)
    )
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


@pytest.mark.slow
def test_the_authors_share_is_fetched_checked_and_read(
    server: tuple[Path, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, address = server
    sha256 = archive(folder / "share.zip")
    words = ["authors", str(tmp_path / "out"), "--archive", f"{address}/share.zip"]
    assert main(["fetch", *words, "--sha256", sha256]) == 0
    shown = capsys.readouterr()
    assert "BSD 3-Clause" in shown.err + shown.out
    (recording,) = open_dataset(shown.out.strip().splitlines()[-1]).recordings
    assert recording.label == Touch.ROUGH
    assert ARCHIVE.startswith("https://cloud.vi.cs.uni-bonn.de/")


def test_a_download_is_written_through_no_link(
    server: tuple[Path, str], tmp_path: Path
) -> None:
    folder, address = server
    sha256 = archive(folder / "share.zip")
    victim = tmp_path / "victim"
    victim.write_text("mine")
    out = tmp_path / "out"
    out.mkdir()
    (out / "authors.part").symlink_to(victim)
    assert fetch_authors(out, archive=f"{address}/share.zip").sha256 == sha256
    assert victim.read_text() == "mine"


@pytest.mark.slow
def test_a_wrong_checksum_a_page_in_place_of_an_archive_and_a_dead_server_are_told(
    server: tuple[Path, str], tmp_path: Path
) -> None:
    folder, address = server
    archive(folder / "share.zip")
    (folder / "page.zip").write_text("<html>moved</html>")
    with pytest.raises(DatasetError, match="its SHA-256 is"):
        fetch_authors(tmp_path / "one", archive=f"{address}/share.zip", sha256="0" * 64)
    with pytest.raises(DatasetError, match="cannot be unpacked"):
        fetch_authors(tmp_path / "two", archive=f"{address}/page.zip")
    with pytest.raises(DatasetError, match="cannot be downloaded"):
        fetch_authors(tmp_path / "three", archive=f"{address}/missing.zip")
    archive(folder / "evil.zip", name="../../evil.wav")
    with pytest.raises(DatasetError, match="outside its folder"):
        fetch_authors(tmp_path / "four", archive=f"{address}/evil.zip")
    assert not list(tmp_path.rglob("evil.wav"))


def with_byte(content: bytes, *places: tuple[bytes, int, int]) -> bytes:
    """Set a byte so far behind each signature of a zip archive."""
    changed = bytearray(content)
    for signature, offset, value in places:
        changed[changed.find(signature) + offset] = value
    return bytes(changed)


ENTRY = b"PK\3\4"
TABLE = b"PK\1\2"


@pytest.mark.parametrize(
    "places",
    [
        [(ENTRY, 6, 1), (TABLE, 8, 1)],  # encrypted
        [(ENTRY, 8, 97), (TABLE, 10, 97)],  # a compression that nobody knows
        [(ENTRY, 60, 0), (ENTRY, 61, 0)],  # damaged
        [(TABLE, 46, 0)],  # another name than the entry's own
    ],
)
def test_an_archive_that_cannot_be_unpacked_is_told_and_leaves_nothing(
    places: list[tuple[bytes, int, int]], server: tuple[Path, str], tmp_path: Path
) -> None:
    folder, address = server
    archive(folder / "share.zip")
    content = (folder / "share.zip").read_bytes()
    (folder / "share.zip").write_bytes(with_byte(content, *places))
    with pytest.raises(DatasetError, match="cannot be unpacked"):
        fetch_authors(tmp_path / "out", archive=f"{address}/share.zip")
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["authors.zip"]


def test_a_fetched_archive_overwrites_no_file_that_was_there(
    server: tuple[Path, str], tmp_path: Path
) -> None:
    folder, address = server
    archive(folder / "share.zip", name="notes.txt")
    (tmp_path / "notes.txt").write_text("mine")
    for _ in range(2):  # the second time it is only looked at
        fetched = fetch_authors(tmp_path, archive=f"{address}/share.zip")
        assert fetched.folder == tmp_path / "authors"
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_an_archive_that_unpacks_to_more_than_is_plausible_is_refused(
    server: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, address = server
    archive(folder / "share.zip")
    monkeypatch.setattr(fetch, "MOST_UNPACKED", 1000)
    with pytest.raises(DatasetError, match="unpacks to"):
        fetch_authors(tmp_path / "out", archive=f"{address}/share.zip")


def cluster(folder: Path) -> Path:
    """Write three surfaces in the layout of the Cluster Haptic Texture Dataset."""
    place = folder / "sensor_data" / "raw_audio"
    place.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for name in ("0_0_20_500_0", "0_45_60_1000_1", "65_0_20_500_0", "74_0_20_500_0"):
        soundfile.write(place / f"{name}.flac", rng.normal(0, 0.1, (4410, 2)), 44_100)
    (place / "notes.flac").write_bytes(b"none")
    space = 'xmlns="http://schemas.openxmlformats.org/spreadsheetml/2006/main"'
    texts = "".join(
        f"<si><t>{text}</t></si>"
        for text in ("id", "name", "Nyatoh", "Stainless steel")
    )
    rows = (
        '<row r="1"><c r="A1" t="s"><v>0</v></c><c r="B1" t="s"><v>1</v></c></row><row '
        'r="2"><c r="A2"><v>0</v></c><c r="B2" t="s"><v>2</v></c><c '
        'r="C2"><v>0.4</v></c></row><row r="3"><c r="A3"><v>65</v></c><c r="B3" '
        't="s"><v>3</v></c></row>'
    )
    with zipfile.ZipFile(folder / "texture_list.xlsx", "w") as book:
        book.writestr("xl/sharedStrings.xml", f"<sst {space}>{texts}</sst>")
        book.writestr(
            "xl/worksheets/sheet1.xml",
            f"<worksheet {space}><sheetData>{rows}</sheetData></worksheet>",
        )
    return folder


def test_the_cluster_set_becomes_slides_of_one_air_microphone(tmp_path: Path) -> None:
    theirs = cluster(tmp_path / "theirs")
    (theirs / "labels.csv").write_text(
        "surface,label\nNyatoh,rough\nStainless steel,smooth\n"
    )
    assert main(["fetch", "cluster", str(theirs), str(tmp_path / "ours")]) == 0
    made = open_dataset(tmp_path / "ours")
    assert {(each.surface, each.label) for each in made.recordings} == {
        ("Nyatoh", Touch.ROUGH),
        ("Stainless steel", Touch.SMOOTH),
        ("texture 74", None),
    }
    assert {each.channels for each in made.recordings} == {("air",)}
    first = next(each for each in made.recordings if each.take == "0_45_60_1000_1")
    assert (
        first.known("speed_mm_s"),
        first.known("direction_deg"),
        first.known("force_mn"),
    ) == ("60", "45", "1000")
    theirs_main = soundfile.read(theirs / "sensor_data/raw_audio/0_45_60_1000_1.flac")[
        0
    ][:, 0]
    assert soundfile.read(first.path)[0] == pytest.approx(theirs_main, abs=2**-20)


def test_what_is_not_the_cluster_set_is_refused_in_a_line(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="name the unpacked folder"):
        import_cluster(tmp_path, tmp_path / "out")
    theirs = cluster(tmp_path / "theirs")
    (theirs / "texture_list.xlsx").write_bytes(b"none")
    with pytest.raises(DatasetError, match="download it beside"):
        import_cluster(theirs, tmp_path / "out")


def biotac(root: Path) -> Path:
    pac = 2048 + 200 * np.sin(2 * np.pi * 110 * np.arange(22 * 100) / 2200)
    for name in ("mat1/mat1_1_bio.csv", "mat2/mat2_1_bio.csv"):
        lines = (
            ",".join(["0", *(f"{value:.0f}" for value in row)])
            for row in pac.reshape(-1, 22)
        )
        write_text(root / "raw_data" / name, ",".join(["time", *PAC]), *lines)
    write_text(root / "raw_data" / "mat1" / "notes.csv", "a,b", "1,2")
    write_text(root / "labels.csv", "surface;label", "mat1;rough", "mat2;smooth")
    return root


def test_the_vibration_of_a_biotac_becomes_sound(tmp_path: Path) -> None:
    made = import_biotac(biotac(tmp_path / "theirs"), tmp_path / "ours")
    assert [problem.path.name for problem in made.problems] == ["notes.csv"]
    opened = open_dataset(tmp_path / "ours")
    assert check(opened) == ()
    labels = {take.surface: take.label for take in opened.recordings}
    assert labels == {"mat1": Touch.ROUGH, "mat2": Touch.SMOOTH}
    sound, rate = soundfile.read(made.recordings[0].path)
    assert (rate, sound.shape) == (2200, (2200,))
    assert np.abs(np.fft.rfft(sound)).argmax() == 110
    assert np.abs(sound).max() == pytest.approx(200 / 2048, rel=0.01)


def test_the_program_says_how_many_it_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs, ours = str(biotac(tmp_path / "theirs")), str(tmp_path / "ours")
    assert main(["fetch", "biotac", theirs, ours]) == 0
    assert capsys.readouterr().out.startswith("2 recordings in")


def test_a_folder_without_such_files_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fetch", "biotac", str(tmp_path), str(tmp_path / "ours")]) == 1
    assert "nothing to import" in capsys.readouterr().err
    with pytest.raises(DatasetError, match="nothing to import"):
        import_biotac(tmp_path, tmp_path / "ours")


@pytest.mark.parametrize("part", ["", "train"])
@pytest.mark.parametrize(
    ("made", "convert"), [(biotac, import_biotac), (cluster, import_cluster)]
)
def test_no_data_set_that_is_there_is_replaced(
    made: Callable[[Path], Path],
    convert: Callable[[Path, Path], ImportedSet],
    part: str,
    tmp_path: Path,
) -> None:
    manifest = tmp_path / "ours" / part / "metadata.csv"
    manifest.parent.mkdir(parents=True)
    manifest.write_text("file_name,surface\na.wav,slate\n")
    with pytest.raises(DatasetError, match="holds a data set already"):
        convert(made(tmp_path / "theirs"), tmp_path / "ours")
    assert list((tmp_path / "ours").rglob("*.*")) == [manifest]
