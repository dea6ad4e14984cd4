import os
import socket
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tactophone.core.errors import DeviceError
from tactophone.live.audio import dummy, jack, jack_files
from tactophone.live.audio.jack_files import damage, has_socket

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="JACK is elsewhere")

WHOLE = {
    "__db.001": 286_719,
    "__db.002": 32_767,
    "__db.003": 49_151,
    "metadata.db": 12_288,
}


@pytest.fixture
def database(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Makes JACK's database out of files of given sizes."""
    monkeypatch.setattr(jack_files, "_FOLDER", tmp_path)
    monkeypatch.setattr(jack_files, "_is_jack2", lambda: True)

    def make(sizes: dict[str, int]) -> Path:
        folder = tmp_path / f"jack_db-{os.getuid()}"
        folder.mkdir()
        for name, size in sizes.items():
            (folder / name).write_bytes(bytes(size))
        return folder

    return make


def test_a_machine_without_jack_has_no_damage(database: Callable[..., Path]) -> None:
    assert damage() == ""


@pytest.mark.parametrize("sizes", [{}, WHOLE])
def test_a_whole_database_is_no_damage(
    sizes: dict[str, int], database: Callable[..., Path]
) -> None:
    database(sizes)
    assert damage() == ""


@pytest.mark.parametrize(
    "sizes",
    [
        {"__db.002": 0},
        WHOLE | {"__db.002": 0},
        WHOLE | {"metadata.db": 0},
        {name: size for name, size in WHOLE.items() if name != "__db.003"},
    ],
)
def test_a_part_of_a_database_is_named_by_what_would_crash(
    sizes: dict[str, int],
    database: Callable[..., Path],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = database(sizes)
    assert f"{folder} is damaged" in damage()
    client = jack.JackClient("probe", None, inputs={}, outputs={}, server="none")
    with pytest.raises(DeviceError, match="delete that folder"):
        client.open()
    client.revive()
    monkeypatch.setattr("shutil.which", lambda name: name)
    with pytest.raises(DeviceError, match="delete that folder"):
        dummy.DummyServer().start()


def test_libjack_is_not_asked_without_a_socket_of_the_server(
    database: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    database(WHOLE)
    asked = []
    monkeypatch.setattr("jack.Client", lambda *_, **__: asked.append(1))
    client = jack.JackClient("probe", None, inputs={}, outputs={}, server="left")
    with pytest.raises(DeviceError, match="no JACK server left"):
        client.open()
    client.revive()
    assert not asked
    monkeypatch.setenv("JACK_DEFAULT_SERVER", "left")
    assert not has_socket("")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(tmp_path / f"jack_left_{os.getuid()}_0"))
        assert has_socket("")
        assert has_socket("left")
    assert not has_socket("default")
