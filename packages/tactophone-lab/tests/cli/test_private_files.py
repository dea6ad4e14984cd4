"""What is made of a file that nobody else may read, nobody else may read either."""

import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tactophone.cli import main
from tests.folders import audiofolder, write_sound
from tests.live.log.recorded_run import record
from tests.models import write_tiny_model

PRIVATE, SHARED = 0o600, 0o644

Work = Callable[[Path, int], tuple[list[str], Path]]
"""Makes a source of a mode; returns the words of a verb, and the folder that it writes
to."""


@pytest.fixture(autouse=True)
def _usual_umask() -> Iterator[None]:
    before = os.umask(0o022)
    yield
    os.umask(before)


def recording(folder: Path, mode: int) -> Path:
    path = write_sound(folder / "finger.wav")
    path.chmod(mode)
    return path


def data_set(folder: Path, mode: int) -> Path:
    root = audiofolder(folder / "set", surfaces=2)
    for path in root.rglob("*.flac"):
        path.chmod(mode)
    return root


def log(folder: Path, mode: int) -> Path:
    path = record(folder / "run.mcap", write_tiny_model(folder / "tiny.onnx"))
    path.chmod(mode)
    return path


def feel(folder: Path, mode: int) -> tuple[list[str], Path]:
    source = str(recording(folder, mode))
    return ["feel", source, "--events", "--plot", "--json"], folder / "out"


def feel_a_log(folder: Path, mode: int) -> tuple[list[str], Path]:
    return ["feel", str(log(folder, mode))], folder / "out"


def replay(folder: Path, mode: int) -> tuple[list[str], Path]:
    return ["replay", str(log(folder, mode)), "--plot"], folder / "out"


def written(command: tuple[list[str], Path]) -> list[int]:
    """Run a verb and return the modes of what it wrote."""
    words, out = command
    assert main([*words, "--out", str(out)]) == 0
    return [path.stat().st_mode & 0o777 for path in out.rglob("*") if path.is_file()]


@pytest.mark.parametrize("work", [feel, feel_a_log, replay])
def test_what_is_made_of_a_private_file_is_private(work: Work, tmp_path: Path) -> None:
    modes = written(work(tmp_path, PRIVATE))
    assert modes
    assert set(modes) == {PRIVATE}


@pytest.mark.parametrize("work", [feel, replay])
def test_what_is_made_of_a_shared_file_is_shared(work: Work, tmp_path: Path) -> None:
    modes = written(work(tmp_path, SHARED))
    assert modes
    assert set(modes) == {SHARED}


@pytest.mark.parametrize("mode", [PRIVATE, SHARED])
@pytest.mark.parametrize("source", [data_set, log])
def test_an_imported_data_set_is_read_by_whoever_may_read_its_sound(
    source: Callable[[Path, int], Path], mode: int, tmp_path: Path
) -> None:
    out, given = tmp_path / "out", str(source(tmp_path, mode))
    words = ["dataset", "import", given, str(out)]
    words += ["--label", "rough"] if source is log else []
    assert main(words) == 0
    modes = {path.stat().st_mode & 0o777 for path in out.rglob("*") if path.is_file()}
    assert modes == {mode}


@pytest.mark.parametrize("mode", [PRIVATE, SHARED])
def test_spectrograms_of_a_data_set_are_read_by_whoever_may_read_it(
    mode: int, tmp_path: Path
) -> None:
    plot = tmp_path / "set.png"
    given = str(data_set(tmp_path, mode))
    assert main(["dataset", "show", given, "--plot", str(plot)]) == 0
    assert plot.stat().st_mode & 0o777 == mode


def test_a_bag_and_a_repaired_log_are_as_private_as_their_log(tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    pytest.importorskip("cyclonedds")
    source = log(tmp_path, PRIVATE)
    bag, repaired = tmp_path / "bag", tmp_path / "repaired.mcap"
    assert main(["replay", str(source), "--to-rosbag", str(bag)]) == 0
    assert main(["replay", str(source), "--repair", str(repaired)]) == 0
    made = [repaired, *(path for path in bag.rglob("*") if path.is_file())]
    assert len(made) > 1
    assert {path.stat().st_mode & 0o777 for path in made} == {PRIVATE}


def test_the_umask_of_the_user_stays(tmp_path: Path) -> None:
    written(feel(tmp_path, PRIVATE))
    before = os.umask(0o022)
    assert before == 0o022
