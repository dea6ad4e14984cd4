"""A downloaded folder that one stands in is data: no verb runs the Python modules in
it."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import soundfile

from tactophone.core.recordings.metadata import write_metadata
from tests.surfaces import RATE, scrape, surfaces

pytestmark = pytest.mark.realtime

PROGRAM = Path(sys.executable).with_name("tactophone")
"""The installed command: ``python -m`` itself looks into the current folder."""

VERBS = {
    "demo": "demo --out out",
    "play": "play",
    "try": "try",
    "loopback": "loopback --source finger --actuator none",
    "send": "send --source finger --peer 127.0.0.1:9",
    "receive": "receive --actuator none --set link.port=48931",
    "call": "call --check --set call.mailbox=ws://127.0.0.1:9/v1 --set "
    "call.stun=127.0.0.1:9",
    "answer": "answer 3-escapade-peachy --yes --source finger --set "
    "call.mailbox=ws://127.0.0.1:9/v1",
    "setup": "setup --dashboard --source finger --yes",
    "simulate": "simulate dataset set --objects 1,2,3 --takes wiggle --seconds 0.5 "
    "--jobs 2",
    "benchmark": "benchmark --data surfaces --methods level --splits 2-fold --workers "
    "2 --out b --cache c",
}
"""A command of each verb that starts processes."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the package that each new process imports first."""
    (tmp_path / "multiprocessing").mkdir()
    (tmp_path / "multiprocessing/__init__.py").write_text(
        f"open({str(tmp_path / 'executed')!r}, 'w')\n1 / 0\n"
    )
    return tmp_path


def _children(run: "subprocess.Popen[str]") -> Iterator[psutil.Process]:
    """Yield the processes of Python that a run has started, once there is one."""
    until = time.monotonic() + 90
    while time.monotonic() < until and run.poll() is None:
        found = [
            child
            for child in psutil.Process(run.pid).children(recursive=True)
            if "-c" in child.cmdline()
        ]
        if any("spawn_main" in part for child in found for part in child.cmdline()):
            yield from found
            return
        time.sleep(0.02)


def _safe(child: psutil.Process) -> bool:
    try:
        return child.environ().get("PYTHONSAFEPATH") == "1"
    except psutil.NoSuchProcess:
        return True


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_starts_processes_that_import_nothing_from_the_current_folder(
    verb: str, folder: Path
) -> None:
    if verb == "benchmark":
        (folder / "surfaces").mkdir()
        write_metadata(folder / "surfaces", surfaces(folder / "surfaces").recordings)
    live = [
        "--set",
        "process.name=test-hostile",
        "--set",
        f"link.identity={folder / 'identity'}",
    ]
    command = [
        str(PROGRAM),
        *VERBS[verb].split(),
        *(live if verb not in {"simulate", "benchmark"} else ()),
    ]
    with subprocess.Popen(
        command,
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as run:
        seen = [_safe(child) for child in _children(run)]
        run.terminate()
        assert run.stderr
        assert seen, run.stderr.read()
    assert all(seen)
    assert not (folder / "executed").exists()


SETTINGS = {
    "matplotlibrc": "text.usetex: True",
    ".numba_config.yaml": "cache_dir: cache",
}
"""Files of the current folder by which a library runs code, and a line that does."""


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("matplotlibrc", "feel sound.wav --plot"),
        ("matplotlibrc", "demo --out out"),
        (".numba_config.yaml", "play"),
        (".numba_config.yaml", "simulate dataset set --objects 1 --takes wiggle"),
        (".numba_config.yaml", "loopback --source finger --actuator none"),
        (".numba_config.yaml", "send --source finger --peer 127.0.0.1:9"),
    ],
)
def test_no_library_takes_its_settings_from_the_current_folder(
    name: str, command: str, tmp_path: Path
) -> None:
    soundfile.write(tmp_path / "sound.wav", scrape(rough=True, seed=1), RATE)
    (tmp_path / name).write_text(SETTINGS[name])
    own = ("--set", f"link.identity={tmp_path / 'identity'}", "--set")
    live = (*own, "process.name=test-settings")
    done = subprocess.run(
        [
            str(PROGRAM),
            *command.split(),
            *(live if command.startswith(("play", "loopback", "send")) else ()),
        ],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert f"the current folder holds {name}" in done.stderr
    assert "Traceback" not in done.stderr
